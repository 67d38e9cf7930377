"""Walk, measure, record."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.simulation.lidar import Lidar
from ogm_mcmc.simulation.trajectories import walk
from ogm_mcmc.simulation.worlds import Building

__all__ = ['SimulatedScan', 'record']

PERIOD_S = 0.1
SPEED_M_S = 0.8
TURN_RAD_S = 1.2
START_NS = 1_000_000_000


class SimulatedScan(NamedTuple):
    """A scan and the true pose it was taken at."""

    scan: Scan
    pose: Pose2D


def record(
    building: Building, lidar: Lidar, rng: np.random.Generator, *, frame_id: str = 'laser'
) -> Iterator[SimulatedScan]:
    """Yield a scan every 0.1 s of a walk along the building's waypoints."""
    poses = walk(building.waypoints, period_s=PERIOD_S, speed_m_s=SPEED_M_S, turn_rad_s=TURN_RAD_S)
    for index, pose in enumerate(poses):
        scan = Scan.checked(
            lidar.measure(building.walls, pose, rng),
            angle_min_rad=-np.pi,
            angle_increment_rad=lidar.angle_increment_rad,
            range_min_m=lidar.range_min_m,
            range_max_m=lidar.range_max_m,
            stamp_ns=START_NS + round(index * PERIOD_S * 1e9),
            frame_id=frame_id,
        )
        yield SimulatedScan(scan, pose)
