"""Read tf2_msgs/TFMessage; imports no ROS."""

from __future__ import annotations

from typing import Any, NamedTuple

from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform
from ogm_mcmc.io.messages import frame_of, stamp_of

__all__ = ['TF_TYPES', 'TfEntries', 'is_static', 'read_transforms']

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
        parent, child = frame_of(one), str(one.child_frame_id).lstrip('/')
        move, turn = one.transform.translation, one.transform.rotation
        try:
            if not parent or not child or parent == child:
                raise PoseError('expected two frames')
            transform = RigidTransform.checked(
                (float(move.x), float(move.y), float(move.z)),
                (float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
            )
        except PoseError as error:
            read.faults.append(f'{parent or "(no name)"} -> {child or "(no name)"}: {error}')
            continue
        read.entries.append(StampedTransform(parent, child, stamp_of(one), transform))
    return read
