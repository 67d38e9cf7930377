"""Refined poses as messages: the whole way, and the latest pose with its covariance."""

from __future__ import annotations

import math

from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path

from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.messages import time_parts
from ogm_mcmc.ros.managed_node import ManagedNode
from ogm_mcmc.ros.qos import LATCHED

__all__ = ['TrajectoryPublisher', 'correction_values', 'path_message', 'pose_message']

# Where x, y and yaw are in a row of 6 by 6 numbers.
PLANAR = (0, 1, 5)


def path_message(trajectory: RefinedTrajectory, frame_id: str) -> Path:
    """Return all poses, each with its stamp; that of the message is the last one."""
    message = Path()
    message.header.frame_id = frame_id
    for stamp_ns, belief in zip(trajectory.stamps_ns, trajectory.beliefs, strict=True):
        pose = PoseStamped()
        pose.header.frame_id = frame_id
        pose.header.stamp.sec, pose.header.stamp.nanosec = time_parts(stamp_ns)
        _place(pose.pose, belief.mean)
        message.poses.append(pose)
    if message.poses:
        message.header.stamp = message.poses[-1].header.stamp
    return message


def pose_message(trajectory: RefinedTrajectory, frame_id: str) -> PoseWithCovarianceStamped:
    """Return the latest pose; its covariance is 0 all over where it is not known."""
    message = PoseWithCovarianceStamped()
    belief = trajectory.beliefs[-1]
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = time_parts(trajectory.stamps_ns[-1])
    _place(message.pose.pose, belief.mean)
    if belief.covariance is not None:
        for i, row in enumerate(PLANAR):
            for j, column in enumerate(PLANAR):
                message.pose.covariance[6 * row + column] = float(belief.covariance[i, j])
    return message


def _place(pose: Pose, at: Pose2D) -> None:
    pose.position.x, pose.position.y = at.x_m, at.y_m
    pose.orientation.z = math.sin(0.5 * at.yaw_rad)
    pose.orientation.w = math.cos(0.5 * at.yaw_rad)


def correction_values(trajectory: RefinedTrajectory | None) -> dict[str, object]:
    """Return what /diagnostics says of refined poses."""
    if trajectory is None:
        return {}
    correction, covariance = trajectory.correction, trajectory.beliefs[-1].covariance
    values: dict[str, object] = {
        'poses refined': len(trajectory.beliefs),
        'correction of the latest pose, x (m)': f'{correction.x_m:.4f}',
        'correction of the latest pose, y (m)': f'{correction.y_m:.4f}',
        'correction of the latest pose, yaw (degrees)': f'{math.degrees(correction.yaw_rad):.4f}',
    }
    if covariance is not None:
        place = math.sqrt(float(covariance[0, 0] + covariance[1, 1]))
        yaw = math.degrees(math.sqrt(float(covariance[2, 2])))
        values['standard deviation of the latest pose (m)'] = f'{place:.4f}'
        values['standard deviation of its yaw (degrees)'] = f'{yaw:.4f}'
    if trajectory.points is not None:
        low, found, high = trajectory.points
        said = f'{found:.4f} m ({low:.4f} to {high:.4f})'
        values['points off their lines (95 % interval)'] = said
    return values


class TrajectoryPublisher:
    """Sends `trajectory_refined` and `pose_refined`, latched, whenever they are others.

    The latest pose is sent once its covariance is known: 0 would say that it is exact. A way of
    which nothing holds any more is followed by one without poses; no such pose can be said, so
    the topic begins anew, and whoever comes then gets none.
    """

    def __init__(self, node: ManagedNode) -> None:
        self.node = node
        self.path = node.create_publisher(Path, 'trajectory_refined', LATCHED)
        self.pose = node.create_publisher(PoseWithCovarianceStamped, 'pose_refined', LATCHED)
        self._shown: RefinedTrajectory | None = None

    def publish(self, trajectory: RefinedTrajectory | None, frame_id: str) -> None:
        """Send poses, unless they were the last ones sent; a way without any for None."""
        if trajectory is None:
            self.clear(frame_id)
        elif trajectory is not self._shown:
            self._shown = trajectory
            self.path.publish(path_message(trajectory, frame_id))
            if trajectory.beliefs[-1].covariance is not None:
                self.pose.publish(pose_message(trajectory, frame_id))

    def clear(self, frame_id: str) -> None:
        """Send a way without poses, and let the latest pose go, where they were sent before."""
        if self._shown is not None:
            self._shown = None
            message = Path()
            message.header.frame_id = frame_id
            self.path.publish(message)
            self.pose = self.node.without_latched(self.pose)
