"""Poses of a recording, computed at the stamps of its scans, for nodes that cannot take them.

Transforms cannot be sent where tf2_msgs is not installed, those to a frame that always bear the
stamp 0 are of no use to a node (as `choose_topics` found them, whose answer `map` goes by), and
the poses of a file are on no topic.
What tf says of the sensors is told as the parameter that says the same; of those that move on the
robot it is sent on a topic of its own (`mount_topic`), at the stamp of each scan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.publisher import Publisher

from ogm_mcmc.config.nodes import ReplayConfig
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.mounts import MountFound, mounts_setting
from ogm_mcmc.engine.placing import final_belief
from ogm_mcmc.engine.pose_history import RESTART_NS, Unplaceable, Waiting
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.errors import BagError, PoseError
from ogm_mcmc.io import messages
from ogm_mcmc.io.bag_headers import StoredHeader, stored_header
from ogm_mcmc.io.bags import BagReader, BagRecord
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.mount_topic import TOPIC as MOUNT_TOPIC
from ogm_mcmc.ros.mount_topic import MountOutlet

__all__ = ['ComputedPoses', 'computed_poses']

TOPIC = 'pose'


class ComputedPoses:
    """Publishes on `pose` where the robot was at the stamp of each scan, and what moves on it."""

    def __init__(self, node: Node, scans: PlacedScans, moving: Iterable[str] = ()) -> None:
        self.topics = scans.topics
        self.source = scans.robot_poses()
        self.mounts = scans.placer.mounts
        self.scan_names = {topic.name for topic in self.topics.scans}
        self.outlet = node.create_publisher(PoseWithCovarianceStamped, TOPIC, qos.POSES)
        frames = frozenset(moving)
        self.moving = MountOutlet(node, self.topics.base_frame, frames) if frames else None
        self.missing = 0
        self.restart()

    @property
    def outlets(self) -> dict[str, Publisher]:
        """Publishers by topic."""
        moving = {} if self.moving is None else {MOUNT_TOPIC: self.moving.publisher}
        return {TOPIC: self.outlet, **moving}

    def restart(self) -> None:
        """Begin the recording again: scans are not those of a moment ago, however short it is."""
        self._last_ns = -RESTART_NS - 1

    def before(self, record: BagRecord) -> list[str]:
        """Publish what a scan that goes next needs; return on which topics."""
        header = stored_header(record) if record.topic in self.scan_names else None
        if header is None:
            return []
        try:
            belief = final_belief(self.source, header.stamp_ns)
        except (Waiting, Unplaceable, PoseError):
            self.missing += 1
            return []
        sent = self._send_mount(header)
        # Scans of several lasers may share a stamp; an earlier one lies between poses sent.
        if not 0 <= self._last_ns - header.stamp_ns <= RESTART_NS:
            message = PoseWithCovarianceStamped()
            messages.fill_pose(message, belief, self.topics.map_frame, header.stamp_ns)
            self.outlet.publish(message)
            self._last_ns = header.stamp_ns
            sent.append(TOPIC)
        return sent

    def _send_mount(self, header: StoredHeader) -> list[str]:
        if self.moving is None or self.mounts is None or header.frame not in self.moving.frames:
            return []
        try:
            mount = self.mounts.at(header.frame, header.stamp_ns, 0.0)
        except (Waiting, Unplaceable):
            return []
        self.moving.send(header.frame, mount, header.stamp_ns)
        return [MOUNT_TOPIC]


def computed_poses(
    node: Node, bag: BagReader, settings: ReplayConfig, *, tf_is_sent: bool
) -> ComputedPoses | None:
    """Return what publishes poses, None where none are asked for or needed.

    Logs what was chosen and how a node is told of it. Raises BagError where poses that are asked
    for are not there.
    """
    log: Callable[[str], object] = node.get_logger().info
    asked = settings.pose_source not in ('auto', 'none') or settings.trajectory != ''
    if settings.pose_source == 'none' or (not asked and settings.topics):
        return None
    choice = StreamChoice(
        scan_topic=settings.scan_topic,
        map_frame=settings.map_frame,
        base_frame=settings.base_frame,
        pose_source=settings.pose_source,
        trajectory=Path(settings.trajectory) if settings.trajectory else None,
        trajectory_stamps=Path(settings.trajectory_stamps) if settings.trajectory_stamps else None,
        deviations=settings.trajectory_deviations,
    )
    try:
        topics = choose_topics(bag, choice)
        topics.require_stamps(bag.path)
    except BagError:
        if asked:
            raise
        return None
    if not asked and tf_is_sent and not topics.unstamped_frames:
        return None
    scans = PlacedScans(bag, topics, choice)
    for line in topics.remarks:
        log(line)
    mounts = [one for one in scans.sensor_mounts().values() if one.origin]
    moving = [one.frame for one in mounts if one.moves]
    told = _told_of_mounts(mounts, topics.base_frame)
    if not (asked or moving or topics.pose_source == 'tf'):
        log(f'for the nodes: pose_source:={topics.pose_source} {told}'.rstrip())
        return None
    log(
        f'poses of {topics.base_frame} are computed and published on {TOPIC}; for the nodes: '
        f'pose_source:=pose map_frame:={topics.map_frame} {told}'.rstrip()
    )
    if moving:
        verb = 'moves' if len(moving) == 1 else 'move'
        log(f'{", ".join(moving)} {verb} on the robot: where to is published on {MOUNT_TOPIC}')
    return ComputedPoses(node, scans, moving)


def _told_of_mounts(mounts: list[MountFound], base_frame: str) -> str:
    """Return the parameters that say where sensors sit."""
    fixed = [one for one in mounts if not one.moves]
    told = f"mount.frames:='{mounts_setting(fixed)}'" if fixed else ''
    if len(fixed) == len(mounts):
        return told
    return f'mount_source:=topic base_frame:={base_frame} {told}'.rstrip()
