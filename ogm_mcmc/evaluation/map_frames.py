"""Where the frame of a map lies in that of beams that judge it.

A SLAM system begins its map where the robot stood, so a map of others is often moved and turned
against the poses of a bag. Looked for is the rigid motion under which beams fit the map best, by
the log-likelihood that judges maps: no truth is needed. Beams that fit must not judge.

`wall_matches` says where to look. From there the likelihood itself is climbed on lattices of
motions, first with a wide sigma, whose slopes a start some cells off still feels, at last with
that of the judge. Poses are moved, not the map: its cells are never resampled, so no map is
smoothed on the way. The best place that is another one is kept, too: a map that fits there as
well fits nowhere.

What was tried: 320 coarse cells across the map instead of 200, and 24 places instead of 12, find
the same frames in twice the time. Of statistics that tell right places from those of another
building, the gap in nats to the next place (0.08 to 7 and 0.0 to 0.3) and the share of beams that
tell (0.48 to 0.99 and 0.48 to 0.57) overlap where maps predict little; the share of scans is
clear-cut (docs/evaluation.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array
from ogm_mcmc.errors import GridError, require
from ogm_mcmc.evaluation.wall_matches import wall_matches
from ogm_mcmc.geometry import GridMap, PlacedScan, Pose2D, wrap_angle
from ogm_mcmc.mapping import ProbabilityBeams
from ogm_mcmc.sensors import ForwardModel

__all__ = ['FoundFrame', 'FrameSearch', 'find_frame', 'gain_near_by']

# Places that are looked at by the likelihood: so many at first, and after each level.
PLACES, LEFT = 12, (6, 4, 3)

# Beams, evenly from all scans: so many at first, and for the last two levels.
FIRST_BEAMS, LAST_BEAMS = 800, 4000

# A level ends when its middle is the best of the lattice, or after so many steps.
MOST_STEPS = 12

# The last step is so small a share of a cell.
LAST_STEP = 0.05

# Another place is so many coarse cells away, or turned by as much at a usual end of a beam.
ELSEWHERE = 3.0

# For a look near by: so many cells and rad to each side, and half of that.
NEAR_CELLS, NEAR_RAD = 4.0, 0.04

LATTICE = np.stack(np.meshgrid(*3 * [[0.0, -1.0, 1.0]], indexing='ij'), axis=-1).reshape(-1, 3)


@dataclass(frozen=True)
class FrameSearch:
    """How far the middle of the beams' ends may move, m (0: anywhere), and the map turn, rad."""

    reach_m: float = 0.0
    turn_rad: float = math.pi

    def __post_init__(self) -> None:
        """Refuse what is no range."""
        require(0.0 <= self.reach_m < math.inf, 'reach', self.reach_m, 'expected 0 m or more')
        inside = 0.0 <= self.turn_rad <= math.pi
        require(inside, 'turn', self.turn_rad, 'expected 0 to pi rad')

    def holds(self, moves: Float64Array) -> BoolArray:
        """Return which moves (M, 3) lie in the range: shifts m after turns rad."""
        near: BoolArray = np.ones(len(moves), np.bool_)
        if self.turn_rad < math.pi:
            near &= np.abs(moves[:, 2]) <= self.turn_rad
        if self.reach_m > 0.0:
            near &= np.hypot(moves[:, 0], moves[:, 1]) <= self.reach_m
        return near

    def drawn_in(self, moves: Float64Array) -> Float64Array:
        """Return moves (M, 3), those beyond the range set on its border."""
        inside = moves.copy()
        inside[:, 2] = np.clip(inside[:, 2], -self.turn_rad, self.turn_rad)
        if self.reach_m > 0.0:
            away = np.hypot(moves[:, 0], moves[:, 1])
            inside[:, :2] *= np.minimum(1.0, self.reach_m / np.maximum(away, 1e-9))[:, np.newaxis]
        return inside


class FoundFrame(NamedTuple):
    """The pose of a map's frame in that of the beams, and nats a beam of those that fitted it.

    `nats` there, `as_given` with both frames the same. `elsewhere` is the best place that is
    another one, None where there was none.
    """

    frame: Pose2D
    nats: float
    as_given: float
    elsewhere: Pose2D | None


