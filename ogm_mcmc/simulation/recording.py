"""Walk, measure, record."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.simulation.exploration import Exploration, explore
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.lidar import Lidar
from ogm_mcmc.simulation.sonar import SonarRing
from ogm_mcmc.simulation.trajectories import walk
from ogm_mcmc.simulation.worlds import Building

__all__ = [
    'record',
    'record_exploration',
    'record_exploration_with_sonars',
    'record_with_sonars',
]

PERIOD_S = 0.1
SPEED_M_S = 0.8
TURN_RAD_S = 1.2
START_NS = 1_000_000_000
STANDING_S = 1.0


def record(
    building: Building, lidar: Lidar, rng: np.random.Generator, *, frame_id: str = 'laser'
) -> Iterator[PlacedScan]:
    """Yield a scan every 0.1 s of a walk along the building's waypoints."""
    for stamp_ns, pose in _walked(building):
        ranges = lidar.measure(building.walls, pose, rng)
        yield PlacedScan.at(lidar.scan(ranges, stamp_ns, frame_id), pose)


def record_with_sonars(
    building: Building, ring: SonarRing, rng: np.random.Generator
) -> Iterator[PlacedScan]:
    """Yield a reading of every sonar, all at once, every 0.1 s of the same walk."""
    for stamp_ns, pose in _walked(building):
        yield from ring.measure(building, pose, rng, stamp_ns)


def record_exploration(
    world: GridWorld,
    lidar: Lidar,
    settings: Exploration,
    rng: np.random.Generator,
    *,
    depth: float = 0.5,
    frame_id: str = 'laser',
) -> Iterator[PlacedScan]:
    """Yield a scan from every stop of a robot that explores a grid; stamps are when it stands."""
    # The noise has a source of its own: with other noise the robot still goes the same way.
    noise = rng.spawn(1)[0]
    bearings = lidar.bearings()
    for stamp_ns, pose in _explored(world, settings, rng):
        exact = world.ranges(pose, bearings, lidar.range_max_m, depth)
        yield PlacedScan.at(lidar.scan(lidar.observe(exact, noise), stamp_ns, frame_id), pose)


def record_exploration_with_sonars(
    world: GridWorld,
    ring: SonarRing,
    settings: Exploration,
    rng: np.random.Generator,
    *,
    depth: float = 0.5,
) -> Iterator[PlacedScan]:
    """Yield a reading of every sonar from every stop; with the same reach the lidar's stops."""
    noise = rng.spawn(1)[0]
    for stamp_ns, pose in _explored(world, settings, rng):
        yield from ring.measure(world, pose, noise, stamp_ns, depth=depth)


def _walked(building: Building) -> Iterator[tuple[int, Pose2D]]:
    """Yield stamp and pose, every 0.1 s."""
    poses = walk(building.waypoints, period_s=PERIOD_S, speed_m_s=SPEED_M_S, turn_rad_s=TURN_RAD_S)
    for index, pose in enumerate(poses):
        yield START_NS + round(index * PERIOD_S * 1e9), pose


def _explored(
    world: GridWorld, settings: Exploration, rng: np.random.Generator
) -> Iterator[tuple[int, Pose2D]]:
    """Yield stamp and pose of every stop."""
    time_s = 0.0
    for stop in explore(world, settings, rng):
        time_s += STANDING_S + (len(stop.way) - 1) * world.spec.resolution_m / SPEED_M_S
        yield START_NS + round(time_s * 1e9), stop.pose
