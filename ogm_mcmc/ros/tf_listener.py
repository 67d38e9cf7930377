"""Transforms of /tf and /tf_static into a tree of our own; tf2_ros is not needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.geometry.rigid_transform import StampedTransform
from ogm_mcmc.io.tf_messages import read_transforms
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.pose_topics import AnyReliability, message_class

__all__ = ['TF_STATIC_TOPIC', 'TF_TOPIC', 'TfListener', 'tf_is_installed']

TF_TOPIC = '/tf'
TF_STATIC_TOPIC = '/tf_static'


def tf_is_installed() -> bool:
    """Return whether the messages of tf are installed (tf2_msgs is not on PyPI)."""
    try:
        message_class('tf')
    except ConfigError:
        return False
    return True


class TfListener:
    """Feeds a tree; whether a transform holds always is said by its topic, as in tf2.

    `on_moving(entry)` is called for each transform of /tf, `on_message()` after each message, and
    `on_fault(text)` for each transform that is none.
    """

    def __init__(
        self,
        node: Node,
        tree: TransformTree,
        *,
        on_moving: Callable[[StampedTransform], None] = lambda entry: None,
        on_message: Callable[[], None] = lambda: None,
        on_fault: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.node = node
        self.tree = tree
        self.on_moving = on_moving
        self.on_message = on_message
        self.on_fault = on_fault
        self._moving: AnyReliability | None = None

    def subscribe(self) -> None:
        """Begin to receive. Raises ConfigError where tf2_msgs is not installed."""
        kind = message_class('tf')
        self._moving = AnyReliability(self.node, kind, TF_TOPIC, self.on_tf, qos.TF)
        self.node.create_subscription(kind, TF_STATIC_TOPIC, self.on_tf_static, qos.TF_STATIC)

    def adapt(self) -> None:
        """Hear best-effort publishers of /tf as well."""
        if self._moving is not None:
            self._moving.adapt()

    def on_tf(self, msg: Any) -> None:
        """Take transforms that hold at their stamps."""
        for entry in self._read(msg):
            try:
                self.tree.add(entry)
            except PoseError as error:
                self.on_fault(str(error))
            else:
                self.on_moving(entry)
        self.on_message()

    def on_tf_static(self, msg: Any) -> None:
        """Take transforms that hold always, or from now on where one is corrected."""
        now_ns = self.node.get_clock().now().nanoseconds
        for entry in self._read(msg):
            try:
                self.tree.add(entry, static=True, arrival_ns=now_ns)
            except PoseError as error:
                self.on_fault(str(error))
        self.on_message()

    def _read(self, msg: Any) -> list[StampedTransform]:
        read = read_transforms(msg)
        for fault in read.faults:
            self.on_fault(fault)
        return read.entries
