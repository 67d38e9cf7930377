"""Read and fill message-shaped objects; imports no ROS.

Messages of rclpy and of the rosbags library carry the same field names, so both work here. Each
reader checks what it reads and raises ScanError or PoseError with field, value and expectation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, Float64Array, Int64Array
from ogm_mcmc.errors import PoseError, ScanError
from ogm_mcmc.geometry import (
    FURTHEST_M,
    CellBox,
    GridSpec,
    Pose2D,
    PoseBelief,
    PoseSamples,
    Scan,
    pose_from_quaternion,
)
from ogm_mcmc.geometry.scan import Remark, say_nothing

__all__ = [
    'fill_grid_header',
    'fill_grid_update',
    'fill_pose',
    'frame_of',
    'plain_frame',
    'read_particles',
    'read_path',
    'read_places',
    'read_pose',
    'read_range',
    'read_scan',
    'stamp_of',
    'time_parts',
]

NS_PER_S = 1_000_000_000

# Smaller negative eigenvalues are rounding of the sender, m^2 or rad^2.
COVARIANCE_SLACK = 1e-9

# A name of ROS has at most 255 characters.
MOST_NAME = 255

# Share of range_max by which a reading of it may be off: some steps of float32.
ROUNDING = 1e-6

# m^2 or rad^2: a belief wider than 1 km knows nothing.
WIDEST_VARIANCE = 1e6


def stamp_of(msg: Any) -> int:
    """Nanoseconds of a header; ROS 1 messages read by rosbags carry the same field names."""
    stamp = msg.header.stamp
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def time_parts(stamp_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec)."""
    return divmod(stamp_ns, NS_PER_S)


def frame_of(msg: Any) -> str:
    """Frame id without the leading slash of ROS 1."""
    return plain_frame(msg.header.frame_id)


def plain_frame(name: Any) -> str:
    """Name of a frame without the leading slash of ROS 1, and no longer than any frame's is.

    A longer one would fill logs, diagnostics and memory.
    """
    return str(name).lstrip('/')[:MOST_NAME]


def read_scan(msg: Any, remark: Remark = say_nothing) -> Scan:
    """Read a sensor_msgs/LaserScan. Raises ScanError when it contradicts itself beyond use.

    A reading of range_max is what many drivers send when nothing was hit: it becomes inf, as
    REP 117 would have it. `remark` gets one line for each odd value and how it was read.
    """
    ranges = msg.ranges
    # array.array of rclpy shares its memory with the message.
    values = ranges if isinstance(ranges, np.ndarray) else np.frombuffer(ranges, np.float32)
    return Scan.checked(
        _no_returns(values, float(msg.range_max)),
        angle_min_rad=float(msg.angle_min),
        angle_max_rad=float(msg.angle_max),
        angle_increment_rad=float(msg.angle_increment),
        range_min_m=float(msg.range_min),
        range_max_m=float(msg.range_max),
        stamp_ns=stamp_of(msg),
        frame_id=frame_of(msg),
        time_increment_s=float(msg.time_increment),
        scan_time_s=float(msg.scan_time),
        remark=remark,
    )


def _no_returns(ranges: AnyArray, furthest: float) -> Float32Array:
    """Return a copy of ranges (B,) in which those of `furthest` are inf, up to rounding.

    A message holds float32; whoever fills one in Python may have given more digits, and some
    drivers send the next number below.
    """
    with np.errstate(over='ignore'):
        readings = np.array(ranges, np.float32)
        low, high = (
            np.float32(furthest * (1.0 - ROUNDING)),
            np.float32(furthest * (1.0 + ROUNDING)),
        )
    readings[(readings >= low) & (readings <= high)] = np.inf
    return readings


def read_range(msg: Any) -> Scan:
    """Read a sensor_msgs/Range as a scan of one cone. Raises ScanError.

    A reading of max_range is what many drivers send when no echo came: it becomes inf, as REP 117
    would have it.
    """
    furthest = float(msg.max_range)
    if float(msg.min_range) == furthest:
        raise ScanError(
            f'min_range and max_range are both {furthest:g}: expected a sensor that measures '
            'distances, not one of a fixed distance'
        )
    return Scan.checked(
        _no_returns(np.array([float(msg.range)]), furthest),
        angle_min_rad=0.0,
        angle_increment_rad=0.0,
        range_min_m=float(msg.min_range),
        range_max_m=furthest,
        stamp_ns=stamp_of(msg),
        frame_id=frame_of(msg),
        beam_width_rad=float(msg.field_of_view),
    )


