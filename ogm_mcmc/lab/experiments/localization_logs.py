"""Logs to localize in: recorded and simulated, with odometry and with poses to judge by.

`intel` has the odometry of its own wheels, `freiburg` none that is raw: there, and in the
generated buildings, it is simulated. Recorded logs are judged by joint poses of all their scans
(`ogm_mcmc.trajectory`), buildings by the truth.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

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

__all__ = ['LOGS', 'Log', 'check_data', 'log_of']

LOGS = ('building-1', 'building-5', 'building-9', 'freiburg', 'intel')

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

    def placed(self, chosen: slice) -> list[PlacedScan]:
        """Return some scans at their poses."""
        pairs = zip(self.scans[chosen], poses_of(self.reference[chosen]), strict=True)
        return [PlacedScan.at(scan, pose) for scan, pose in pairs]


@lru_cache(maxsize=len(LOGS))
def log_of(name: str, seed: int) -> Log:
    """Return a log of `LOGS`, or of any building. Raises ConfigError without its data."""
    if name == 'intel':
        return _intel(seed)
    if name == 'freiburg':
        return _freiburg(seed)
    return _building(int(name.removeprefix('building-')), seed)


def check_data(names: Sequence[str]) -> None:
    """Look whether what logs are made of is there. Raises ConfigError where it is not."""
    if 'intel' in names:
        intel_folder()
    if 'freiburg' in names:
        _freiburg_file()


def _freiburg_file() -> Path:
    expected = 'OGM_MCMC_DATA to name a folder with the corrected log (Radish): {path}'
    return data_folder(FREIBURG, expected) / FREIBURG


def _intel(seed: int) -> Log:
    folder = intel_folder()
    recorded = read_recorded(folder)
    scans = [_silent(recorded.scans[k]) for k in recorded.order]
    reference = _joint(scans, recorded.given[recorded.order], seed)
    return Log(scans, reference, read_stamps(folder)[:, 2:5], INTEL_WHEELS, 0.05)


def _freiburg(seed: int) -> Log:
    logged = read_carmen(_freiburg_file()).scans
    scans = [_silent(as_scan(one)) for one in logged]
    reference = _joint(scans, xyyaw([one.laser_pose for one in logged]), seed)
    return Log(scans, reference, _wheels(reference, seed), OdometryNoise(), 0.05)


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
