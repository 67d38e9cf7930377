"""A latched topic that serves newcomers at once, whatever their quality of service."""

from __future__ import annotations

import time
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from ogm_mcmc.ros.qos import LATCHED

__all__ = ['LatchedTopic']

# A best-effort listener does not ask again for what went out before it knew the sender.
AGAIN_S = 2.0


class LatchedTopic:
    """A latched publisher that knows when somebody new waits to be served.

    DDS alone is not enough: to a volatile listener it gives nothing of what was sent before, to
    a latched one what may be old by now, up to three seconds late.
    """

    def __init__(self, node: Node, kind: Any, topic: str) -> None:
        self.node = node
        self.publisher = node.create_publisher(
            kind, topic, LATCHED, event_callbacks=PublisherEventCallbacks(matched=self._on_matched)
        )
        self.sent = 0
        self._serve_at: list[float] = []  # when somebody wants a message

    @property
    def name(self) -> str:
        """The topic with namespace and remaps applied."""
        return str(self.publisher.topic_name)

    @property
    def listeners(self) -> int:
        """Number of subscriptions."""
        return int(self.publisher.get_subscription_count())

    @property
    def newcomers_wait(self) -> bool:
        """Whether somebody came since the last message."""
        return bool(self._serve_at) and min(self._serve_at) <= time.monotonic()

    def _on_matched(self, info: Any) -> None:
        if info.total_count_change <= 0:
            return  # somebody left
        now = time.monotonic()
        self._serve_at.append(now)
        infos = self.node.get_subscriptions_info_by_topic(self.name)
        if any(one.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for one in infos):
            self._serve_at.append(now + AGAIN_S)

    def send(self, message: Any) -> None:
        """Publish to everybody; newcomers are served with it."""
        now = time.monotonic()
        self._serve_at = [at for at in self._serve_at if at > now]
        self.publisher.publish(message)
        self.sent += 1
