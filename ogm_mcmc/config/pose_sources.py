"""Where poses come from, by name: the same names in the nodes and offline."""

from __future__ import annotations

__all__ = ['OFFLINE_POSE_SOURCES', 'POSE_SOURCES', 'POSE_SOURCES_TEXT']

# By name: the types of message that carry such poses (the second of tf is what ROS 1 recorded
# before tf2). A node takes them from the topic of that name, tf from /tf and /tf_static.
POSE_SOURCES = {
    'pose': ('geometry_msgs/msg/PoseWithCovarianceStamped',),
    'pose_stamped': ('geometry_msgs/msg/PoseStamped',),
    'odom': ('nav_msgs/msg/Odometry',),
    'particles': ('geometry_msgs/msg/PoseArray',),
    'particle_cloud': ('nav2_msgs/msg/ParticleCloud',),
    'tf': ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'),
}

POSE_SOURCES_TEXT = (
    'pose: PoseWithCovarianceStamped; pose_stamped: PoseStamped; odom: Odometry; particles: '
    'PoseArray; particle_cloud: ParticleCloud; tf: map_frame to base_frame'
)

# Offline a recording is there as a whole: auto takes what covers its scans best.
OFFLINE_POSE_SOURCES = ('auto', *POSE_SOURCES)
