"""Where sensors sit that move on the robot, on a topic of standard messages: `mount`.

tf says it where tf2_msgs is installed. `replay` sends what a recording knows as
geometry_msgs/TransformStamped, one before each scan at its stamp, and nodes with
`mount_source: topic` take it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import SensorMount
from ogm_mcmc.io.tf_messages import fill_transform, read_transform
from ogm_mcmc.ros import qos

__all__ = ['TOPIC', 'MountListener', 'MountOutlet']

TOPIC = 'mount'


class MountListener:
    """Feeds a tree; calls `on_message()` after each message, `on_fault(text)` for one at fault."""

    def __init__(
        self,
        node: Node,
        tree: TransformTree,
        *,
        on_message: Callable[[], None] = lambda: None,
        on_fault: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.node = node
        self.tree = tree
        self.on_message = on_message
        self.on_fault = on_fault

    def subscribe(self) -> None:
        """Begin to receive."""
        self.node.create_subscription(TransformStamped, TOPIC, self.take, qos.TF)

    def take(self, msg: TransformStamped) -> None:
        """Take where a sensor sits at a stamp."""
        try:
            self.tree.add(read_transform(msg))
        except PoseError as error:
            self.on_fault(str(error))
        self.on_message()


class MountOutlet:
    """Publishes where the sensors of some frames sit on the base."""

    def __init__(self, node: Node, base_frame: str, frames: Iterable[str]) -> None:
        self.base_frame = base_frame
        self.frames = frozenset(frames)
        self.publisher = node.create_publisher(TransformStamped, TOPIC, qos.TF)

    def send(self, frame: str, mount: SensorMount, stamp_ns: int) -> None:
        """Publish one."""
        message = TransformStamped()
        fill_transform(message, self.base_frame, frame, mount, stamp_ns)
        self.publisher.publish(message)
