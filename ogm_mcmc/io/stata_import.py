"""MIT Stata Center bags and ground-truth pose files -> rosbag2 with `scan`, `pose` and `odom`.

The bags (Fallon, Johannsson, Kaess, Leonard, IJRR 2013) are ROS 1 recordings of a PR2: laser
`/base_scan` (1040 beams, 260 degrees, about 40 Hz), odometry `/base_odometry/odom`. The poses are
a CSV without header, `timestamp_us, x, y, yaw` at about 20 Hz, in coordinates of the building,
with the bag's epoch. They are poses of the laser, not of the base, 0.275 m behind it. One of the
bags, 2012-01-25-12-33-29, is 82.2 s off its poses. So `time_offset_s` is added to the times of
the poses, and `offset_x_m` moves each pose ahead along its own heading: -0.275 makes poses of the
base of them, +0.275 makes poses of the laser of a file with poses of the base.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.errors import BagError, ConfigError, LogError, PoseError, ScanError
from ogm_mcmc.files.input_files import reason_of, text_of
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader, BagRecord, BagWriter
from ogm_mcmc.io.recording_bag import write_scan

__all__ = ['StataOptions', 'StataSummary', 'TimedPose', 'import_stata', 'read_pose_file']

NS_PER_S = 1_000_000_000

# Messages are stored a little after what they are about.
STORED_WITHIN_NS = 5 * NS_PER_S


class TimedPose(NamedTuple):
    """When and where the laser was."""

    stamp_ns: int
    pose: Pose2D


@dataclass(frozen=True)
class StataOptions:
    """Choices of `import-stata`; see the module for the offsets."""

    scan_topic: str = '/base_scan'
    odometry_topic: str = '/base_odometry/odom'
    time_offset_s: float = 0.0
    offset_x_m: float = 0.0
    max_pose_gap_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        for name in ('time_offset_s', 'offset_x_m', 'max_pose_gap_s'):
            if not math.isfinite(getattr(self, name)):
                raise ConfigError(f'{name} is {getattr(self, name)}: expected a finite number')
        if self.max_pose_gap_s <= 0.0:
            raise ConfigError(f'max_pose_gap_s is {self.max_pose_gap_s}: must be positive')


@dataclass
class StataSummary:
    """What was read and what was left out."""

    source: str
    poses_file: str
    bag: str
    poses: int = 0
    poses_out_of_order: int = 0
    poses_repeated: int = 0
    scans: int = 0
    scans_before_first_pose: int = 0
    scans_after_last_pose: int = 0
    scans_in_gaps: int = 0
    odometry: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def read_pose_file(path: Path) -> list[TimedPose]:
    """Read a `.gt.laser.poses` file, in the order of its lines. Raises LogError with the line."""
    try:
        lines = text_of(path, 'ascii').splitlines()
    except (OSError, ValueError) as error:
        plain = not isinstance(error, UnicodeDecodeError)
        reason = reason_of(error) if plain else 'not plain text'
        raise LogError(f'{path}: expected a readable pose file ({reason})') from error
    poses = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        fields = [field.strip() for field in line.split(',')]
        try:
            if len(fields) != 4:
                raise ValueError(f'{len(fields)} fields')
            pose = Pose2D(*(float(field) for field in fields[1:]))
            poses.append(TimedPose(1000 * int(fields[0]), pose))
        except (ValueError, PoseError) as error:
            raise LogError(
                f'{path}: line {number}: expected timestamp_us, x, y, yaw ({error})'
            ) from error
    if len(poses) < 2:
        raise LogError(f'{path}: {len(poses)} poses: expected at least two')
    return poses


def import_stata(
    bag_path: Path,
    poses_path: Path,
    output: Path,
    options: StataOptions | None = None,
    *,
    overwrite: bool = False,
    on_record: Callable[[], object] = lambda: None,
) -> StataSummary:
    """Convert a bag and its poses; scans without poses around them are left out and counted.

    Raises LogError, BagError or OutputError; leaves no half-written bag.
    """
    options = options or StataOptions()
    summary = StataSummary(str(bag_path), str(poses_path), str(output))
    poses = _in_order(read_pose_file(poses_path), options, summary)
    with BagReader(bag_path) as source, BagWriter(output, overwrite=overwrite) as bag:
        source.find('laser scans', (ros_types.SCAN,), options.scan_topic)
        following = 0
        for stamp_ns, message in _messages(source, poses, options, on_record):
            while following < len(poses) and poses[following].stamp_ns <= stamp_ns:
                _write_pose(bag, poses[following])
                following += 1
            if isinstance(message, Scan):
                _write_scan(bag, message, poses, options, summary)
            else:
                bag.write('/odom', ros_types.ODOMETRY, stamp_ns, message)
                summary.odometry += 1
        for pose in poses[following:]:
            _write_pose(bag, pose)
        if summary.scans == 0:
            raise BagError(
                f'{bag_path}: no scan on {options.scan_topic} between two poses of {poses_path} '
                f'({summary.scans_before_first_pose} before, {summary.scans_after_last_pose} '
                f'after, {summary.scans_in_gaps} in gaps): expected the same epoch '
                '(see --time-offset)'
            )
        bag.note('source', f'{bag_path.name}, {poses_path.name}')
    return summary


def _in_order(
    read: list[TimedPose], options: StataOptions, summary: StataSummary
) -> list[TimedPose]:
    """Apply the offsets; sort, and keep the first pose of every stamp."""
    shift_ns, ahead = round(options.time_offset_s * NS_PER_S), Pose2D(options.offset_x_m)
    moved = [TimedPose(p.stamp_ns + shift_ns, p.pose.compose(ahead)) for p in read]
    summary.poses_out_of_order = sum(
        1 for k in range(1, len(moved)) if moved[k].stamp_ns < moved[k - 1].stamp_ns
    )
    by_stamp: dict[int, TimedPose] = {}
    for timed in moved:
        by_stamp.setdefault(timed.stamp_ns, timed)
    summary.poses, summary.poses_repeated = len(by_stamp), len(moved) - len(by_stamp)
    poses = [by_stamp[stamp] for stamp in sorted(by_stamp)]
    if poses[0].stamp_ns < 0 or poses[-1].stamp_ns >= 2**31 * NS_PER_S:
        raise LogError(
            f'{summary.poses_file}: times from {poses[0].stamp_ns / NS_PER_S:g} s to '
            f'{poses[-1].stamp_ns / NS_PER_S:g} s: expected what a ROS stamp holds'
        )
    return poses


def _messages(
    source: BagReader,
    poses: list[TimedPose],
    options: StataOptions,
    on_record: Callable[[], object],
) -> Iterator[tuple[int, Any]]:
    """Yield (stamp ns, Scan or Odometry) around the time of the poses, in the bag's order."""
    first = max(0, poses[0].stamp_ns - STORED_WITHIN_NS)
    last = poses[-1].stamp_ns + STORED_WITHIN_NS
    topics = (options.scan_topic, options.odometry_topic)
    for record in source.records(topics, start_ns=first):
        if record.time_ns > last:
            return
        on_record()
        message = source.decode(record)
        yield _understood(source, record, message)


