"""Messages of tf for bags."""

from __future__ import annotations

import math
from typing import Any

from ogm_mcmc.io.bags import typestore


def transform(
    stamp_ns: int, parent: str, child: str, x: float, y: float, yaw: float, roll: float = 0.0
) -> Any:
    """Return a TFMessage of one transform: yaw, then roll."""
    types = typestore().types
    cz, sz = math.cos(yaw / 2), math.sin(yaw / 2)
    cx, sx = math.cos(roll / 2), math.sin(roll / 2)
    turn = types['geometry_msgs/msg/Quaternion'](cz * sx, sz * sx, sz * cx, cz * cx)
    move = types['geometry_msgs/msg/Vector3'](float(x), float(y), 0.0)
    header = types['std_msgs/msg/Header'](
        types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9)), parent
    )
    stamped = types['geometry_msgs/msg/TransformStamped'](
        header, child, types['geometry_msgs/msg/Transform'](move, turn)
    )
    return types['tf2_msgs/msg/TFMessage']([stamped])
