"""What scans saw, as points in the frames of their sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import Pose2D, Scan

__all__ = ['ScanPoints', 'beam_parts', 'poses_of', 'wrapped', 'xyyaw']


class ScanPoints(NamedTuple):
    """N end points of the beams of K scans that returned.

    `local` (N, 2), m, in the frame of the sensor; scan k owns rows `starts[k]` to `starts[k + 1]`
    (K + 1,) of it, and `scan` (N,) says which that is. `part` (N, 2): when the beam was taken, see
    `ogm_mcmc.trajectory.beam_times`; of no row where that is not asked for.
    """

    local: Float64Array
    scan: Int64Array
    starts: Int64Array
    part: Float64Array = np.zeros((0, 2))

    @property
    def n_scans(self) -> int:
        """Number of scans, K."""
        return int(self.starts.size - 1)

    @classmethod
    def of(cls, scans: Sequence[Scan], max_range_m: float = 0.0) -> ScanPoints:
        """Return the points of scans; those further away than `max_range_m` are left out.

        0 is the sensor's own range. Raises WindowError where no beam returned at all.
        """
        used = [_used(scan, max_range_m) for scan in scans]
        counts = np.array([np.count_nonzero(one) for one in used], np.int64)
        if counts.sum() == 0:
            raise WindowError(f'no beam of {len(scans)} scans returned: nothing to align')
        starts = np.concatenate((np.zeros(1, np.int64), np.cumsum(counts)))
        scan = np.repeat(np.arange(counts.size), counts)
        local = np.concatenate([_points_of(*one) for one in zip(scans, used, strict=True)])
        part = np.concatenate([beam_parts(np.flatnonzero(one), one.size) for one in used])
        return cls(local, scan.astype(np.int64), starts, part)

    def placed(self, poses: Float64Array) -> Float64Array:
        """Return the points (N, 2) in the map, m, given the sensor poses (K, 3)."""
        at = poses[self.scan]
        cosine, sine = np.cos(at[:, 2]), np.sin(at[:, 2])
        x, y = self.local.T
        placed: Float64Array = at[:, :2] + np.stack(
            (cosine * x - sine * y, sine * x + cosine * y), axis=1
        )
        return placed


def beam_parts(beams: AnyArray, count: int) -> Float64Array:
    """Return by how much beams (N,) of `count` follow the middle of a scan (N, 2).

    In parts of what lies between the turns of even and odd beams, and of a whole sweep: see
    `ogm_mcmc.trajectory.beam_times`.
    """
    odd = np.asarray(beams) % 2 - 0.5
    return np.stack((odd, np.asarray(beams) / max(count - 1, 1) - 0.5), axis=1)


def _used(scan: Scan, max_range_m: float) -> BoolArray:
    reach = scan.range_max_m if max_range_m <= 0.0 else min(scan.range_max_m, max_range_m)
    return scan.measured() & (scan.ranges_m.astype(np.float64) <= reach)


def _points_of(scan: Scan, used: BoolArray) -> Float64Array:
    ranges = scan.ranges_m[used].astype(np.float64)
    points: Float64Array = (scan.directions()[:, used] * ranges).T
    return points


def xyyaw(poses: Sequence[Pose2D]) -> Float64Array:
    """Return poses as (K, 3): x and y, m, yaw, rad."""
    return np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in poses], np.float64)


def poses_of(poses: AnyArray) -> list[Pose2D]:
    """Return the poses of rows x, y, yaw."""
    return [Pose2D(float(x), float(y), float(yaw)) for x, y, yaw in wrapped(poses)]


def wrapped(values: AnyArray) -> Float64Array:
    """Return rows x, y, yaw with the yaw in [-pi, pi)."""
    result = np.array(values, np.float64)
    result[..., 2] = (result[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return result
