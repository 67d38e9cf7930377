"""Which topics of a bag hold the scans: those named, else of each laser that sits on one robot."""

from __future__ import annotations

from ogm_mcmc.config import MountConfig
from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.engine.bag_survey import SeenTopic, topic_namespace
from ogm_mcmc.engine.mounts import names_a_place
from ogm_mcmc.engine.pose_choice import TF
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import BagError
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader, BagTopic
from ogm_mcmc.io.tf_messages import TF_TYPES

__all__ = ['POSE_TYPES', 'lasers_of', 'reading_topics', 'robot_of', 'robots_of']

POSE_TYPES = tuple(kind for name, kinds in POSE_SOURCES.items() if name != TF for kind in kinds)


def reading_topics(bag: BagReader, choice: StreamChoice) -> list[BagTopic]:
    """Return the topics with readings, the one that stands for the robot first.

    Raises BagError for a topic that is named and not there, and where there is none.
    """
    ranges = choice.sensor == 'range'
    role, kind = ('ranges', ros_types.RANGE) if ranges else ('scans', ros_types.SCAN)
    if choice.scan_topic:
        names = filter(None, map(str.strip, choice.scan_topic.split(',')))
        found = [bag.find(role, (kind,), name) for name in names]
        if not found:
            raise BagError(f'scan topic is {choice.scan_topic!r}: expected names of topics')
        return list(dict.fromkeys(found))  # one that is named twice is read once
    first = bag.find(role, (kind,))  # or say what is missing
    readable = [
        t
        for t in bag.topics()
        if t.msgtype == kind and t.n_messages > 0 and not bag.problem(t.name)
    ]
    if ranges:
        return readable or [first]
    # A topic called scan is what the driver sends; filters and mergers add to the name.
    return sorted(readable, key=_usual) or [first]


def _usual(topic: BagTopic) -> tuple[bool, int, int]:
    return not topic.name.endswith('/scan'), topic.name.count('/'), -topic.n_messages


def lasers_of(
    found: list[SeenTopic], tree: TransformTree, base: str, mounts: MountConfig
) -> tuple[list[SeenTopic], list[str]]:
    """Return the topic of each laser whose place on the robot is known, the first in any case."""
    used, taken, left = [found[0]], set(found[0].frames), []
    for topic in found[1:]:
        if taken & set(topic.frames):
            left.append(f'{topic.topic.name} (of {topic.frame} as well)')
        elif not all(_is_mounted(frame, tree, base, mounts) for frame in topic.frames):
            left.append(f'{topic.topic.name} (nothing says where {topic.frame} sits)')
        elif any(tree.moves_apart(base, frame) for frame in topic.frames):
            left.append(f'{topic.topic.name} ({topic.frame} is not of the robot of {base})')
        else:
            used.append(topic)
            taken |= set(topic.frames)
    if len(found) == 1:
        return used, []
    line = 'scans from ' + ', '.join(f'{t.topic.name} ({", ".join(t.frames[:3])})' for t in used)
    return used, [line + (f'; also there: {", ".join(left)}' if left else '')]


def _is_mounted(frame: str, tree: TransformTree, base: str, mounts: MountConfig) -> bool:
    return (
        frame == base
        or frame in mounts.named()
        or names_a_place(mounts, frame)
        or tree.newest_common_ns(base, frame) is not None
    )


def robot_of(name: str) -> str:
    """Return the robot that a topic is of, by its namespace; empty for the one without."""
    return topic_namespace(name).partition('/')[0]


def robots_of(bag: BagReader) -> set[str]:
    """Return the namespaces that hold a robot of their own: scans, and poses or transforms."""
    scans, poses = set(), set()
    for topic in bag.topics():
        robot = robot_of(topic.name)
        if topic.n_messages > 0 and topic.msgtype in (ros_types.SCAN, ros_types.RANGE):
            scans.add(robot)
        elif topic.n_messages > 0 and topic.msgtype in (*POSE_TYPES, *TF_TYPES):
            poses.add(robot)
    return (scans & poses) - {''}
