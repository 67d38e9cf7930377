"""What a robot cannot have done between two poses."""

from __future__ import annotations

import math

from ogm_mcmc.geometry.pose import Pose2D, wrap_angle

__all__ = ['MAX_SPEED_M_S', 'MAX_TURN_RAD_S', 'jumps']

# Faster than any robot that carries a planar laser; a localizer that found its place again, or a
# bag with two robots in it, is faster still.
MAX_SPEED_M_S = 10.0
MAX_TURN_RAD_S = 10.0

# Stamps are taken when a message is made, some ms late: poses 0.02 m apart may be 1 ms apart.
# Steps as small as these are no jump however little time they take.
SLACK_M = 0.1
SLACK_RAD = 0.1


def jumps(
    earlier: Pose2D,
    later: Pose2D,
    apart_ns: int,
    max_speed_m_s: float = MAX_SPEED_M_S,
    max_turn_rad_s: float = MAX_TURN_RAD_S,
) -> bool:
    """Return whether a robot was set elsewhere, not driven, between two poses `apart_ns` apart.

    What lies between such poses are places where the robot never was. An infinite limit allows
    everything.
    """
    apart_s = apart_ns / 1e9
    way_m = math.hypot(later.x_m - earlier.x_m, later.y_m - earlier.y_m)
    turn_rad = abs(wrap_angle(later.yaw_rad - earlier.yaw_rad))
    return (
        way_m > SLACK_M + max_speed_m_s * apart_s
        or turn_rad > SLACK_RAD + max_turn_rad_s * apart_s
    )
