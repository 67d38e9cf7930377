"""Poses of a recording, computed at the stamps of its scans, for nodes that cannot take them.

Transforms cannot be sent where tf2_msgs is not installed, and the poses of a file are on no topic.
What tf says of the sensors is told as the parameter that says the same. A parameter cannot move:
where one sensor moves on the robot, each pose is that of a base on which it would sit as the
parameter says, so that the sensor is where it was.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node

from ogm_mcmc.config.nodes import ReplayConfig
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_topics import StreamChoice, choose_topics
from ogm_mcmc.engine.mounts import MountFound, mounts_setting
from ogm_mcmc.engine.placing import MountSource
from ogm_mcmc.engine.pose_history import Unplaceable, Waiting
from ogm_mcmc.errors import BagError, PoseError
from ogm_mcmc.io import messages
from ogm_mcmc.io.bag_headers import stored_header
from ogm_mcmc.io.bags import BagReader, BagRecord
from ogm_mcmc.ros import qos

__all__ = ['ComputedPoses', 'computed_poses']

TOPIC = 'pose'


class ComputedPoses:
    """Publishes on `pose` where the robot was at the stamp of each scan."""

    def __init__(self, node: Node, scans: PlacedScans) -> None:
        self.topics = scans.topics
        self.source = scans.robot_poses()
        self.scan_names = {topic.name for topic in self.topics.scans}
        self.mounts, self.fixed = _moving_mount(scans)
        self.outlet = node.create_publisher(PoseWithCovarianceStamped, TOPIC, qos.POSES)
        self.missing = 0

    def before(self, record: BagRecord) -> bool:
        """Publish the pose of a scan that goes next; return whether there was one."""
        if record.topic not in self.scan_names:
            return False
        header = stored_header(record)
        if header is None:
            return False
        try:
            belief = self.source.at(header.stamp_ns)
            if self.fixed is not None and self.mounts is not None:
                now = self.mounts.at(self.fixed.frame, header.stamp_ns, 0.0)
                belief = belief.moved(now.pose.compose(self.fixed.mount.pose.inverse()))
        except (Waiting, Unplaceable, PoseError):
            self.missing += 1
            return False
        message = PoseWithCovarianceStamped()
        messages.fill_pose(message, belief, self.topics.map_frame, header.stamp_ns)
        self.outlet.publish(message)
        return True


def _moving_mount(scans: PlacedScans) -> tuple[MountSource | None, MountFound | None]:
    """Return the mounts, and one place of the only sensor if it moves on the robot."""
    first = dict(scans.sensor_mounts())
    moves = [one for one in first.values() if one.origin == 'tf']
    return scans.placer.mounts, moves[0] if moves and len(first) == 1 else None


def _say_of_moving(
    found: list[MountFound], *, computed: bool, source: str, log: Callable[[str], object]
) -> None:
    """Say how sensors that move on the robot are taken by nodes that get no tf."""
    moving = ', '.join(one.frame for one in found if one.origin == 'tf')
    if not moving:
        return
    if computed and len(found) == 1:
        log(f'{moving} moves on the robot: poses are those that put it where it was')
        return
    other = '' if computed or len(found) > 1 else f'; pose_source {source} follows it'
    log(f'{moving} moves on the robot: mount.frames cannot follow it{other}')


def computed_poses(
    node: Node, bag: BagReader, settings: ReplayConfig, *, tf_is_sent: bool
) -> ComputedPoses | None:
    """Return what publishes poses, None where none are asked for or needed.

    Logs what was chosen and how a node is told of it. Raises BagError where poses that are asked
    for are not there.
    """
    log: Callable[[str], object] = node.get_logger().info
    asked = settings.pose_source not in ('auto', 'none') or settings.trajectory != ''
    if settings.pose_source == 'none' or (not asked and (tf_is_sent or settings.topics)):
        return None
    choice = StreamChoice(
        scan_topic=settings.scan_topic,
        map_frame=settings.map_frame,
        base_frame=settings.base_frame,
        pose_source='auto' if settings.pose_source == 'none' else settings.pose_source,
        trajectory=Path(settings.trajectory) if settings.trajectory else None,
        trajectory_stamps=Path(settings.trajectory_stamps) if settings.trajectory_stamps else None,
    )
    try:
        topics = choose_topics(bag, choice)
        topics.require_stamps(bag.path)
    except BagError:
        if asked:
            raise
        return None
    scans = PlacedScans(bag, topics, choice)
    for line in topics.remarks:
        log(line)
    mounts = [one for one in scans.sensor_mounts().values() if one.origin]
    computed = asked or topics.pose_source == 'tf'
    _say_of_moving(mounts, computed=computed, source=topics.pose_source, log=log)
    told = f"mount.frames:='{mounts_setting(mounts)}'" if mounts else ''
    if not computed:
        log(f'for the nodes: pose_source:={topics.pose_source} {told}'.rstrip())
        return None
    log(
        f'poses of {topics.base_frame} are computed and published on {TOPIC}; for the nodes: '
        f'pose_source:=pose map_frame:={topics.map_frame} {told}'.rstrip()
    )
    return ComputedPoses(node, scans)
