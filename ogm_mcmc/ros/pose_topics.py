"""The messages that carry poses: their classes, their readers, and a subscription to hear them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.io import messages
from ogm_mcmc.ros import qos

__all__ = ['AnyReliability', 'message_class', 'pose_reader']


def message_class(source: str) -> Any:
    """Return the class of the messages of a pose source.

    Raises ConfigError where the package it comes from is not installed.
    """
    package, _, name = POSE_SOURCES[source][0].split('/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except ImportError as error:
        others = ', '.join(other for other in POSE_SOURCES if other != source)
        raise ConfigError(
            f'pose_source {source} needs {package} ({error}): expected it installed, or another '
            f'pose_source ({others})'
        ) from error


def pose_reader(source: str, *, with_covariance: bool = True) -> Callable[[Any], PoseBelief]:
    """Return what reads a message of a pose source."""
    if source in ('particles', 'particle_cloud'):
        return messages.read_particles
    return partial(messages.read_pose, with_covariance=with_covariance)


class AnyReliability:
    """A subscription that hears every publisher: reliable, until one that is not shows up.

    A reliable subscription is not connected to a best-effort publisher (amcl's particle cloud,
    any with sensor-data QoS); a best-effort one loses messages of reliable publishers. Call
    `adapt` now and then: it changes over when ROS has told of such a publisher.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        reliable: QoSProfile = qos.POSES,
    ) -> None:
        self.node = node
        self.topic = topic
        self._kind = kind
        self._callback = callback
        self._depth = reliable.depth
        self._unheard = False
        self._reliable = True
        self._subscription = node.create_subscription(
            kind,
            topic,
            callback,
            reliable,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible),
        )

    def _on_incompatible(self, event: Any) -> None:
        self._unheard = True

    def adapt(self) -> None:
        """Change over to best effort where a publisher asks for it."""
        if not self._unheard or not self._reliable:
            return
        self._reliable = False
        self.node.destroy_subscription(self._subscription)
        self._subscription = self.node.create_subscription(
            self._kind, self.topic, self._callback, qos.best_effort(self._depth)
        )
        topic = self._subscription.topic_name
        self.node.get_logger().info(f'{topic} has a best-effort publisher: heard as such')
