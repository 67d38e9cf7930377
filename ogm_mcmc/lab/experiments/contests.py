"""The data sets of the leaderboard: four public logs, ten generated buildings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.geometry import GridMap, PlacedScan, Scan
from ogm_mcmc.io.carmen import LogScan, read_carmen
from ogm_mcmc.io.carmen_times import strictly_increasing
from ogm_mcmc.io.gmapping import best_trajectory
from ogm_mcmc.io.no_return import LaserRange, laser_range
from ogm_mcmc.lab.experiments.mappers import FOR_EXACT_POSES, FOR_PARTICLES
from ogm_mcmc.lab.experiments.pose_sim import CELL_M, FILTERS, localized
from ogm_mcmc.lab.experiments.recordings import data_folder
from ogm_mcmc.simulation import generate_floor

__all__ = ['LOGS', 'Contest', 'RecordedLog', 'building_contest', 'log_contest']

# The ten buildings, one run in each, with the good filter of `pose-sim`.
FILTER, RUN = 'good filter', 1

# Scans of one stamp of a log are taken as so far apart.
REPEAT_STEP_S = 0.1


class Contest(NamedTuple):
    """Scans at what a localizer believed, the same at the poses that judge, and the truth.

    `mappers`: who takes part with poses as they are.
    """

    believed: list[PlacedScan]
    judging: list[PlacedScan]
    truth: GridMap | None
    cell_m: float
    no_return: str
    mappers: tuple[str, ...]


@dataclass(frozen=True)
class RecordedLog:
    """A log with corrected poses: where it lies in the folder of the data, and whose it is."""

    file: str
    source: str

    def path(self) -> Path:
        """Return where it is; raises ConfigError where it is not."""
        expected = f'OGM_MCMC_DATA to name a folder with {self.file}'
        return data_folder(Path(self.file), expected) / self.file


LOGS = {
    'intel': RecordedLog('intel/intel.gfs.log', 'Intel Research Lab, Dirk Haehnel (Radish)'),
    'csail': RecordedLog('csail/csail.corrected.gfs', 'MIT CSAIL, Cyrill Stachniss (Radish)'),
    'belgioioso': RecordedLog(
        'carmen/belgioioso-corrected.log.gz', 'Belgioioso castle, Dirk Haehnel'
    ),
    'freiburg-101': RecordedLog(
        'carmen/freiburg-101-corrected.log.gz', 'Freiburg, building 101, Cyrill Stachniss'
    ),
}


def log_contest(name: str) -> Contest:
    """Read a log; its poses are those that its SLAM system came to.

    Those in the lines of a full GMapping log are raw odometry: there it is the trajectory of the
    best particle.
    """
    logged = read_carmen(LOGS[name].path()).scans
    first = [scan for scan in logged if scan.laser == logged[0].laser]
    with_particles = first[0].particles is not None
    poses = best_trajectory(first) if with_particles else [scan.laser_pose for scan in first]
    reach = laser_range(first)
    times = [scan.time_s for scan in first]
    order, stamps, _ = strictly_increasing(times, ['scan'] * len(first), REPEAT_STEP_S)
    placed = [
        PlacedScan.at(_as_scan(first[k], reach, stamp_ns), poses[k])
        for k, stamp_ns in zip(order, stamps, strict=True)
    ]
    return Contest(placed, placed, None, 0.05, 'ignore', FOR_EXACT_POSES)


def building_contest(name: str, seed: int) -> Contest:
    """Simulate a robot with a particle filter in `building-N`."""
    number = int(name.rsplit('-', 1)[1])
    world = generate_floor(number, seed)
    rng = np.random.default_rng((seed, number, RUN, 6))
    scans = localized(world, FILTERS[FILTER], rng)
    return Contest(
        [one.placed for one in scans],
        [PlacedScan.at(one.placed.scan, one.truth) for one in scans],
        world.truth(),
        CELL_M,
        'clear',
        FOR_PARTICLES,
    )


def _as_scan(logged: LogScan, reach: LaserRange, stamp_ns: int) -> Scan:
    ranges = np.where(reach.missing(logged.ranges_m), np.inf, logged.ranges_m)
    return Scan.checked(
        ranges,
        angle_min_rad=logged.start_angle_rad,
        angle_increment_rad=logged.increment_rad,
        range_min_m=0.0,
        range_max_m=reach.range_max_m,
        stamp_ns=stamp_ns,
        frame_id='laser',
    )
