"""ROS 1 bags, which the package reads and never writes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

__all__ = ['write_ros1']

NOETIC = get_typestore(Stores.ROS1_NOETIC)
NOETIC.register(
    get_types_from_msg('geometry_msgs/TransformStamped[] transforms', 'tf2_msgs/msg/TFMessage')
)


def write_ros1(path: Path, records: Iterable[tuple[str, int, Any]]) -> None:
    """Write (topic, time ns, message) in the order given; messages are those of `ros_types`."""
    connections: dict[str, Any] = {}
    with Writer(path) as writer:
        for topic, time_ns, message in records:
            msgtype = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=NOETIC)
            raw = NOETIC.serialize_ros1(as_ros1(message), msgtype)
            writer.write(connections[topic], time_ns, raw)


def as_ros1(message: Any) -> Any:
    """Return the ROS 1 form of a message: the same fields, and a sequence number in the header."""
    kind = getattr(message, '__msgtype__', None)
    if isinstance(message, list):
        return [as_ros1(member) for member in message]
    if kind is None:
        return message
    fields = {
        name: as_ros1(getattr(message, name))
        for name in message.__dataclass_fields__
        if name != '__msgtype__'
    }
    if kind == 'std_msgs/msg/Header':
        fields['seq'] = 7
    return NOETIC.types[kind](**fields)