def find_frame(
    grid_map: GridMap,
    placed: Sequence[PlacedScan],
    model: ForwardModel,
    *,
    prior: float,
    search: FrameSearch,
) -> FoundFrame:
    """Return where a map lies so that scans, at the means of their beliefs, fit it best.

    Cells that the map does not know are occupied with probability `prior`. Of a model that is not
    `plain`, short returns count as hits. Raises GridError where no beam returned.
    """
    ends = _ends(placed)
    if len(ends) == 0:
        raise GridError(f'no beam of {len(placed)} scans returned: expected some to fit a map by')
    plain = _plain(model)
    looked = wall_matches(grid_map, ends, search.reach_m, search.turn_rad, PLACES)
    middle = ends.mean(axis=0)
    per_m = looked.turn_rad / looked.cell_m
    few, many = _Beams.some(placed, FIRST_BEAMS), _Beams.some(placed, LAST_BEAMS)
    moves = np.vstack((np.zeros(3), search.drawn_in(looked.moves)))
    sigmas = _halved(looked.cell_m, model.sigma_m)
    for level, sigma in enumerate(sigmas):
        fit = ProbabilityBeams(grid_map, plain._replace(sigma_m=sigma), prior)
        beams = few if level < len(sigmas) - 2 else many
        moves, nats = _climbed(fit, beams, moves, middle, sigma / 2.0, per_m, search)
        moves, nats = _distinct(
            moves, nats, ELSEWHERE * looked.cell_m, per_m, LEFT[min(level, len(LEFT) - 1)]
        )
    fit = ProbabilityBeams(grid_map, plain, prior)
    cell = grid_map.spec.resolution_m
    for step in _halved(min(model.sigma_m, cell) / 4.0, LAST_STEP * cell):
        moves, nats = _climbed(fit, many, moves, middle, step, per_m, search)
    moves, nats = _distinct(moves, nats, ELSEWHERE * looked.cell_m, per_m, 2)
    as_given = float(many.nats(fit, np.zeros((1, 3)))[0])
    frames = [Pose2D(x, y, wrap_angle(yaw)) for x, y, yaw in _frames(moves, middle).tolist()]
    if nats[0] <= as_given:
        frames[0], nats[0] = Pose2D(), as_given
    return FoundFrame(frames[0], float(nats[0]), as_given, frames[1] if len(frames) > 1 else None)


def gain_near_by(
    grid_map: GridMap, placed: Sequence[PlacedScan], model: ForwardModel, *, prior: float
) -> float:
    """Return how many nats a beam a map gains when it is moved and turned a little, at least 0.

    A quick look by some beams, at 125 places within four cells and 2.3 degrees.
    """
    beams = _Beams.some(placed, FIRST_BEAMS)
    ends = _ends(placed)
    if beams.beams == 0 or len(ends) == 0:
        return 0.0
    fit = ProbabilityBeams(grid_map, _plain(model), prior)
    steps = np.array([0.0, -1.0, -0.5, 0.5, 1.0])
    around = np.stack(np.meshgrid(steps, steps, steps, indexing='ij'), axis=-1).reshape(-1, 3)
    shift = NEAR_CELLS * grid_map.spec.resolution_m
    frames = _frames(around * (shift, shift, NEAR_RAD), ends.mean(axis=0))
    nats = beams.nats(fit, frames)
    return float(nats.max() - nats[0])


def _plain(model: ForwardModel) -> ForwardModel:
    return model._replace(is_gaussian=False, hit=model.hit + model.short, short=0.0)


def _ends(placed: Sequence[PlacedScan]) -> Float64Array:
    """Return where the beams of scans ended (N, 2), m."""
    ends = [np.empty((0, 2))]
    for one in placed:
        returned = one.scan.measured()
        ranges = one.scan.ranges_m[returned].astype(np.float64)
        ends.append(np.ascontiguousarray(one.along(returned, ranges).T))
    return np.concatenate(ends)


