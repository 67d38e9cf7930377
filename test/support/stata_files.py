"""A synthetic PR2 bag and pose file of exactly the shape of those of the MIT Stata Center.

The laser `/base_scan`, 0.275 m ahead of the base, has 1040 beams 0.25 degrees apart and scans
every 25 ms. The pose file has poses of the laser in microseconds, one for every second scan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.simulation import true_ranges
from support.ros1_bags import write_ros1

__all__ = [
    'BEAMS',
    'LASER_X',
    'SCAN_US',
    'START_US',
    'STEP',
    'laser_poses',
    'write_pr2',
    'write_poses',
]

START_US = 1_327_678_621_454_971
SCAN_US = 25_000
LASER_X = 0.275
BEAMS, STEP = 1040, math.radians(0.25)


def laser_poses(bases: Sequence[Pose2D]) -> list[Pose2D]:
    """Poses of the laser for every second pose of the base."""
    return [base.compose(Pose2D(LASER_X)) for base in bases[::2]]


def write_pr2(
    path: Path,
    walls: Float64Array,
    bases: Sequence[Pose2D],
    *,
    scan_every: int = 1,
    noise_m: float = 0.0,
    seed: int = 1,
) -> None:
    """Write the ROS 1 bag of a robot whose base is at `bases`, one every 25 ms.

    `scan_every` keeps only every so many-th scan, to be quick; readings beyond 30 m are 60 m, as
    the driver writes them.
    """
    rng = np.random.default_rng(seed)
    bearings = STEP * np.arange(-0.5 * (BEAMS - 1), 0.5 * BEAMS, dtype=np.float64)

    def records() -> Iterator[tuple[str, int, Any]]:
        for k, base in enumerate(bases):
            stamp_ns = 1000 * (START_US + k * SCAN_US)
            stored = stamp_ns + 3_000_000
            if k % 4 == 0:
                odom = ros_types.odometry(stamp_ns, Pose2D(3.0).compose(base), 0.8, 0.1)
                yield '/base_odometry/odom', stored, odom
            if k % scan_every == 0:
                ranges = true_ranges(walls, base.compose(Pose2D(LASER_X)), bearings)
                ranges = ranges + noise_m * rng.standard_normal(BEAMS)
                scan = ros_types.laser_scan(
                    stamp_ns,
                    'base_laser_link',
                    np.where(ranges < 30.0, ranges, 60.0).astype(np.float32),
                    angle_min=float(bearings[0]),
                    angle_increment=STEP,
                    range_min=0.023,
                    range_max=30.0,
                    scan_time=0.025,
                )
                yield '/base_scan', stored, scan

    write_ros1(path, records())


def write_poses(path: Path, poses: Sequence[Pose2D], shift_us: int = 0) -> None:
    """Write a `.gt.laser.poses` file of poses 50 ms apart, `shift_us` late."""
    lines = [
        f'{START_US + 2 * k * SCAN_US + shift_us},{p.x_m:.6g},{p.y_m:.6g},{p.yaw_rad:.6g}\n'
        for k, p in enumerate(poses)
    ]
    path.write_text(''.join(lines), encoding='ascii')
