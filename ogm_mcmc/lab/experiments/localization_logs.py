"""Logs to localize in: recorded and simulated, with odometry and with poses to judge by.

`intel` has the odometry of its own wheels, `freiburg` none that is raw: there, and in the
generated buildings, it is simulated. Recorded logs are judged by joint poses of all their scans
(`ogm_mcmc.trajectory`; beams count as taken at once), buildings by the truth. Joint poses take a
minute or two: they are estimated once (`reference_of`) for all runs of a log.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.lab.experiments.joint_intel import intel_folder, read_recorded, read_stamps
from ogm_mcmc.lab.experiments.recordings import as_scan, data_folder
from ogm_mcmc.simulation import (
    Driving,
    Exploration,
    Lidar,
    OdometryNoise,
    drive,
    explore,
    generate_floor,
    motion_between,
    tour_of,
)
from ogm_mcmc.trajectory import TrajectoryRefinement
from ogm_mcmc.trajectory.points import poses_of, xyyaw

__all__ = [
    'DRIVING',
    'INTEL_WHEELS',
    'LIDAR',
    'LOGS',
    'MOST_SCANS',
    'RECORDED',
    'Log',
    'check_data',
    'log_of',
    'reference_of',
]

LOGS = ('building-1', 'building-5', 'building-9', 'freiburg', 'intel')
RECORDED = ('freiburg', 'intel')

# Poses x, y, yaw (K, 3), as JSON has them.
Poses = Sequence[Sequence[float]]

# What Intel's wheels do: 0.06 rad a metre to one side, twice that scatter on the way.
INTEL_WHEELS = OdometryNoise(turn_per_rad=0.1, turn_per_m=0.06, way_per_m=0.06, way_per_rad=0.06)

FREIBURG = Path('carmen') / 'freiburg-101-corrected.log.gz'

LIDAR = Lidar(180, range_max_m=10.0, noise_m=0.03, clutter=0.02)
DRIVING = Driving(rate_hz=2.0, drift=1.0)
MOST_SCANS = 300


class Log(NamedTuple):
    """Scans in the order of time, poses (K, 3) of the sensor, and where odometry says it was.

    `noise` is what a localizer is told of the wheels.
    """

    scans: list[Scan]
    reference: Float64Array
    odometry: Float64Array
    noise: OdometryNoise
    resolution_m: float

    def first(self, most: int | None) -> Log:
        """Return the log up to so many scans; None: all of it."""
        reference, odometry = self.reference[:most], self.odometry[:most]
        return self._replace(scans=self.scans[:most], reference=reference, odometry=odometry)

    def placed(self, chosen: slice) -> list[PlacedScan]:
        """Return some scans at their poses."""
        pairs = zip(self.scans[chosen], poses_of(self.reference[chosen]), strict=True)
        return [PlacedScan.at(scan, pose) for scan, pose in pairs]


def log_of(name: str, seed: int, reference: Poses | None = None) -> Log:
    """Return a log of `LOGS`, or of any building. Raises ConfigError without its data.

    `reference`: what `reference_of` told of a recorded one; without it, it is estimated here.
    """
    return _log_of(name, seed, None if reference is None else tuple(map(tuple, reference)))


@lru_cache(maxsize=len(LOGS))
def _log_of(name: str, seed: int, reference: tuple[tuple[float, ...], ...] | None) -> Log:
    if name not in RECORDED:
        return _building(int(name.removeprefix('building-')), seed)
    scans, given = _recorded(name)
    poses = _joint(scans, given, seed) if reference is None else np.array(reference)
    if name == 'intel':
        told = read_stamps(intel_folder())[:, 2:5]
        return Log(scans, poses, told, INTEL_WHEELS, 0.05)
    return Log(scans, poses, _wheels(poses, seed), OdometryNoise(), 0.05)


def reference_of(log: str, seed: int) -> dict[str, Any]:
    """Return the joint poses (K, 3) of all scans of a recorded log, as lists: `poses`."""
    return {'poses': _joint(*_recorded(log), seed).tolist()}


def check_data(names: Sequence[str]) -> None:
    """Look whether what logs are made of is there. Raises ConfigError where it is not."""
    if 'intel' in names:
        intel_folder()
    if 'freiburg' in names:
        _freiburg_file()


def _freiburg_file() -> Path:
    expected = 'OGM_MCMC_DATA to name a folder with the corrected log (Radish): {path}'
    return data_folder(FREIBURG, expected) / FREIBURG


def _recorded(name: str) -> tuple[list[Scan], Float64Array]:
    """Return the scans of a recorded log and the poses (K, 3) that came with them."""
    if name == 'intel':
        recorded = read_recorded(intel_folder())
        scans = [_silent(recorded.scans[k]) for k in recorded.order]
        return scans, recorded.given[recorded.order]
    logged = read_carmen(_freiburg_file()).scans
    return [_silent(as_scan(one)) for one in logged], xyyaw([one.laser_pose for one in logged])


def _silent(scan: Scan) -> Scan:
    """Return a scan in which no return says nothing: a SICK means many things by it."""
    return replace(scan, ranges_m=np.where(np.isinf(scan.ranges_m), np.nan, scan.ranges_m))


def _joint(scans: Sequence[Scan], given: Float64Array, seed: int) -> Float64Array:
    """Return the poses that all scans agree on best."""
    placed = [
        (scan, PoseBelief(pose, None)) for scan, pose in zip(scans, poses_of(given), strict=True)
    ]
    refinement = TrajectoryRefinement(placed, TrajectoryConfig(seed=seed))
    for _ in refinement.run():
        pass
    return refinement.poses


def _wheels(reference: Float64Array, seed: int) -> Float64Array:
    """Return what wheels would have said of a way, from where it begins."""
    rng, noise = np.random.default_rng((seed, 1)), OdometryNoise()
    poses = poses_of(reference)
    told = [poses[0]]
    for before, after in itertools.pairwise(poses):
        told.append(noise.measured(motion_between(before, after), rng).applied(told[-1]))
    return xyyaw(told)


def _building(number: int, seed: int) -> Log:
    """Drive through a building; a scan for every half metre, or half a radian, of the way."""
    world = generate_floor(number, seed)
    rng = np.random.default_rng((seed, number))
    reach = LIDAR.range_max_m / world.spec.resolution_m
    tour = tour_of(world, explore(world, Exploration(reach=reach), rng))
    bearings = LIDAR.bearings()

    def measure(pose: Pose2D) -> Float64Array:
        return world.ranges(pose, bearings, LIDAR.range_max_m)

    kept = []
    for one in drive(measure, tour, LIDAR, DRIVING, rng):
        if one.is_node:
            kept.append(one)
        if len(kept) == MOST_SCANS:
            break
    return Log(
        [one.scan for one in kept],
        xyyaw([one.truth for one in kept]),
        xyyaw([one.odometry for one in kept]),
        OdometryNoise(),
        world.spec.resolution_m,
    )
