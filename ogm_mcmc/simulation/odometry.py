"""Noisy odometry: turn, go, turn.

The usual model of wheels: a motion is a turn towards the goal, a straight way and a turn to the
final heading, each with Gaussian noise whose variance grows with the squares of what was turned
and gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import Pose2D, wrap_angle

__all__ = ['Motion', 'OdometryNoise', 'motion_between']


class Motion(NamedTuple):
    """Turn, rad; go, m; turn, rad."""

    first_turn_rad: float
    way_m: float
    second_turn_rad: float

    def applied(self, pose: Pose2D) -> Pose2D:
        """Return where a robot at `pose` ends up."""
        heading = pose.yaw_rad + self.first_turn_rad
        return Pose2D(
            pose.x_m + self.way_m * math.cos(heading),
            pose.y_m + self.way_m * math.sin(heading),
            wrap_angle(heading + self.second_turn_rad),
        )


def motion_between(start: Pose2D, end: Pose2D) -> Motion:
    """Return the motion from one pose to another; on the spot, all of the turn comes first."""
    dx, dy = end.x_m - start.x_m, end.y_m - start.y_m
    way = math.hypot(dx, dy)
    if way < 1e-9:
        return Motion(wrap_angle(end.yaw_rad - start.yaw_rad), 0.0, 0.0)
    heading = math.atan2(dy, dx)
    return Motion(wrap_angle(heading - start.yaw_rad), way, wrap_angle(end.yaw_rad - heading))


@dataclass(frozen=True)
class OdometryNoise:
    """Standard deviations per unit: turning by turning and by going, going by both."""

    turn_per_rad: float = 0.05
    turn_per_m: float = 0.02
    way_per_m: float = 0.05
    way_per_rad: float = 0.02

    def __post_init__(self) -> None:
        """Refuse negative noise."""
        for name in ('turn_per_rad', 'turn_per_m', 'way_per_m', 'way_per_rad'):
            value = getattr(self, name)
            require(0.0 <= value < math.inf, name, value, 'expected 0 or more')

    def measured(self, motion: Motion, rng: np.random.Generator) -> Motion:
        """Return what odometry makes of a true motion."""
        return Motion(*(float(part[0]) for part in self.sampled(motion, 1, rng)))

    def sampled(
        self, motion: Motion, count: int, rng: np.random.Generator
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return `count` motions around one: first turns, ways and second turns (count,)."""
        turns = abs(motion.first_turn_rad), abs(motion.second_turn_rad)
        way = abs(motion.way_m)
        spread = (
            math.hypot(self.turn_per_rad * turns[0], self.turn_per_m * way),
            math.hypot(self.way_per_m * way, self.way_per_rad * math.hypot(*turns)),
            math.hypot(self.turn_per_rad * turns[1], self.turn_per_m * way),
        )
        noise = rng.standard_normal((3, count)) * np.array(spread)[:, None]
        return (
            motion.first_turn_rad + noise[0],
            motion.way_m + noise[1],
            motion.second_turn_rad + noise[2],
        )