def read_pose(msg: Any, *, with_covariance: bool = True) -> PoseBelief:
    """Read PoseWithCovarianceStamped, Odometry or PoseStamped.

    Raises PoseError for a pose that is not finite, not level or further than any robot goes, or a
    covariance that is not positive semi-definite or too wide to say anything. An all-zero
    covariance is a known pose. With `with_covariance` false the covariance is not looked at.
    """
    holder = msg.pose
    pose = getattr(holder, 'pose', holder)
    mean = _planar(pose)
    flat = getattr(holder, 'covariance', None) if with_covariance else None
    if flat is None:
        return PoseBelief(mean)
    full = np.asarray(flat, np.float64)
    if full.size != 36:
        raise PoseError(f'covariance: expected 36 numbers, got {full.size}')
    covariance = _checked_covariance(full.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))])
    return PoseBelief(mean, covariance)


def read_path(msg: Any) -> tuple[Int64Array, Float64Array]:
    """Read a nav_msgs/Path: stamps (N,), ns, of its poses, and x, y, yaw (N, 3), by their stamps.

    Raises PoseError for a pose that is not level, not finite or too far, and where the poses do
    not carry stamps of their own (all the same, as planners send them).
    """
    stamps = np.array([stamp_of(posed) for posed in msg.poses], np.int64)
    if stamps.size == 0:
        raise PoseError('no pose in it: expected at least one')
    if np.unique(stamps).size < stamps.size:
        raise PoseError('two poses have one stamp: expected poses that carry their own stamps')
    planar = [_planar(posed.pose) for posed in msg.poses]
    order = np.argsort(stamps)
    poses = np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in planar])
    return stamps[order], poses[order]


def read_places(msg: Any) -> Float64Array:
    """Read x, y (N, 2), m, of a nav_msgs/Path to be gone; stamps and turns are left alone.

    Raises PoseError without poses, and for one that is not finite or too far.
    """
    if not msg.poses:
        raise PoseError('no pose in it: expected at least one')
    return np.array([_checked_place(posed.pose.position, ('x', 'y')) for posed in msg.poses])


def _planar(pose: Any) -> Pose2D:
    place = _checked_place(pose.position, ('x', 'y'))
    planar, upside_down = pose_from_quaternion(
        (place[0], place[1]), _checked_quaternion(pose.orientation)
    )
    if upside_down:
        raise PoseError('pose is upside down: expected the robot on its feet')
    return planar


def _checked_place(position: Any, axes: tuple[str, ...]) -> tuple[float, ...]:
    place = tuple(float(getattr(position, axis)) for axis in axes)
    if not all(abs(value) <= FURTHEST_M for value in place):
        raise PoseError(f'position {place}: expected finite numbers up to {FURTHEST_M:g} m')
    return place


def _checked_quaternion(q: Any) -> tuple[float, float, float, float]:
    quaternion = (float(q.x), float(q.y), float(q.z), float(q.w))
    if not all(map(math.isfinite, quaternion)):
        raise PoseError(f'orientation {quaternion}: expected finite numbers')
    return quaternion


def _checked_covariance(covariance: Float64Array) -> Float64Array:
    widest = float(np.abs(covariance).max())  # nan if any is
    if not widest <= WIDEST_VARIANCE:
        raise PoseError(
            f'covariance of x, y, yaw has {widest:.3g} in it: '
            f'expected finite numbers up to {WIDEST_VARIANCE:g}'
        )
    scale = max(1.0, widest)
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
        weights = _in_proportion([float(particle.weight) for particle in msg.particles])
    else:
        planar = [_planar(pose) for pose in msg.poses]
    table = np.array([(p.x_m, p.y_m, p.yaw_rad) for p in planar])
    samples = PoseSamples.checked(table, weights)
    return PoseBelief(samples.mean(), samples.covariance(), samples)


def _in_proportion(weights: list[float]) -> Float64Array:
    """Return weights whose sum cannot overflow, the heaviest 1."""
    heaviest = max(map(abs, weights), default=0.0)
    if 0.0 < heaviest < math.inf:
        return np.array([weight / heaviest for weight in weights])
    return np.array(weights)


def fill_pose(msg: Any, belief: PoseBelief, frame_id: str, stamp_ns: int) -> None:
    """Fill a geometry_msgs/PoseWithCovarianceStamped; a known pose has a covariance of 0."""
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = time_parts(stamp_ns)
    pose, half = msg.pose.pose, 0.5 * belief.mean.yaw_rad
    pose.position.x, pose.position.y = belief.mean.x_m, belief.mean.y_m
    pose.orientation.z, pose.orientation.w = math.sin(half), math.cos(half)
    covariance = np.zeros((6, 6))
    if belief.covariance is not None:
        covariance[np.ix_((0, 1, 5), (0, 1, 5))] = belief.covariance
    msg.pose.covariance = covariance.reshape(36)


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
