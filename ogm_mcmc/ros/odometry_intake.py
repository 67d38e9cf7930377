"""Odometry beside the poses in use: where the robot was at its scans by its wheels."""

from __future__ import annotations

import time
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node

from ogm_mcmc.config import PosesConfig
from ogm_mcmc.engine.odometry import (
    OdometryTrack,
    is_of_base,
    odometry_frame,
)
from ogm_mcmc.engine.pose_choice import is_called_odom
from ogm_mcmc.engine.still_clocks import StillClocks
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.io import messages
from ogm_mcmc.ros.pose_topics import AnyReliability
from ogm_mcmc.ros.scan_intake import ScanIntake, limit_poses

__all__ = ['OdometryIntake']

TOPIC = 'odom'


class OdometryIntake:
    """Keeps the odometry at the stamps of recorded scans, for joint poses that want it.

    With poses from tf it is the frame of odometry above the base, else the topic `odom`. Where
    poses are those of odometry themselves there is none beside them: it would count twice.
    """

    def __init__(self, node: Node, intake: ScanIntake, poses: PosesConfig) -> None:
        self.node, self.intake = node, intake
        source = intake.settings.pose_source
        beside = source != 'odom' and not is_called_odom(intake.settings.map_frame)
        self.used = poses.joint and poses.trajectory.odometry and beside
        self.from_tf = source == 'tf'
        self.track = OdometryTrack()
        self._clock = StillClocks()
        self._topic: AnyReliability | None = None
        self.configure()

    def configure(self) -> None:
        """Take over the limits of poses, as the scans have them."""
        limit_poses(self.track.source, self.intake.placing)

    def subscribe(self) -> None:
        """Begin to receive."""
        if self.used and not self.from_tf:
            self._topic = AnyReliability(self.node, Odometry, TOPIC, self.on_odometry)

    def adapt(self) -> None:
        """Listen as the publisher speaks, and keep what is known by now."""
        if self._topic is not None:
            self._topic.adapt()
        self.track.settle()

    def on_odometry(self, msg: Any) -> None:
        """Take a pose of the odometry of the base."""
        problems, frame = self.intake.problems, messages.frame_of(msg)
        child = messages.plain_frame(msg.child_frame_id)
        base = self.intake.mounts.base_frame
        if not is_called_odom(frame):
            problems.warn(
                'odometry_wrong_frame',
                f'odometry in frame {frame!r} dropped: expected one with odom in its name',
            )
            return
        if not is_of_base(child, base, self.intake.transforms.tree):
            problems.warn(
                'odometry_wrong_child',
                f'odometry of {child!r} dropped: expected {base!r} (parameter base_frame)',
            )
            return
        try:
            belief = messages.read_pose(msg, with_covariance=False)
        except PoseError as error:
            problems.warn('odometry_invalid', f'odometry dropped: {error}')
            return
        stamp_ns = messages.stamp_of(msg)
        again = self._clock.add(TOPIC, stamp_ns, time.monotonic())
        if again and self._clock.stands(TOPIC, stamp_ns):
            problems.warn(
                'odometry_unstamped',
                f'odometry dropped: its stamp has been {stamp_ns / 1e9:.3f} s for more than 1 s: '
                'a clock stands still',
            )
            return
        self.track.add(stamp_ns, belief)

    def want(self, placed: PlacedScan) -> None:
        """Have the odometry at a scan kept."""
        if not self.used:
            return
        if self.from_tf and not isinstance(self.track.source, TfPoses):
            tree, base = self.intake.transforms.tree, self.intake.mounts.base_frame
            frame = odometry_frame(tree, base)
            if not frame:
                return
            self.track = OdometryTrack(TfPoses(tree, frame, base))
            self.configure()
        self.track.want(placed.scan.stamp_ns)

    def at(self, stamp_ns: int) -> Pose2D | None:
        """Return where the robot was at a scan by its wheels; None where that is not known."""
        return self.track.at(stamp_ns)

    def clear(self) -> None:
        """Forget it."""
        self.track.clear()
        self._clock.clear()

    def values(self) -> dict[str, object]:
        """Return what is known, for /diagnostics."""
        return {'scans with odometry': len(self.track)} if self.used else {}
