"""How far estimated poses are from true ones, or from known relations between them.

Absolute and relative errors are those of evo (Grupp 2017): after the rigid motion of the plane
that fits the positions best (Umeyama 1991, without scale), and of the moves from one pose to the
next. Errors of relations are those of Kuemmerle et al. 2009, "On measuring the accuracy of SLAM
algorithms": the mean over relations of the length and of the turn that are left between the
estimated move and the known one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int64Array
from ogm_mcmc.errors import GridError

__all__ = [
    'PoseErrors',
    'Relations',
    'absolute_errors',
    'aligned_trajectory',
    'coverage',
    'matched_stamps',
    'relation_errors',
    'relations_at',
    'relative_errors',
]


class PoseErrors(NamedTuple):
    """Errors of n poses or moves, in m (n,) and rad (n,), all at least 0."""

    distance_m: Float64Array
    turn_rad: Float64Array

    def summary(self) -> dict[str, float]:
        """Return mean, root of the mean square and maximum of both, turns in degrees."""
        turn = np.degrees(self.turn_rad)
        return {
            'mean_m': float(self.distance_m.mean()),
            'rmse_m': float(np.sqrt((self.distance_m**2).mean())),
            'max_m': float(self.distance_m.max()),
            'mean_deg': float(turn.mean()),
            'rmse_deg': float(np.sqrt((turn**2).mean())),
            'max_deg': float(turn.max()),
        }


class Relations(NamedTuple):
    """R known moves: from the pose `first` to the pose `second` (R,), `move` (R, 3) in the frame
    of the first: x, y, m, yaw, rad.
    """  # noqa: D205

    first: Int64Array
    second: Int64Array
    move: Float64Array


def aligned_trajectory(poses: Float64Array, truth: Float64Array) -> Float64Array:
    """Return poses (K, 3) moved rigidly so that their positions fit those of `truth` best.

    Raises GridError for another number of poses, or none.
    """
    if poses.shape != truth.shape or poses.ndim != 2 or poses.shape[0] == 0:
        raise GridError(f'poses {poses.shape}: expected as many as true ones, {truth.shape}')
    middle, true_middle = poses[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    (x, y), (u, v) = (poses[:, :2] - middle).T, (truth[:, :2] - true_middle).T
    turn = np.arctan2((x * v - y * u).sum(), (x * u + y * v).sum())
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=1)
    return np.column_stack((turned + true_middle, _wrapped(poses[:, 2] + turn)))


def absolute_errors(poses: Float64Array, truth: Float64Array) -> PoseErrors:
    """Return the errors of poses (K, 3) after rigid alignment; raises GridError."""
    off = aligned_trajectory(poses, truth) - truth
    return PoseErrors(np.hypot(off[:, 0], off[:, 1]), np.abs(_wrapped(off[:, 2])))


def relative_errors(poses: Float64Array, truth: Float64Array, delta: int = 1) -> PoseErrors:
    """Return the errors of the moves from each pose to the one `delta` after it."""
    first = np.arange(len(truth) - delta, dtype=np.int64)
    move = _moves(truth[first], truth[first + delta])
    return relation_errors(poses, Relations(first, first + delta, move))


def relation_errors(poses: Float64Array, relations: Relations) -> PoseErrors:
    """Return the errors of known moves between poses (K, 3)."""
    off = _moves(poses[relations.first], poses[relations.second]) - relations.move
    return PoseErrors(np.hypot(off[:, 0], off[:, 1]), np.abs(_wrapped(off[:, 2])))


def coverage(off: AnyArray, deviations: AnyArray, width: float = 1.96) -> Float64Array:
    """Return the share of errors (n, d) within so many standard deviations (n, d), each of d."""
    inside = np.abs(off) <= width * np.asarray(deviations)
    return np.asarray(inside.mean(axis=0), np.float64)


def matched_stamps(
    stamps_ns: Int64Array, others_ns: Int64Array, tolerance_s: float
) -> tuple[Int64Array, Int64Array]:
    """Return which of some stamps (K,) have which other one (L,) near by: the nearest, as evo.

    Both increase. Both results have as many entries as there are pairs.
    """
    nearest, _ = _nearest(others_ns / 1e9, stamps_ns / 1e9)
    # Nanoseconds of today do not fit into a float.
    apart_s = np.abs(others_ns[nearest] - stamps_ns) / 1e9
    used = np.flatnonzero(apart_s <= tolerance_s)
    return used.astype(np.int64), nearest[used]


def relations_at(rows: Float64Array, stamps_s: AnyArray, tolerance_s: float = 1e-3) -> Relations:
    """Return those relations that have a pose at both ends.

    rows      (N, 8): stamp, stamp, x, y, z, roll, pitch, yaw, as `read_relations` returns them
    stamps_s  (K,) of the poses, in any order; nothing is interpolated
    """
    stamps = np.asarray(stamps_s, np.float64)
    order = np.argsort(stamps, kind='stable')
    ends = [_nearest(stamps[order], rows[:, side]) for side in (0, 1)]
    used = (ends[0][1] <= tolerance_s) & (ends[1][1] <= tolerance_s)
    first, second = (order[place[used]].astype(np.int64) for place, _ in ends)
    return Relations(first, second, rows[used][:, [2, 3, 7]])


def _nearest(stamps: Float64Array, wanted: Float64Array) -> tuple[Int64Array, Float64Array]:
    after = np.clip(np.searchsorted(stamps, wanted), 0, stamps.size - 1)
    before = np.maximum(after - 1, 0)
    place = np.where(wanted - stamps[before] < np.abs(stamps[after] - wanted), before, after)
    return place.astype(np.int64), np.abs(stamps[place] - wanted)


def _moves(first: Float64Array, second: Float64Array) -> Float64Array:
    dx, dy = (second - first)[:, :2].T
    cosine, sine = np.cos(first[:, 2]), np.sin(first[:, 2])
    turn = _wrapped(second[:, 2] - first[:, 2])
    return np.stack((cosine * dx + sine * dy, cosine * dy - sine * dx, turn), axis=1)


def _wrapped(angle: Float64Array) -> Float64Array:
    wrapped: Float64Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped
