"""Messages for bags, made with the types of the rosbags library; no ROS needed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.bags import typestore
from ogm_mcmc.io.messages import time_parts

__all__ = [
    'ODOMETRY',
    'PARTICLES',
    'PARTICLE_CLOUD',
    'PATH',
    'POSE',
    'POSE_STAMPED',
    'RANGE',
    'SCAN',
    'laser_scan',
    'odometry',
    'path',
    'pose_array',
    'pose_stamped',
    'pose_with_covariance',
    'range_reading',
]

SCAN = 'sensor_msgs/msg/LaserScan'
POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
PARTICLES = 'geometry_msgs/msg/PoseArray'
PARTICLE_CLOUD = 'nav2_msgs/msg/ParticleCloud'
RANGE = 'sensor_msgs/msg/Range'
ODOMETRY = 'nav_msgs/msg/Odometry'
POSE_STAMPED = 'geometry_msgs/msg/PoseStamped'
PATH = 'nav_msgs/msg/Path'


def _make(name: str, *fields: Any) -> Any:
    return typestore().types[name](*fields)


def _header(stamp_ns: int, frame_id: str) -> Any:
    stamp = _make('builtin_interfaces/msg/Time', *time_parts(stamp_ns))
    return _make('std_msgs/msg/Header', stamp, frame_id)


def _pose(pose: Pose2D) -> Any:
    half = 0.5 * pose.yaw_rad
    return _make(
        'geometry_msgs/msg/Pose',
        _make('geometry_msgs/msg/Point', pose.x_m, pose.y_m, 0.0),
        _make('geometry_msgs/msg/Quaternion', 0.0, 0.0, math.sin(half), math.cos(half)),
    )


def _with_covariance(pose: Pose2D, covariance: Float64Array) -> Any:
    full = np.zeros((6, 6))
    full[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    return _make('geometry_msgs/msg/PoseWithCovariance', _pose(pose), full.reshape(36))


def pose_with_covariance(
    stamp_ns: int, frame_id: str, pose: Pose2D, covariance: Float64Array
) -> Any:
    """PoseWithCovarianceStamped; covariance (3, 3) of x, y, yaw."""
    return _make(POSE, _header(stamp_ns, frame_id), _with_covariance(pose, covariance))


def pose_stamped(stamp_ns: int, frame_id: str, pose: Pose2D) -> Any:
    """PoseStamped."""
    return _make(POSE_STAMPED, _header(stamp_ns, frame_id), _pose(pose))


def pose_array(stamp_ns: int, frame_id: str, poses: Float64Array) -> Any:
    """PoseArray of (M, 3) x, y, yaw."""
    members = [_pose(Pose2D(*map(float, row))) for row in poses]
    return _make(PARTICLES, _header(stamp_ns, frame_id), members)


def odometry(stamp_ns: int, pose: Pose2D, speed_m_s: float, turn_rad_s: float) -> Any:
    """Odometry from `odom` to `base_link`; covariances are not known and stay 0."""
    twist = _make(
        'geometry_msgs/msg/Twist',
        _make('geometry_msgs/msg/Vector3', speed_m_s, 0.0, 0.0),
        _make('geometry_msgs/msg/Vector3', 0.0, 0.0, turn_rad_s),
    )
    return _make(
        ODOMETRY,
        _header(stamp_ns, 'odom'),
        'base_link',
        _with_covariance(pose, np.zeros((3, 3))),
        _make('geometry_msgs/msg/TwistWithCovariance', twist, np.zeros(36)),
    )


def path(stamp_ns: int, frame_id: str, stamps_ns: Iterable[int], poses: Iterable[Pose2D]) -> Any:
    """Path whose poses carry their own stamps."""
    members = [
        _make(POSE_STAMPED, _header(at_ns, frame_id), _pose(pose))
        for at_ns, pose in zip(stamps_ns, poses, strict=True)
    ]
    return _make(PATH, _header(stamp_ns, frame_id), members)


def laser_scan(
    stamp_ns: int,
    frame_id: str,
    ranges: Float32Array,
    *,
    angle_min: float,
    angle_increment: float,
    range_max: float,
    range_min: float = 0.0,
    scan_time: float = 0.0,
) -> Any:
    """LaserScan; angle_max is the last beam's."""
    return _make(
        SCAN,
        _header(stamp_ns, frame_id),
        angle_min,
        angle_min + angle_increment * (ranges.size - 1),
        angle_increment,
        0.0,
        scan_time,
        range_min,
        range_max,
        np.ascontiguousarray(ranges, np.float32),
        np.zeros(0, np.float32),
    )


def range_reading(
    stamp_ns: int,
    frame_id: str,
    reading_m: float,
    *,
    field_of_view: float,
    range_min: float,
    range_max: float,
) -> Any:
    """Range of an ultrasonic sensor; inf where no echo came."""
    sonar, variance_unknown = 0, 0.0
    fields = (_header(stamp_ns, frame_id), sonar, field_of_view, range_min, range_max, reading_m)
    return _make(RANGE, *fields, variance_unknown)
