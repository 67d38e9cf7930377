"""A first look through a bag: when each topic says something, in which frames, and all of tf."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Int64Array
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry.rigid_transform import StampedTransform
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bag_headers import stored_header
from ogm_mcmc.io.bags import BagReader, BagRecord, BagTopic
from ogm_mcmc.io.tf_messages import is_static, read_transforms

__all__ = ['BagSurvey', 'SeenTopic', 'survey', 'topic_namespace', 'transform_topics']

# So many transforms at fault are told of.
MOST_FAULTS = 10

# Messages with one stamp were recorded within so long where that is when they were measured: the
# lasers of one moment. Farther apart, a clock stood still.
ONE_MOMENT_NS = 1_000_000_000

# So many scans of a topic are kept to look at what they measured.
SAMPLED = 50


class SeenTopic(NamedTuple):
    """A topic with headers: `stamps` (N,) ns of its messages in `frame`, its most frequent one.

    `frames`: all of them, the most frequent first, `middle_ns` the stamp of one message of each
    from the middle. `child_frame`: of the first message, where its type has one, or as the bag
    notes. `unstamped`: all stamps are 0 or all the same in the messages, these recorded over more
    than `ONE_MOMENT_NS`; those here are the times at which they were recorded. `sampled`: some of
    its scans, from all over.
    """

    topic: BagTopic
    frames: tuple[str, ...]
    stamps: Int64Array
    middle_ns: tuple[int, ...] = ()
    child_frame: str = ''
    unstamped: bool = False
    sampled: tuple[BagRecord, ...] = ()

    @property
    def frame(self) -> str:
        """The most frequent frame."""
        return self.frames[0]


class BagSurvey(NamedTuple):
    """What was seen: topics by name (those with messages), and the tree of transforms.

    `unstamped_frames` move, and transforms to them are unstamped as messages are (`SeenTopic`):
    each holds from when it was recorded on.
    """

    topics: dict[str, SeenTopic]
    tree: TransformTree
    faults: list[str]
    unstamped_frames: tuple[str, ...] = ()


def survey(bag: BagReader, headed: Iterable[BagTopic], tf: Iterable[BagTopic]) -> BagSurvey:
    """Read the headers of some topics and the transforms of others, in one go."""
    known = {topic.name: topic for topic in headed}
    tf_names = {topic.name for topic in tf}
    stamps: dict[str, dict[str, array[int]]] = {name: {} for name in known}
    recorded: dict[str, dict[str, array[int]]] = {name: {} for name in known}
    stamped: set[str] = set()
    first: dict[str, int] = {}
    children: dict[str, str] = {}
    sampled: dict[str, list[BagRecord]] = {name: [] for name in known}
    met: Counter[str] = Counter()
    transforms = _Transforms()
    for record in bag.records({*known, *tf_names}):
        if record.topic in tf_names:
            transforms.take(bag.decode(record), is_static(record.topic), record.time_ns)
            continue
        header = stored_header(record)
        if header is None:
            continue
        if _is_sample(known[record.topic], met[record.topic]):
            sampled[record.topic].append(record)
        met[record.topic] += 1
        stamps[record.topic].setdefault(header.frame, array('q')).append(header.stamp_ns)
        if header.stamp_ns != first.setdefault(record.topic, header.stamp_ns):
            stamped.add(record.topic)
        elif record.topic not in stamped:
            recorded[record.topic].setdefault(header.frame, array('q')).append(record.time_ns)
        if record.topic not in children:
            children[record.topic] = _child_frame(bag, record)
    seen = {
        name: _seen(known[name], by_frame, children[name])
        for name, by_frame in stamps.items()
        if by_frame
    }
    for name, by_frame in recorded.items():
        times = [time_ns for of_frame in by_frame.values() for time_ns in of_frame]
        if times and name not in stamped and _unstamped(first[name], times):
            again = _seen(known[name], by_frame, children[name])
            seen[name] = again._replace(unstamped=True)
    seen = {name: one._replace(sampled=tuple(sampled[name])) for name, one in seen.items()}
    unstamped = transforms.finish()
    return BagSurvey(seen, transforms.tree, transforms.faults, unstamped)


def _is_sample(topic: BagTopic, k: int) -> bool:
    every = max(1, topic.n_messages // SAMPLED)
    return topic.msgtype == ros_types.SCAN and k % every == 0


def _unstamped(stamp_ns: int, recorded: Sequence[int]) -> bool:
    """Whether messages that all have this stamp say nothing of when they were measured."""
    if stamp_ns == 0:
        return len(recorded) > 1
    return max(recorded) - min(recorded) > ONE_MOMENT_NS


class _Transforms:
    """Transforms into a tree; of frames that never have a stamp by the times of recording."""

    def __init__(self) -> None:
        self.tree = TransformTree()
        self.faults: list[str] = []
        self._stamped: set[str] = set()
        self._static: set[str] = set()
        # By child, with the times of recording: those stamped 0, and those with one other stamp.
        self._waiting: dict[str, list[tuple[StampedTransform, int]]] = {}
        self._same: dict[str, list[tuple[StampedTransform, int]]] = {}

    def take(self, message: Any, static: bool, time_ns: int) -> None:
        """Take a message that was recorded at a time."""
        read = read_transforms(message)
        self.faults += read.faults[: MOST_FAULTS - len(self.faults)]
        for entry in read.entries:
            if static:
                self._static.add(entry.child)
                self.tree.add(entry, static=True, arrival_ns=time_ns)
            elif entry.stamp_ns == 0:
                self._waiting.setdefault(entry.child, []).append((entry, time_ns))
            elif entry.child in self._stamped:
                self.tree.add(entry)
            else:
                same = self._same.setdefault(entry.child, [])
                same.append((entry, time_ns))
                if entry.stamp_ns != same[0][0].stamp_ns:
                    self._have_stamps(entry.child)

    def _have_stamps(self, child: str) -> None:
        """Take what waited for another stamp than its own."""
        for entry, _ in self._same.pop(child, ()):
            self._stamped.add(child)
            self.tree.add(entry)

    def finish(self) -> tuple[str, ...]:
        """Take what waits; return the frames that move and never have a stamp.

        Where a transform is static, what came beside it without a stamp, or with one only, does
        not count.
        """
        unstamped = []
        for child, same in list(self._same.items()):
            if child in self._static:
                continue
            times = [time_ns for _, time_ns in same]
            if child in self._waiting or not _unstamped(same[0][0].stamp_ns, times):
                self._have_stamps(child)
            else:
                unstamped.append(child)
                for entry, time_ns in same:
                    self.tree.add(entry._replace(stamp_ns=time_ns))
        for child, waiting in self._waiting.items():
            if child in self._static:
                continue
            own = child in self._stamped
            if not own and len(waiting) > 1:
                unstamped.append(child)
            for entry, time_ns in waiting:
                # What is said once and for no time holds always.
                static = not own and len(waiting) == 1
                self.tree.add(entry if own else entry._replace(stamp_ns=time_ns), static=static)
        return tuple(sorted(unstamped))


def _child_frame(bag: BagReader, record: BagRecord) -> str:
    if record.msgtype != ros_types.ODOMETRY:
        return bag.noted_frame(record.topic)
    try:
        return str(bag.decode(record).child_frame_id).lstrip('/')
    except BagError:
        return ''


def _seen(topic: BagTopic, by_frame: dict[str, array[int]], child: str) -> SeenTopic:
    counts = Counter({frame: len(stamps) for frame, stamps in by_frame.items()})
    frames = tuple(frame for frame, _ in counts.most_common())
    every = [np.array(by_frame[frame], np.int64) for frame in frames]
    middle = tuple(int(stamps[stamps.size // 2]) for stamps in every)
    is_scan = topic.msgtype in (ros_types.SCAN, ros_types.RANGE)
    stamps = np.concatenate(every) if is_scan else every[0]
    return SeenTopic(topic, frames, stamps, middle, child)


def topic_namespace(name: str) -> str:
    """Return what comes before the last part of a name: `robot1` for /robot1/scan."""
    return name.strip('/').rpartition('/')[0]


def transform_topics(topics: Iterable[BagTopic], scan_topic: str) -> list[BagTopic]:
    """Return those topics with transforms that tell of the robot with a scan topic.

    All of them, unless they come from several namespaces: then those of the one that the scan
    topic is in, and what that one lacks (tf or tf_static) from the root.
    """
    held = list(topics)
    if len({topic_namespace(topic.name) for topic in held}) < 2:
        return held
    where = topic_namespace(scan_topic)
    while True:
        own = [topic for topic in held if topic_namespace(topic.name) == where]
        if own or not where:
            break
        where = topic_namespace(where)
    if not own:
        return held
    kinds = {is_static(topic.name) for topic in own}
    return own + [
        topic
        for topic in held
        if not topic_namespace(topic.name) and where and is_static(topic.name) not in kinds
    ]