def _understood(source: BagReader, record: BagRecord, message: Any) -> tuple[int, Any]:
    try:
        if record.msgtype == ros_types.SCAN:
            scan = messages.read_scan(message)
            return scan.stamp_ns, scan
        pose = messages.read_pose(message).mean
    except (ScanError, PoseError) as error:
        where = f'{source.path}: {record.topic} at {record.time_ns / NS_PER_S:.3f} s'
        raise BagError(f'{where}: {error}') from error
    stamp_ns, twist = messages.stamp_of(message), message.twist.twist
    speed, turn = float(twist.linear.x), float(twist.angular.z)
    return stamp_ns, ros_types.odometry(stamp_ns, pose, speed, turn)


def _write_pose(bag: BagWriter, timed: TimedPose) -> None:
    known = ros_types.pose_with_covariance(timed.stamp_ns, 'map', timed.pose, np.zeros((3, 3)))
    bag.write('/pose', ros_types.POSE, timed.stamp_ns, known)


def _write_scan(
    bag: BagWriter,
    scan: Scan,
    poses: list[TimedPose],
    options: StataOptions,
    summary: StataSummary,
) -> None:
    after = bisect.bisect_left(poses, scan.stamp_ns, key=lambda timed: timed.stamp_ns)
    exactly = after < len(poses) and poses[after].stamp_ns == scan.stamp_ns
    if after == 0 and not exactly:
        summary.scans_before_first_pose += 1
        return
    if after == len(poses):
        summary.scans_after_last_pose += 1
        return
    gap_ns = 0 if exactly else poses[after].stamp_ns - poses[after - 1].stamp_ns
    if gap_ns > options.max_pose_gap_s * NS_PER_S:
        summary.scans_in_gaps += 1
        return
    summary.scans += 1
    write_scan(bag, scan)
