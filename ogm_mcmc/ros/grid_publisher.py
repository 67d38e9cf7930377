"""Publishes a map without copying it: the message's data is the array that is kept up to date."""

from __future__ import annotations

import array
import math
import time
from typing import Any

import numpy as np
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.node import Node

from ogm_mcmc.arrays import Int8Array
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.map_view import MapView
from ogm_mcmc.geometry import CellBox, GridSpec
from ogm_mcmc.io.messages import fill_grid_header, fill_grid_update
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.latched_topic import LatchedTopic

__all__ = ['GridPublisher', 'grid_message']

# A subscription is discovered before the name of the node it belongs to.
NAMELESS = '_NODE_NAME_UNKNOWN_'

# Nav2's static layer holds a whole map back until its next cycle (1 s in Nav2's own parameters),
# and that overwrites the updates that came meanwhile: they are sent again after this time.
SETTLE_S = 2.0


def grid_message(values: Int8Array, spec: GridSpec, frame_id: str, stamp_ns: int) -> OccupancyGrid:
    """Return an OccupancyGrid of values (height, width): 0..100, -1 unknown."""
    message = OccupancyGrid()
    fill_grid_header(message, spec, frame_id, stamp_ns)
    message.data = array.array('b', values.tobytes())
    return message


class _MessageView(MapView):
    """A view whose values live inside an OccupancyGrid."""

    message: OccupancyGrid

    def _allocate(self, spec: GridSpec) -> Int8Array:
        self.message = OccupancyGrid()
        self.message.data = array.array('b', bytes(spec.width * spec.height))
        # The message may keep a copy of what it is given; its own array is the one to write to.
        return np.frombuffer(self.message.data, np.int8).reshape(spec.height, spec.width)


class GridPublisher:
    """One latched OccupancyGrid topic, and TOPIC_updates beside it where map_msgs is installed.

    TOPIC is the name after remapping, so that the updates go where the map goes, unless they are
    remapped themselves. Work per publication is proportional to what changed, apart from DDS
    copying the message.
    `metadata`: name of a MapMetaData topic that goes with the whole maps.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        pipeline: MappingPipeline,
        output: OutputConfig,
        kind: str = '',
        metadata: str = '',
    ) -> None:
        self.node = node
        self.view = _MessageView(pipeline, output, kind)
        self.topic = LatchedTopic(node, OccupancyGrid, topic)
        self.metadata = LatchedTopic(node, MapMetaData, metadata) if metadata else None
        self.update_type = _update_type()
        self.updates = None
        if self.update_type is not None:
            name = _updates_name(node, topic, self.topic.name)
            self.updates = node.create_publisher(self.update_type, name, 10)
        self.renewed_at = -math.inf  # when the whole map was sent last
        self._early: list[CellBox] = []  # sent as updates soon after that
        self._old = False  # updates have gone out since the last whole map
        self._sent_spec: GridSpec | None = None

    def _followers(self, publisher: Any) -> set[str]:
        """Return the names of the nodes that subscribe."""
        return {
            f'{info.node_namespace}/{info.node_name}'
            for info in self.node.get_subscriptions_info_by_topic(publisher.topic_name)
        }

    def mark(self, changed: CellBox) -> None:
        """Note that cells changed."""
        self.view.mark(changed)

    def serve_newcomers(self, frame_id: str, stamp_ns: int) -> None:
        """Send the whole map, as it is now, if somebody came since it was sent last."""
        if self.topic.newcomers_wait:
            self.publish(frame_id, stamp_ns, whole=True)
        elif self.metadata is not None and self.metadata.newcomers_wait and self.topic.sent:
            self.metadata.send(self.view.message.info)

    def publish_changes(self, frame_id: str, stamp_ns: int, latched_interval_s: float) -> None:
        """Send what changed where somebody listens, or when the latched copy is too old.

        With an infinite interval nothing is sent while nobody listens.
        """
        age = time.monotonic() - self.renewed_at
        if age >= SETTLE_S:
            for box in self._early:
                self.view.mark(box)
            self._early = []
        due = math.isfinite(latched_interval_s) and age >= latched_interval_s
        changed = self.view.stale and (due or self.topic.listeners > 0)
        if changed or (due and self._old):
            self.publish(frame_id, stamp_ns, whole=due)

    def publish(self, frame_id: str, stamp_ns: int, *, whole: bool = False) -> None:
        """Send what changed: as an update if every listener takes those, else the whole map.

        `whole` asks for the whole map in any case.
        """
        boxes = self.view.refresh()
        spec = self.view.spec
        assert spec is not None
        if self.updates is not None and not self._everybody_needs_it(spec):
            for box in boxes:
                self._publish_update(spec, box, frame_id, stamp_ns)
            if time.monotonic() - self.renewed_at < SETTLE_S:
                self._early += boxes
            self._old = True
            if not whole:
                return
        fill_grid_header(self.view.message, spec, frame_id, stamp_ns)
        self.topic.send(self.view.message)
        if self.metadata is not None:
            self.metadata.send(self.view.message.info)
        self._sent_spec = spec
        self._old = False
        self._early = []
        self.renewed_at = time.monotonic()

    def _everybody_needs_it(self, spec: GridSpec) -> bool:
        """Whether updates would not do: another extent, or somebody without them."""
        if spec != self._sent_spec:
            return True
        followers = self._followers(self.updates)
        left_out = self._followers(self.topic.publisher) - followers
        nameless = any(NAMELESS in name for name in followers)
        return not followers or bool(left_out) or nameless

    def _publish_update(self, spec: GridSpec, box: CellBox, frame_id: str, stamp_ns: int) -> None:
        assert self.updates is not None
        assert self.update_type is not None
        update = self.update_type()
        fill_grid_update(update, spec, box, frame_id, stamp_ns)
        changed = np.ascontiguousarray(self.view.values[spec.slices(box)])
        update.data = array.array('b', changed.tobytes())
        self.updates.publish(update)

    def restart(self) -> None:
        """Forget what was shown (after a reset)."""
        self.view.restart()
        self._early = []


def _updates_name(node: Node, topic: str, remapped: str) -> str:
    """Return the name of the updates: that of the map, or what its own remap rule says."""
    plain = f'{topic}_updates'
    own = str(node.resolve_topic_name(plain))
    if own != node.resolve_topic_name(plain, only_expand=True):
        return own
    return f'{remapped}_updates'


def _update_type() -> Any:
    try:
        from map_msgs.msg import OccupancyGridUpdate
    except ImportError:
        return None
    return OccupancyGridUpdate
