"""A bond with Nav2's lifecycle manager, which so notices when the node is gone.

The protocol of bond_core, as far as a node that is watched needs it: on the topic `bond` it says
again and again under its name that it lives, and at last that it does not. What the other side
says is not listened to: Nav2's nodes do not act on it either.
"""

from __future__ import annotations

import threading
import uuid
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node

__all__ = ['Bond']

TOPIC = 'bond'

# Nav2's manager takes a node for lost after 4 s without a word (`bond_timeout`).
PERIOD_S = 0.25
TIMEOUT_S = 4.0

DEPTH = 5

# The last word would go with its sender; it is waited for so long.
LAST_WORD_S = 0.5


class Bond:
    """Says that a node lives, from `begin` to `end`; nothing where `bond` is not installed.

    A thread of its own says so: long work of the node is not its end.
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        self._done = threading.Event()
        self._thread: threading.Thread | None = None
        self._publisher: Any = None

    def begin(self) -> None:
        """Begin to say so."""
        kind = _status_type()
        if kind is None or self._thread is not None:
            return
        self._publisher = self.node.create_publisher(kind, TOPIC, DEPTH)
        status = kind(id=self.node.get_name(), instance_id=str(uuid.uuid4()), active=True)
        status.heartbeat_period, status.heartbeat_timeout = PERIOD_S, TIMEOUT_S
        self._done.clear()
        self._thread = threading.Thread(target=self._go_on, args=(status,), daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Say that it is over."""
        if self._thread is None:
            return
        self._done.set()
        self._thread.join()
        self._thread = None
        self.node.destroy_publisher(self._publisher)

    def _go_on(self, status: Any) -> None:
        while not self._done.is_set():
            self._say(status)
            self._done.wait(PERIOD_S)
        status.active = False
        self._say(status)
        if self.node.context.ok():
            self._publisher.wait_for_all_acked(Duration(nanoseconds=round(LAST_WORD_S * 1e9)))

    def _say(self, status: Any) -> None:
        if self.node.context.ok():
            status.header.stamp = self.node.get_clock().now().to_msg()
            self._publisher.publish(status)


def _status_type() -> Any:
    try:
        from bond.msg import Status
    except ImportError:
        return None
    return Status
