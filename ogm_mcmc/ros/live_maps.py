"""The topics of a live map: for planners, with probabilities, and its entropy."""

from __future__ import annotations

import math
from collections.abc import Callable

from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.map_view import rendered
from ogm_mcmc.geometry import CellBox
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.grid_publisher import GridPublisher, grid_message

__all__ = ['LiveMaps']


class LiveMaps:
    """`map` (what `output` says), `map_metadata`, `map_probability`, and `~/entropy`.

    `header()` gives the frame and the stamp (ns) of what is published. The entropy goes out only
    while somebody listens.
    """

    def __init__(
        self,
        node: Node,
        pipeline: MappingPipeline,
        output: OutputConfig,
        header: Callable[[], tuple[str, int]],
    ) -> None:
        self.pipeline = pipeline
        self.header = header
        self.map = GridPublisher(node, 'map', pipeline, output, metadata='map_metadata')
        self.probability = GridPublisher(node, 'map_probability', pipeline, output, 'probability')
        self.entropy = GridPublisher(node, '~/entropy', pipeline, output, 'entropy')
        self.all = (self.map, self.probability, self.entropy)

    def mark(self, changed: CellBox) -> None:
        """Note that cells changed."""
        for publisher in self.all:
            publisher.mark(changed)

    def show(self, output: OutputConfig) -> None:
        """Render the map in another way from now on."""
        if output != self.map.view.output:
            self.map.view.output = output
            self.map.mark(self.pipeline.changed)

    def serve_newcomers(self) -> None:
        """Give whoever came since the last time the maps as they are now."""
        for publisher in self.all:
            if self.pipeline.scans_used > 0 or publisher.topic.sent > 0:
                publisher.serve_newcomers(*self.header())

    def publish_changes(self, latched_interval_s: float) -> None:
        """Publish what changed, where somebody listens or the latched copy is due."""
        if self.pipeline.scans_used == 0:
            return
        for publisher in self.all:
            interval = math.inf if publisher is self.entropy else latched_interval_s
            publisher.publish_changes(*self.header(), interval)

    def map_message(self) -> OccupancyGrid:
        """Return the map as it is now, made anew: what is published goes its own way."""
        spec, output = self.pipeline.method.spec, self.map.view.output
        probability = self.pipeline.method.probabilities(spec.box)
        return grid_message(rendered(probability, output.output, output), spec, *self.header())

    def restart(self) -> None:
        """Forget what was shown and publish the empty maps (after a reset)."""
        for publisher in self.all:
            publisher.restart()
            if publisher.topic.sent > 0:
                publisher.publish(*self.header(), whole=True)
