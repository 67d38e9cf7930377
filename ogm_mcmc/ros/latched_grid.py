"""A latched OccupancyGrid topic for maps that change everywhere at once."""

from __future__ import annotations

import array

from nav_msgs.msg import OccupancyGrid
from rclpy.duration import Duration
from rclpy.node import Node

from ogm_mcmc.arrays import Int8Array
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.io.messages import fill_grid_header
from ogm_mcmc.ros.qos import LATCHED

__all__ = ['LatchedGrid', 'grid_message']


def grid_message(values: Int8Array, spec: GridSpec, frame_id: str, stamp_ns: int) -> OccupancyGrid:
    """Return an OccupancyGrid of values (height, width): 0..100, -1 unknown."""
    message = OccupancyGrid()
    fill_grid_header(message, spec, frame_id, stamp_ns)
    message.data = array.array('b', values.tobytes())
    return message


class LatchedGrid:
    """Publishes whole maps; `shown` is the number of the one that was sent last."""

    def __init__(self, node: Node, topic: str) -> None:
        self.publisher = node.create_publisher(OccupancyGrid, topic, LATCHED)
        self.sent = 0
        self.shown = 0

    @property
    def listeners(self) -> int:
        """Number of subscriptions."""
        return int(self.publisher.get_subscription_count())

    def publish(self, message: OccupancyGrid, number: int) -> None:
        """Send a map and remember its number."""
        self.publisher.publish(message)
        self.sent += 1
        self.shown = number

    def flush(self, timeout_s: float) -> None:
        """Wait until every listener has what was sent, before the node goes."""
        self.publisher.wait_for_all_acked(Duration(nanoseconds=round(timeout_s * 1e9)))
