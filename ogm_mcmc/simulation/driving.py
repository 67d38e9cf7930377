"""A robot that drives all the time and scans as often as its lidar turns.

It goes round a tour, again and again, and scans while it moves. Its odometry drifts. What a SLAM
system on it would say of its poses is either the truth, or odometry until the robot is back where
it began: then a loop closes, later poses hang on to the true place, and the corrected poses of
all nodes so far are told.

The drift does not depend on how often odometry is read: the errors of wheels (too large, too
small, not parallel) hold for a while and then change, here every second.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import Pose2D, Scan, wrap_angle
from ogm_mcmc.simulation.exploration import Stop
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.lidar import Lidar
from ogm_mcmc.simulation.odometry import Motion, OdometryNoise, motion_between
from ogm_mcmc.simulation.recording import START_NS
from ogm_mcmc.simulation.trajectories import walk

__all__ = ['DrivenScan', 'Driving', 'Nodes', 'drive', 'tour_of']

HOLDING_S = 1.0  # so long the wheels err in the same way

# As slam_toolbox: minimum_travel_distance, minimum_travel_heading.
NODE_EVERY_M = 0.5
NODE_EVERY_RAD = 0.5

# A way of an exploring robot is followed from every so many-th cell to the next.
LEG_CELLS = 4

MeasureExactly = Callable[[Pose2D], Float64Array]


@dataclass(frozen=True)
class Driving:
    """How a robot drives; `duration_s` 0: one tour. It stands `stand_s` at every waypoint.

    `drift`: the errors of odometry, as a share of those of `OdometryNoise`. `drifting`: poses are
    wrong until a loop closes.
    """

    rate_hz: float = 10.0
    speed_m_s: float = 0.8
    turn_rad_s: float = 1.2
    duration_s: float = 0.0
    stand_s: float = 0.0
    drift: float = 0.1
    drifting: bool = False

    def __post_init__(self) -> None:
        """Refuse what no robot does."""
        for name in ('rate_hz', 'speed_m_s', 'turn_rad_s'):
            value = getattr(self, name)
            require(0.0 < value < math.inf, name, value, 'must be positive')
        for name in ('duration_s', 'stand_s', 'drift'):
            value = getattr(self, name)
            require(0.0 <= value < math.inf, name, value, 'expected 0 or more')


class Nodes(NamedTuple):
    """Corrected poses of the robot and their stamps, ns, as a SLAM system tells them."""

    stamps_ns: tuple[int, ...]
    poses: tuple[Pose2D, ...]


class DrivenScan(NamedTuple):
    """A scan, the robot's true pose, where odometry leads (from its own origin), what SLAM says.

    The robot goes at `speed_m_s` and turns at `turn_rad_s`. `is_node`: the SLAM system keeps this
    pose in its graph. `corrected`: what it says of all nodes now that a loop was closed.
    """

    scan: Scan
    truth: Pose2D
    odometry: Pose2D
    said: Pose2D
    speed_m_s: float
    turn_rad_s: float
    is_node: bool
    corrected: Nodes | None


def tour_of(world: GridWorld, stops: Iterable[Stop]) -> Float64Array:
    """Return the waypoints (W, 2), m, of the ways between stops, there and back."""
    spec = world.spec
    points: list[tuple[float, float]] = []
    for stop in stops:
        for column, row in stop.way[LEG_CELLS:-1:LEG_CELLS]:
            points.append(
                (
                    spec.origin_x_m + (column + 0.5) * spec.resolution_m,
                    spec.origin_y_m + (row + 0.5) * spec.resolution_m,
                )
            )
        points.append((stop.pose.x_m, stop.pose.y_m))
    kept = [point for point, _ in itertools.groupby(points)]
    return np.array(kept + kept[-2::-1], np.float64)


def drive(
    measure: MeasureExactly,
    tour: Float64Array,
    lidar: Lidar,
    driving: Driving,
    rng: np.random.Generator,
    *,
    frame_id: str = 'laser',
) -> Iterator[DrivenScan]:
    """Yield a scan every 1 / rate seconds of a tour (W, 2) that ends where it begins, or turns.

    `measure` gives the exact ranges (B,) from a pose. Nothing is kept but the nodes.
    """
    scan_noise, wheel_noise = rng.spawn(2)
    wheels = _Wheels(driving, wheel_noise)
    period_ns = 1e9 / driving.rate_hz
    map_from_odom, last, node = Pose2D(), None, None
    nodes: list[tuple[int, Pose2D]] = []
    for index, (truth, closed) in enumerate(_poses(tour, driving)):
        stamp_ns = START_NS + round(index * period_ns)
        motion = motion_between(last or truth, truth)
        odometry = wheels.turned(motion, stamp_ns)
        if last is None or closed or not driving.drifting:
            map_from_odom = truth.compose(odometry.inverse())
        is_node = node is None or closed or _far(node, truth)
        if is_node:
            node = truth
            nodes.append((stamp_ns, truth))
        turn_rad_s = (motion.first_turn_rad + motion.second_turn_rad) * driving.rate_hz
        yield DrivenScan(
            lidar.scan(lidar.observe(measure(truth), scan_noise), stamp_ns, frame_id),
            truth,
            odometry,
            map_from_odom.compose(odometry) if driving.drifting else truth,
            motion.way_m * driving.rate_hz,
            turn_rad_s,
            is_node,
            Nodes(*zip(*nodes, strict=True)) if closed else None,
        )
        last = truth


def _poses(tour: Float64Array, driving: Driving) -> Iterator[tuple[Pose2D, bool]]:
    """Yield poses, and whether a tour ends there."""
    poses = _endless(tour, driving)
    if driving.duration_s > 0.0:
        yield from itertools.islice(poses, max(1, round(driving.duration_s * driving.rate_hz)))
        return
    for pose, closed in poses:
        yield pose, closed
        if closed:
            return


def _endless(tour: Float64Array, driving: Driving) -> Iterator[tuple[Pose2D, bool]]:
    there_and_back = np.concatenate((tour, tour[-2::-1]))
    whole = tour if np.array_equal(tour[0], tour[-1]) else there_and_back
    standing = round(driving.stand_s * driving.rate_hz)
    yaw = None
    while True:
        at = 0
        steps = walk(
            whole,
            period_s=1.0 / driving.rate_hz,
            speed_m_s=driving.speed_m_s,
            turn_rad_s=driving.turn_rad_s,
            yaw_rad=yaw,
        )
        last = next(steps)
        if yaw is None:
            yield last, False
        for pose in steps:
            yield pose, False
            last = pose
            if math.hypot(pose.x_m - whole[at + 1][0], pose.y_m - whole[at + 1][1]) < 1e-6:
                at += 1
                yield from itertools.repeat((pose, False), standing)
        yield last, True
        yaw = last.yaw_rad


class _Wheels:
    """Odometry from its own origin, with errors that change every second."""

    def __init__(self, driving: Driving, rng: np.random.Generator) -> None:
        self.drift, self.rng = driving.drift, rng
        self.noise = OdometryNoise()
        self.pose = Pose2D()
        self._errors = np.zeros(4)
        self._until_ns = 0

    def turned(self, motion: Motion, stamp_ns: int) -> Pose2D:
        """Return where a true motion leads by the wheels."""
        if stamp_ns >= self._until_ns:
            self._errors = self.drift * self.rng.standard_normal(4)
            self._until_ns = stamp_ns + round(HOLDING_S * 1e9)
        turn, turn_per_m, way, way_per_rad = self._errors
        noise, gone = self.noise, motion.way_m
        turned = abs(motion.first_turn_rad) + abs(motion.second_turn_rad)
        wrong = Motion(
            motion.first_turn_rad * (1.0 + turn * noise.turn_per_rad),
            gone * (1.0 + way * noise.way_per_m) + way_per_rad * noise.way_per_rad * turned,
            motion.second_turn_rad * (1.0 + turn * noise.turn_per_rad)
            + turn_per_m * noise.turn_per_m * gone,
        )
        self.pose = wrong.applied(self.pose)
        return self.pose


def _far(node: Pose2D, pose: Pose2D) -> bool:
    way = math.hypot(pose.x_m - node.x_m, pose.y_m - node.y_m)
    turn = abs(wrap_angle(pose.yaw_rad - node.yaw_rad))
    return way >= NODE_EVERY_M or turn >= NODE_EVERY_RAD
