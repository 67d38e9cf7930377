"""Read and fill message-shaped objects; imports no ROS.

Messages of rclpy and of the rosbags library carry the same field names, so both work here. Each
reader checks what it reads and raises ScanError or PoseError with field, value and expectation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import PoseError, ScanError
from ogm_mcmc.geometry import (
    CellBox,
    GridSpec,
    Pose2D,
    PoseBelief,
    PoseSamples,
    Scan,
    pose_from_quaternion,
)

__all__ = [
    'fill_grid_header',
    'fill_grid_update',
    'frame_of',
    'read_particles',
    'read_pose',
    'read_range',
    'read_scan',
    'stamp_of',
    'time_parts',
]

NS_PER_S = 1_000_000_000

# Smaller negative eigenvalues are rounding of the sender, m^2 or rad^2.
COVARIANCE_SLACK = 1e-9


def stamp_of(msg: Any) -> int:
    """Nanoseconds of a header; ROS 1 messages read by rosbags carry the same field names."""
    stamp = msg.header.stamp
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def time_parts(stamp_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec)."""
    return divmod(stamp_ns, NS_PER_S)


def frame_of(msg: Any) -> str:
    """Frame id without the leading slash of ROS 1."""
    return str(msg.header.frame_id).lstrip('/')


def read_scan(msg: Any) -> Scan:
    """Read a sensor_msgs/LaserScan. Raises ScanError when it contradicts itself."""
    ranges = msg.ranges
    # array.array of rclpy shares its memory with the message; the message is not used again.
    values = ranges if isinstance(ranges, np.ndarray) else np.frombuffer(ranges, np.float32)
    return Scan.checked(
        values,
        angle_min_rad=float(msg.angle_min),
        angle_max_rad=float(msg.angle_max),
        angle_increment_rad=float(msg.angle_increment),
        range_min_m=float(msg.range_min),
        range_max_m=float(msg.range_max),
        stamp_ns=stamp_of(msg),
        frame_id=frame_of(msg),
    )


def read_range(msg: Any) -> Scan:
    """Read a sensor_msgs/Range as a scan of one cone. Raises ScanError.

    A reading of exactly max_range is what many drivers send when no echo came: it becomes inf,
    as REP 117 would have it.
    """
    reading, furthest = float(msg.range), float(msg.max_range)
    if float(msg.min_range) == furthest:
        raise ScanError(
            f'min_range and max_range are both {furthest:g}: expected a sensor that measures '
            'distances, not one of a fixed distance'
        )
    return Scan.checked(
        np.array([math.inf if reading == furthest else reading]),
        angle_min_rad=0.0,
        angle_increment_rad=0.0,
        range_min_m=float(msg.min_range),
        range_max_m=furthest,
        stamp_ns=stamp_of(msg),
        frame_id=frame_of(msg),
        beam_width_rad=float(msg.field_of_view),
    )


def read_pose(msg: Any) -> PoseBelief:
    """Read PoseWithCovarianceStamped, Odometry or PoseStamped.

    Raises PoseError for a pose that is not finite or not level, or a covariance that is not
    positive semi-definite. An all-zero covariance is a known pose.
    """
    holder = msg.pose
    pose = getattr(holder, 'pose', holder)
    mean = _planar(pose)
    flat = getattr(holder, 'covariance', None)
    if flat is None:
        return PoseBelief(mean)
    full = np.asarray(flat, np.float64).reshape(6, 6)
    covariance = _checked_covariance(full[np.ix_((0, 1, 5), (0, 1, 5))])
    return PoseBelief(mean, covariance)


def _planar(pose: Any) -> Pose2D:
    position, q = pose.position, pose.orientation
    quaternion = (float(q.x), float(q.y), float(q.z), float(q.w))
    numbers = (float(position.x), float(position.y), *quaternion)
    if not all(map(math.isfinite, numbers)):
        raise PoseError(f'pose {numbers[:2]} {quaternion}: expected finite numbers')
    planar, upside_down = pose_from_quaternion(numbers[:2], quaternion)
    if upside_down:
        raise PoseError('pose is upside down: expected the robot on its feet')
    return planar


def _checked_covariance(covariance: Float64Array) -> Float64Array:
    if not np.isfinite(covariance).all():
        raise PoseError('covariance: expected finite numbers')
    scale = max(1.0, float(np.abs(covariance).max()))
    if np.abs(covariance - covariance.T).max() > 1e-6 * scale:
        raise PoseError('covariance of x, y, yaw: expected a symmetric matrix')
    lowest = float(np.linalg.eigvalsh(covariance)[0])
    if lowest < -COVARIANCE_SLACK * scale:
        raise PoseError(
            f'covariance of x, y, yaw has eigenvalue {lowest:.3g}: expected positive semi-definite'
        )
    return covariance


def read_particles(msg: Any) -> PoseBelief:
    """Read a geometry_msgs/PoseArray as equally weighted samples, or a nav2_msgs/ParticleCloud.

    Raises PoseError when it is empty, holds a pose that is not finite or not level, or weights
    that cannot be normalised.
    """
    weights = None
    if hasattr(msg, 'particles'):
        planar = [_planar(particle.pose) for particle in msg.particles]
        weights = np.array([float(particle.weight) for particle in msg.particles])
    else:
        planar = [_planar(pose) for pose in msg.poses]
    table = np.array([(p.x_m, p.y_m, p.yaw_rad) for p in planar])
    samples = PoseSamples.checked(table, weights)
    return PoseBelief(samples.mean(), samples.covariance(), samples)


def fill_grid_header(msg: Any, spec: GridSpec, frame_id: str, stamp_ns: int) -> None:
    """Fill everything of a nav_msgs/OccupancyGrid but its data."""
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = time_parts(stamp_ns)
    msg.info.map_load_time.sec, msg.info.map_load_time.nanosec = time_parts(stamp_ns)
    msg.info.resolution = spec.resolution_m
    msg.info.width, msg.info.height = spec.width, spec.height
    msg.info.origin.position.x = spec.origin_x_m
    msg.info.origin.position.y = spec.origin_y_m
    msg.info.origin.orientation.w = 1.0


def fill_grid_update(msg: Any, spec: GridSpec, box: CellBox, frame_id: str, stamp_ns: int) -> None:
    """Fill everything of a map_msgs/OccupancyGridUpdate but its data."""
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = time_parts(stamp_ns)
    msg.x, msg.y = box.column0 - spec.column0, box.row0 - spec.row0
    msg.width, msg.height = box.column1 - box.column0, box.row1 - box.row0
