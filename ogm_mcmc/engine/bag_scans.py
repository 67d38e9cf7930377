"""Scans of a bag, each with the belief about its sensor's pose: the one door for recordings."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.placing import (
    PoseHistory,
    PoseSource,
    RobotScan,
    ScanPlacer,
    sensor_mount,
)
from ogm_mcmc.engine.tf_poses import TfFrames, TfPoses, guess_frames
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import BagError, PoseError, ScanError
from ogm_mcmc.geometry import PlacedScan, SensorMount
from ogm_mcmc.geometry.motion import MAX_SPEED_M_S, MAX_TURN_RAD_S
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader, BagTopic
from ogm_mcmc.io.tf_messages import TF_TYPES, is_static, read_transforms

__all__ = [
    'POSE_TYPES',
    'PlacedScans',
    'StreamChoice',
    'StreamTopics',
    'choose_topics',
    'open_scans',
]

POSE_TYPES = {
    'pose': (ros_types.POSE, 'geometry_msgs/msg/PoseStamped', ros_types.ODOMETRY),
    'particles': (ros_types.PARTICLES, ros_types.PARTICLE_CLOUD),
    'tf': TF_TYPES,
}


@dataclass(frozen=True)
class StreamChoice:
    """Which topics to use; empty names stand for the first that fits.

    `sensor` range: Range messages in place of scans; `scan_topic` may name several of their
    topics, separated by commas, and if empty stands for all of them.
    """

    scan_topic: str = ''
    pose_topic: str = ''
    pose_source: str = 'pose'
    max_pose_gap_s: float = 2.0
    sensor: str = 'scan'
    mounts: MountConfig = MountConfig()  # noqa: RUF009 - frozen
    max_speed_m_s: float = MAX_SPEED_M_S
    max_turn_rad_s: float = MAX_TURN_RAD_S
    deskew: str = 'auto'


class StreamTopics(NamedTuple):
    """The topics chosen and the map frame their poses name.

    `scan_frame` is that of the first scan; Range messages come from as many frames as sonars.
    `tf`: all topics with transforms. With poses from tf `map_frame` is found when they are read.
    """

    scan: BagTopic
    pose: BagTopic
    map_frame: str
    scan_frame: str
    more_ranges: tuple[BagTopic, ...] = ()
    tf: tuple[BagTopic, ...] = ()

    @property
    def scans(self) -> tuple[BagTopic, ...]:
        """All topics with readings."""
        return (self.scan, *self.more_ranges)

    @property
    def n_scans(self) -> int:
        """Number of readings on them."""
        return sum(topic.n_messages for topic in self.scans)


def choose_topics(bag: BagReader, choice: StreamChoice) -> StreamTopics:
    """Find the scans and poses of a bag. Raises BagError that says what is missing."""
    if choice.sensor == 'range':
        scan, *more = _range_topics(bag, choice.scan_topic)
    else:
        scan, more = bag.find('scans', (ros_types.SCAN,), choice.scan_topic), []
    tf = tuple(t for t in bag.topics() if t.msgtype in TF_TYPES and t.n_messages > 0)
    try:
        pose = bag.find('poses', POSE_TYPES[choice.pose_source], choice.pose_topic)
    except BagError as error:
        if choice.pose_source == 'tf' or not tf:
            raise
        raise BagError(f'{error}; there are transforms: --pose-source tf') from error
    frames: list[str] = []
    for topic in (pose, scan):
        first = next(bag.records((topic.name,)), None)
        if first is None:
            raise BagError(
                f'{bag.path}: no message on {topic.name}, although its index names some'
            )
        message = bag.decode(first)
        frames.append('' if topic in tf else messages.frame_of(message))
    return StreamTopics(scan, pose, frames[0], frames[1], tuple(more), tf)


def _range_topics(bag: BagReader, wanted: str) -> list[BagTopic]:
    if wanted:
        names = filter(None, map(str.strip, wanted.split(',')))
        return [bag.find('ranges', (ros_types.RANGE,), name) for name in names]
    bag.find('ranges', (ros_types.RANGE,))  # or say what is missing
    return [t for t in bag.topics() if t.msgtype == ros_types.RANGE and t.n_messages > 0]


@dataclass
class PlacedScans:
    """Iterate over a bag's placed scans; afterwards `placer.dropped` says what was left out.

    The same reading and placing as in the live node. In a file nothing comes late: a scan waits
    for its pose until the end of the bag. A message at fault is dropped and counted. Sensors sit
    where parameters say, else where tf does, else at the robot's origin. Raises BagError for a
    frame that changes, and when no scan could be placed. `frames` are those of the scans,
    `mounted_by_tf` where tf said they sit (the first time).
    """

    bag: BagReader
    topics: StreamTopics
    choice: StreamChoice
    on_scan: Callable[[], object] = lambda: None
    placer: ScanPlacer = field(init=False)
    placed: int = field(default=0, init=False)
    frames: set[str] = field(default_factory=set, init=False)
    mounted_by_tf: dict[str, SensorMount] = field(default_factory=dict, init=False)
    first_fault: str = field(default='', init=False)
    _tf: TfPoses | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Read the transforms there are, and prepare an empty history or take poses from them."""
        source: PoseSource = PoseHistory(
            max_gap_s=self.choice.max_pose_gap_s,
            max_speed_m_s=self.choice.max_speed_m_s,
            max_turn_rad_s=self.choice.max_turn_rad_s,
        )
        if self.topics.tf:
            self._tf = self._read_tf()
        if self.choice.pose_source == 'tf':
            if self._tf is None or not self._tf.map_frame:
                raise BagError(
                    f'{self.bag.path}: no transform leads to frame {self.topics.scan_frame!r} of '
                    f'{self.topics.scan.name}: expected map -> odom -> base -> sensor in tf'
                )
            source = self._tf
        self.placer = ScanPlacer(
            source, timeout_s=1.0, max_waiting=1_000_000, deskew=self.choice.deskew
        )

    def _read_tf(self) -> TfPoses | None:
        """Return the transforms of the bag; None where they do not lead to the sensor.

        Without a frame above the base they only tell where the sensor sits.
        """
        tree = TransformTree()
        for record in self.bag.records(tuple(topic.name for topic in self.topics.tf)):
            for entry in read_transforms(self.bag.decode(record)).entries:
                tree.add(entry, static=is_static(record.topic), arrival_ns=record.time_ns)
        chain = tree.ancestors(self.topics.scan_frame)  # the sensor first, the root last
        frames = guess_frames(tree, self.topics.scan_frame)
        if frames is None and len(chain) < 2:
            return None
        where = frames or TfFrames('', chain[-1])
        return TfPoses(
            tree,
            *where,
            max_gap_s=self.choice.max_pose_gap_s,
            max_speed_m_s=self.choice.max_speed_m_s,
            max_turn_rad_s=self.choice.max_turn_rad_s,
        )

    def __iter__(self) -> Iterator[PlacedScan]:
        """Yield placed scans in order of their stamps."""
        read_pose = (
            messages.read_particles
            if self.choice.pose_source == 'particles'
            else messages.read_pose
        )
        ranges = self.choice.sensor == 'range'
        read_scan = messages.read_range if ranges else messages.read_scan
        scan_names = {topic.name for topic in self.topics.scans}
        poses = () if self.choice.pose_source == 'tf' else (self.topics.pose.name,)
        for record in self.bag.records((*scan_names, *poses)):
            message = self.bag.decode(record)
            where = f'{self.bag.path}: {record.topic} at {record.time_ns / 1e9:.3f} s'
            try:
                if record.topic in scan_names:
                    self.on_scan()
                    if not ranges:
                        frame = messages.frame_of(message)
                        self._check_frame(where, frame, self.topics.scan_frame)
                    self.placer.add_scan(read_scan(message))
                else:
                    self._check_frame(where, messages.frame_of(message), self.topics.map_frame)
                    self.placer.add_pose(messages.stamp_of(message), read_pose(message))
            except (ScanError, PoseError) as error:
                self.placer.drop('scan_invalid' if record.topic in scan_names else 'pose_invalid')
                self.first_fault = self.first_fault or f'{where}: {error}'
            yield from map(self._mounted, self.placer.placed())
        yield from map(self._mounted, self.placer.flush())
        if self.placed == 0:
            raise BagError(
                f'{self.bag.path}: none of {self.topics.n_scans} scans could be placed '
                f'({dict(self.placer.dropped)}): expected poses on {self.topics.pose.name} around '
                f'the stamps of {self.topics.scan.name}'
                + (f'; the first fault: {self.first_fault}' if self.first_fault else '')
            )

    def _mounted(self, taken: RobotScan) -> PlacedScan:
        self.placed += 1
        frame = taken.scan.frame_id
        self.frames.add(frame)
        return taken.on_mount(self._mount(frame, taken.scan.stamp_ns))

    def _mount(self, frame: str, stamp_ns: int) -> SensorMount:
        by_parameters = self.choice.mounts != MountConfig()
        if self._tf is None or by_parameters:
            return sensor_mount(self.choice.mounts, frame)
        found = self._tf.mount_of(frame, stamp_ns)
        if found is None:
            return SensorMount()
        self.mounted_by_tf.setdefault(frame, found)
        return found

    def _check_frame(self, where: str, frame: str, expected: str) -> None:
        if frame != expected:
            raise BagError(f'{where}: frame_id is {frame!r}: expected {expected!r} as before')


@contextlib.contextmanager
def open_scans(path: Path, choice: StreamChoice) -> Iterator[PlacedScans]:
    """Open a bag and yield its scans, to be iterated over while it is open.

    Raises BagError that says what is missing.
    """
    with BagReader(path) as bag:
        yield PlacedScans(bag, choose_topics(bag, choice), choice)
