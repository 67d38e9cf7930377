"""Read tf2_msgs/TFMessage; imports no ROS."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform
from ogm_mcmc.io.messages import frame_of, stamp_of

__all__ = ['TF_TYPES', 'is_static', 'read_transforms']

# The second is what ROS 1 recorded before tf2.
TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')


def is_static(topic: str) -> bool:
    """Return whether a topic carries transforms that hold always: /tf_static, of any namespace."""
    return topic.rsplit('/', 1)[-1] == 'tf_static'


def read_transforms(msg: Any) -> Iterator[StampedTransform]:
    """Yield the transforms of a message, frames without the leading slash of ROS 1.

    Raises PoseError for numbers that are no transform, naming the frames.
    """
    for one in msg.transforms:
        move, turn = one.transform.translation, one.transform.rotation
        parent, child = frame_of(one), str(one.child_frame_id).lstrip('/')
        yield StampedTransform(
            parent,
            child,
            stamp_of(one),
            RigidTransform.checked(
                (float(move.x), float(move.y), float(move.z)),
                (float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
            ),
        )
