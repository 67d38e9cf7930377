"""Publishes a map without copying it: the message's data is the array that is kept up to date."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node

from ogm_mcmc.arrays import Int8Array
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.map_view import MapView
from ogm_mcmc.geometry import CellBox, GridSpec
from ogm_mcmc.io.messages import fill_grid_header, fill_grid_update
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.qos import LATCHED

__all__ = ['GridPublisher']

Endpoint = tuple[str, bytes]


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

    Work per publication is proportional to what changed, apart from DDS copying the message.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        pipeline: MappingPipeline,
        output: OutputConfig,
        kind: str = '',
    ) -> None:
        self.view = _MessageView(pipeline, output, kind)
        self.publisher = node.create_publisher(OccupancyGrid, topic, LATCHED)
        self.update_type = _update_type()
        self.updates = None
        if self.update_type is not None:
            self.updates = node.create_publisher(self.update_type, f'{topic}_updates', 10)
        self.node = node
        self.sent = 0
        self.copy_is_old = False  # updates have gone out since the last whole map
        self._served: set[Endpoint] = set()
        self._sent_spec: GridSpec | None = None

    @property
    def listeners(self) -> int:
        """Number of subscriptions to the whole map."""
        return int(self.publisher.get_subscription_count())

    def _endpoints(self, publisher: Any) -> set[Endpoint]:
        """Return who subscribes: node and the identity of the subscription."""
        return {
            (f'{info.node_namespace}/{info.node_name}', bytes(info.endpoint_gid))
            for info in self.node.get_subscriptions_info_by_topic(publisher.topic_name)
        }

    def mark(self, changed: CellBox) -> None:
        """Note that cells changed."""
        self.view.mark(changed)

    def publish(self, frame_id: str, stamp_ns: int, *, whole: bool = False) -> bool:
        """Send what changed: as an update if every listener takes those, else the whole map.

        Returns whether the whole map was sent; `whole` asks for it in any case, so that the
        latched copy does not grow old.
        """
        boxes = self.view.refresh()
        spec = self.view.spec
        assert spec is not None
        if self.updates is not None and not self._everybody_needs_it(spec):
            for box in boxes:
                self._publish_update(spec, box, frame_id, stamp_ns)
            self.copy_is_old = True
            if not whole:
                return False
        fill_grid_header(self.view.message, spec, frame_id, stamp_ns)
        self.publisher.publish(self.view.message)
        self._sent_spec = spec
        self.copy_is_old = False
        self.sent += 1
        return True

    def _everybody_needs_it(self, spec: GridSpec) -> bool:
        """Whether updates would not do: another extent, somebody new, somebody without them."""
        listeners = self._endpoints(self.publisher)
        newcomers = listeners - self._served
        self._served = listeners
        followers = {name for name, _ in self._endpoints(self.updates)}
        left_out = {name for name, _ in listeners} - followers
        return spec != self._sent_spec or bool(newcomers) or bool(left_out) or not followers

    def _publish_update(self, spec: GridSpec, box: CellBox, frame_id: str, stamp_ns: int) -> None:
        assert self.updates is not None
        assert self.update_type is not None
        update = self.update_type()
        fill_grid_update(update, spec, box, frame_id, stamp_ns)
        changed = np.ascontiguousarray(self.view.values[spec.slices(box)])
        update.data = array.array('b', changed.tobytes())
        self.updates.publish(update)


def _update_type() -> Any:
    try:
        from map_msgs.msg import OccupancyGridUpdate
    except ImportError:
        return None
    return OccupancyGridUpdate
