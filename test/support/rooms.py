"""A room of straight walls and scans of it, for what moves poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.simulation.lidar import true_ranges
from ogm_mcmc.trajectory.moves import composed, relative_poses
from ogm_mcmc.trajectory.points import poses_of

__all__ = ['ROOM', 'drifted', 'noisy_drive', 'path_through', 'scans_at_times', 'scans_of']

# Walls (W, 4), m: a room of 6 x 4 m with a wall standing into it and a box.
ROOM = np.array(
    [
        (0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0), (3.5, 0, 3.5, 1.5),
        (1, 3, 1.6, 3), (1.6, 3, 1.6, 3.4), (1.6, 3.4, 1, 3.4), (1, 3.4, 1, 3),
    ],
    np.float64,
)  # fmt: skip


def path_through(count: int) -> Float64Array:
    """Return poses (count, 3) along a bow through the room."""
    share = np.linspace(0.0, 1.0, count)
    return np.column_stack((1.0 + 4.0 * share, 2.2 + 0.3 * np.sin(6.0 * share), 0.5 - share))


def drifted(poses: Float64Array, error: Sequence[float]) -> Float64Array:
    """Return poses (K, 3) as odometry has them whose every step errs alike, m, m and rad."""
    found = poses.copy()
    for k, move in enumerate(relative_poses(poses[:-1], poses[1:]) + np.asarray(error)):
        found[k + 1] = composed(found[k], move)
    return found


def scans_of(poses: Float64Array, beams: int, noise_m: float, seed: int = 0) -> list[Scan]:
    """Return full turns of a lidar at the poses (K, 3)."""
    rng = np.random.default_rng(seed)
    bearings: Float64Array = -np.pi + 2.0 * np.pi / beams * np.arange(beams, dtype=np.float64)
    return [
        Scan.checked(
            true_ranges(ROOM, Pose2D(x, y, yaw), bearings) + noise_m * rng.standard_normal(beams),
            angle_min_rad=-np.pi,
            angle_increment_rad=2.0 * np.pi / beams,
            range_min_m=0.0,
            range_max_m=20.0,
        )
        for x, y, yaw in poses
    ]


def noisy_drive(
    noise: Sequence[float] = (0.06, 0.06, 0.03),
) -> tuple[Float64Array, list[PlacedScan]]:
    """Return 16 true poses, and scans of the room placed where a poor localizer puts them.

    Its walls run through the middle of cells of 0.1 m.
    """
    truth = path_through(16)
    off = truth + np.random.default_rng(4).normal(size=truth.shape) * noise
    scans = scans_of(truth, 180, 0.01)
    for poses in (truth, off):
        poses[:, :2] += 0.05
    covariance = np.diag(np.square(noise))
    placed = [
        PlacedScan(replace(scan, stamp_ns=k), PoseBelief(pose, covariance))
        for k, scan, pose in zip(range(1, 17), scans, poses_of(off), strict=True)
    ]
    return truth, placed


def scans_at_times(
    poses: Float64Array, beams: int, noise_m: float, step_s: float, seconds: Sequence[float]
) -> list[Scan]:
    """Return scans at the poses (K, 3), `step_s` apart, whose beams are taken one by one.

    seconds  between the turns of even and odd beams, and from the first beam to the last; the
             robot is at a pose in the middle
    """
    times = step_s * np.arange(len(poses))
    half, last = 0.5, max(beams - 1, 1)
    rng = np.random.default_rng(5)
    scans = []
    for scan, time in zip(scans_of(poses, beams, 0.0), times, strict=True):
        for i, bearing in enumerate(scan.bearings()):
            at = time + (i % 2 - half) * seconds[0] + (i / last - half) * seconds[1]
            pose = Pose2D(*(_between(at, times, axis) for axis in poses.T))
            scan.ranges_m[i] = true_ranges(ROOM, pose, np.array([bearing]))[0]
        scan.ranges_m[:] += noise_m * rng.standard_normal(beams)
        scans.append(scan)
    return scans


def _between(at: float, times: Float64Array, values: Float64Array) -> float:
    """Return a value at a time, beyond either end as it went there."""
    k = int(np.clip(np.searchsorted(times, at) - 1, 0, len(times) - 2))
    share = (at - times[k]) / (times[k + 1] - times[k])
    return float(values[k] + share * (values[k + 1] - values[k]))
