"""Read tf2_msgs/TFMessage, read and fill geometry_msgs/TransformStamped; imports no ROS."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import SensorMount
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform
from ogm_mcmc.io.messages import frame_of, plain_frame, stamp_of, time_parts

__all__ = [
    'TF_TYPES',
    'TfEntries',
    'fill_transform',
    'is_static',
    'read_transform',
    'read_transforms',
]

# The second is what ROS 1 recorded before tf2.
TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')


def is_static(topic: str) -> bool:
    """Return whether a topic carries transforms that hold always: /tf_static, of any namespace."""
    return topic.rsplit('/', 1)[-1] == 'tf_static'


class TfEntries(NamedTuple):
    """What a message says, and one line for each transform in it that is none."""

    entries: list[StampedTransform]
    faults: list[str]


def read_transforms(msg: Any) -> TfEntries:
    """Read the transforms of a message, frames without the leading slash of ROS 1.

    One at fault does not take the others with it, as in tf2.
    """
    read = TfEntries([], [])
    for one in msg.transforms:
        try:
            read.entries.append(read_transform(one))
        except PoseError as error:
            read.faults.append(str(error))
    return read


def read_transform(one: Any) -> StampedTransform:
    """Read one transform. Raises PoseError that names its frames."""
    parent, child = frame_of(one), plain_frame(one.child_frame_id)
    move, turn = one.transform.translation, one.transform.rotation
    try:
        if not parent or not child or parent == child:
            raise PoseError('expected two frames')
        transform = RigidTransform.checked(
            (float(move.x), float(move.y), float(move.z)),
            (float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
        )
    except PoseError as error:
        names = f'{parent or "(no name)"} -> {child or "(no name)"}'
        raise PoseError(f'{names}: {error}') from error
    return StampedTransform(parent, child, stamp_of(one), transform)


def fill_transform(msg: Any, parent: str, child: str, mount: SensorMount, stamp_ns: int) -> None:
    """Fill a geometry_msgs/TransformStamped with where a sensor sits: turned, then rolled over."""
    msg.header.frame_id, msg.child_frame_id = parent, child
    msg.header.stamp.sec, msg.header.stamp.nanosec = time_parts(stamp_ns)
    move, turn, half = msg.transform.translation, msg.transform.rotation, mount.pose.yaw_rad / 2.0
    move.x, move.y = mount.pose.x_m, mount.pose.y_m
    if mount.upside_down:
        turn.x, turn.y, turn.z, turn.w = math.cos(half), math.sin(half), 0.0, 0.0
    else:
        turn.z, turn.w = math.sin(half), math.cos(half)
