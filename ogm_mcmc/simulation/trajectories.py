"""A robot that walks from point to point."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry import Pose2D, wrap_angle

__all__ = ['walk']


def walk(
    waypoints: Float64Array,
    *,
    period_s: float,
    speed_m_s: float,
    turn_rad_s: float,
    yaw_rad: float | None = None,
) -> Iterator[Pose2D]:
    """Yield a pose per period: turn on the spot towards the next point, then go straight.

    It looks at the second waypoint first, or has the heading `yaw_rad`.
    """
    x, y = map(float, waypoints[0])
    yaw = math.atan2(waypoints[1][1] - y, waypoints[1][0] - x) if yaw_rad is None else yaw_rad
    yield Pose2D(x, y, yaw)
    for target in waypoints[1:]:
        target_x, target_y = map(float, target)
        heading = math.atan2(target_y - y, target_x - x)
        while abs(turn := wrap_angle(heading - yaw)) > 1e-9:
            step = turn_rad_s * period_s
            yaw = heading if abs(turn) <= step else wrap_angle(yaw + math.copysign(step, turn))
            yield Pose2D(x, y, yaw)
        while (left := math.hypot(target_x - x, target_y - y)) > 1e-9:
            share = min(1.0, speed_m_s * period_s / left)
            x, y = x + share * (target_x - x), y + share * (target_y - y)
            yield Pose2D(x, y, yaw)
