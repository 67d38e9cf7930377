"""The topics of a refined map, which changes everywhere at once."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.duration import Duration
from rclpy.node import Node

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.map_view import rendered
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.ros.grid_publisher import grid_message
from ogm_mcmc.ros.latched_topic import LatchedTopic

__all__ = ['RefinedMaps']


class _Topic:
    """One kind of map; its message is made once for each result that is sent."""

    def __init__(self, node: Node, topic: str, kind: str) -> None:
        self.topic = LatchedTopic(node, OccupancyGrid, topic)
        self.kind = kind
        self.shown = 0  # number of the result that was sent last
        self._made: tuple[int, OccupancyGrid] | None = None

    def message(self, number: int, make: Callable[[str], OccupancyGrid]) -> OccupancyGrid:
        """Return the message of a result, made by `make(kind)` unless it is there."""
        if self._made is None or self._made[0] != number:
            self._made = (number, make(self.kind))
        return self._made[1]

    def forget(self) -> None:
        """Make and send the next message anew, even of the same result."""
        self._made, self.shown = None, 0


class RefinedMaps:
    """`map_refined` (what `output` says), its metadata, `map_refined_probability`, `~/entropy`.

    `frame_id()` is the frame of the maps: with odometry it is known when the first message comes.
    `shown(result)` gives the map of a result as it is to be seen, nan where it says nothing.
    """

    def __init__(
        self,
        node: Node,
        frame_id: Callable[[], str],
        output: OutputConfig,
        shown: Callable[[RefinedMap], GridMap],
    ) -> None:
        self.frame_id = frame_id
        self.output = output
        self.shown = shown
        self.map = _Topic(node, 'map_refined', '')
        self.probability = _Topic(node, 'map_refined_probability', 'probability')
        self.entropy = _Topic(node, '~/entropy', 'entropy')
        self.all = (self.map, self.probability, self.entropy)
        self.metadata = LatchedTopic(node, MapMetaData, 'map_refined_metadata')
        self._renewed_at = 0.0

    def show(self, output: OutputConfig) -> None:
        """Render all maps anew, perhaps in another way."""
        self.output = output
        for one in self.all:
            one.forget()

    def publish(self, result: RefinedMap, latched_interval_s: float) -> None:
        """Send a new map where somebody listens, when it is the last, or the latched one is due.

        Newcomers get the map in any case. The entropy is sent only where somebody listens.
        """
        now = time.monotonic()
        due = result.final or now - self._renewed_at >= latched_interval_s
        for one in self.all:
            latched = due and one is not self.entropy
            new = result.number != one.shown and (latched or one.topic.listeners > 0)
            if new or one.topic.newcomers_wait:
                self._send(one, self._message_on(one, result))
                one.shown = result.number
                self._renewed_at = now if one is self.map else self._renewed_at
        if self.metadata.newcomers_wait:
            self.metadata.send(self._message_on(self.map, result).info)

    def _send(self, one: _Topic, message: OccupancyGrid) -> None:
        one.topic.send(message)
        if one is self.map:
            self.metadata.send(message.info)

    def map_message(self, result: RefinedMap) -> OccupancyGrid:
        """Return the message of `map_refined`."""
        return self._message_on(self.map, result)

    def _message_on(self, one: _Topic, result: RefinedMap) -> OccupancyGrid:
        def make(kind: str) -> OccupancyGrid:
            # The entropy is of every cell, also of those that are no more certain than the prior.
            grid_map = result.grid_map if kind == 'entropy' else self.shown(result)
            values = rendered(grid_map.probability, kind or self.output.output, self.output)
            return grid_message(values, grid_map.spec, self.frame_id(), result.stamp_ns)

        return one.message(result.number, make)

    def clear(self, resolution_m: float) -> None:
        """Publish empty maps where there were others."""
        empty = np.full((1, 1), -1, np.int8)
        for one in self.all:
            one.forget()
            if one.topic.sent:
                spec = GridSpec(resolution_m, 1, 1)
                self._send(one, grid_message(empty, spec, self.frame_id(), 0))

    def flush(self, timeout_s: float) -> None:
        """Wait until every listener has what was sent, before the node goes."""
        limit = Duration(nanoseconds=round(timeout_s * 1e9))
        self.map.topic.publisher.wait_for_all_acked(limit)