class _Beams(NamedTuple):
    """Beams of scans: of each the sensor's pose (3,), bearings (B,), ranges (B,), its reach."""

    scans: list[tuple[Float64Array, Float64Array, Float64Array, float]]
    beams: int

    @classmethod
    def some(cls, placed: Sequence[PlacedScan], most: int) -> _Beams:
        """Return about so many beams, evenly from all scans and all directions."""
        total = sum(int(np.count_nonzero(scan.informative())) for scan, _ in placed)
        every = max(1, round(total / most))
        scans, kept, before = [], 0, 0
        for scan, belief in placed:
            informative = np.flatnonzero(scan.informative())
            beams = informative[-before % every :: every]
            before += informative.size
            if beams.size == 0:
                continue
            mean = belief.mean
            pose = np.array([mean.x_m, mean.y_m, mean.yaw_rad])
            ranges = scan.ranges_m[beams].astype(np.float64)
            scans.append((pose, scan.bearings()[beams], ranges, scan.range_max_m))
            kept += beams.size
        return cls(scans, kept)

    def nats(self, fit: ProbabilityBeams, frames: Float64Array) -> Float64Array:
        """Return nats a beam (M,) with the map's frame at poses (M, 3)."""
        cosine, sine = np.cos(frames[:, 2]), np.sin(frames[:, 2])
        total = np.zeros(len(frames))
        for pose, bearings, ranges, reach in self.scans:
            x, y = (pose[:2] - frames[:, :2]).T
            seen = (cosine * x + sine * y, cosine * y - sine * x, pose[2] - frames[:, 2])
            total += fit.log_likelihoods(np.stack(seen, axis=1), bearings, ranges, reach)
        return total / self.beams


def _frames(moves: Float64Array, middle: Float64Array) -> Float64Array:
    """Return frames (M, 3) of maps turned about a middle (2,) and then shifted: moves (M, 3)."""
    cosine, sine = np.cos(moves[:, 2]), np.sin(moves[:, 2])
    x = moves[:, 0] + middle[0] - (cosine * middle[0] - sine * middle[1])
    y = moves[:, 1] + middle[1] - (sine * middle[0] + cosine * middle[1])
    return np.stack((x, y, moves[:, 2]), axis=1)


def _halved(first: float, last: float) -> list[float]:
    """Return lengths from the first on, each half of the one before, down to the last."""
    halvings = max(0, math.ceil(math.log2(first / last) - 1e-9))
    return [max(first / 2**k, last) for k in range(halvings + 1)]


def _climbed(
    fit: ProbabilityBeams,
    beams: _Beams,
    moves: Float64Array,
    middle: Float64Array,
    step_m: float,
    rad_per_m: float,
    search: FrameSearch,
) -> tuple[Float64Array, Float64Array]:
    """Return moves (M, 3) after steps to the best neighbour each, and their nats a beam (M,).

    None of them leaves the range of the search.
    """
    moves = moves.copy()
    nats = np.full(len(moves), -np.inf)
    climbing = np.arange(len(moves))
    for _ in range(MOST_STEPS):
        tried = moves[climbing, np.newaxis] + step_m * LATTICE * (1.0, 1.0, rad_per_m)
        places = tried.reshape(-1, 3)
        inside = search.holds(places)
        inside[:: len(LATTICE)] = True  # where it is, but for rounding
        each = np.full(len(places), -np.inf)
        each[inside] = beams.nats(fit, _frames(places[inside], middle))
        found = each.reshape(len(climbing), -1)
        best = found.argmax(axis=1)  # of equal ones the first: the middle
        nats[climbing] = found.max(axis=1)
        moves[climbing] = tried[np.arange(len(climbing)), best]
        climbing = climbing[best > 0]
        if climbing.size == 0:
            break
    return moves, nats


def _distinct(
    moves: Float64Array, nats: Float64Array, far_m: float, rad_per_m: float, most: int
) -> tuple[Float64Array, Float64Array]:
    """Return the best moves, no two of them the same place, and their nats a beam."""
    kept: list[int] = []
    for one in np.argsort(-nats, kind='stable').tolist():
        off = moves[kept] - moves[one]
        turn = np.abs((off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi)
        if np.all((np.hypot(off[:, 0], off[:, 1]) > far_m) | (turn > far_m * rad_per_m)):
            kept.append(one)
        if len(kept) == most:
            break
    return moves[kept], nats[kept]
