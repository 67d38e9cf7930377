"""Parse CARMEN logs (old and new format) and GMapping's .gfs, plain or gzipped.

Lines read: FLASER, RLASER (old), ROBOTLASERn (new), ODOM, PARAM, and of GMapping's full output
LASER_READING, SM_UPDATE and RESAMPLE. Everything else is counted and left alone. Values stay as
in the file; what they mean in ROS is decided in `carmen_import`.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.errors import LogError, PoseError
from ogm_mcmc.geometry import Pose2D, PoseSamples

__all__ = ['CarmenLog', 'LogOdometry', 'LogScan', 'particle_weights', 'read_carmen']

# An ODOM line with the pose of the scan before it is odometry if it comes within this time.
ECHO_AFTER_S = 5.0

# CARMEN's rule for the old format, which names no angles: a SICK starts at -90 degrees and its
# number of readings tells the resolution.
OLD_FORMAT_STEP_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5, 401: 0.25}


@dataclass(slots=True)
class LogScan:
    """One laser line; `max_range_m` 0 where the format does not name it.

    Of GMapping: `particles` after the scan, with their `log_weights` as printed; `parents` where
    the filter was resampled after that: the particle each of the next ones descends from.
    """

    line: int
    laser: str
    time_s: float
    ranges_m: Float64Array
    start_angle_rad: float
    increment_rad: float
    max_range_m: float
    laser_pose: Pose2D
    particles: PoseSamples | None = None
    log_weights: Float64Array | None = None
    parents: Int64Array | None = None


@dataclass(slots=True)
class LogOdometry:
    """One ODOM line."""

    line: int
    time_s: float
    pose: Pose2D
    speed_m_s: float = 0.0
    turn_rad_s: float = 0.0


@dataclass
class CarmenLog:
    """All of a log, in the order of the file."""

    path: Path
    records: list[LogScan | LogOdometry] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    left_alone: Counter[str] = field(default_factory=Counter)
    gmapping: bool = False
    echoes: int = 0  # ODOM lines that only repeat the scan before them, see `_LineReader.is_echo`

    @property
    def scans(self) -> list[LogScan]:
        """The laser lines."""
        return [record for record in self.records if isinstance(record, LogScan)]


def particle_weights(log_weights: Float64Array) -> Float64Array:
    """Weights of GMapping particles: exp(g (lw - max lw)) with g = 1 / (3 M), normalised.

    3 is GMapping's `ogain`; log_weights (M,) as printed in SM_UPDATE.
    """
    gain = 1.0 / (3.0 * log_weights.size)
    weights: Float64Array = np.exp(gain * (log_weights - log_weights.max()))
    weights /= weights.sum()
    return weights


def read_carmen(path: Path) -> CarmenLog:
    """Read a whole log.

    Raises LogError with the line and the field at fault: not readable, cut off in the middle of
    a line or of the gzip stream, numbers that are none, or no laser line at all.
    """
    log = CarmenLog(path)
    reader = _LineReader(log)
    try:
        with path.open('rb') as raw:
            packed = raw.read(2) == b'\x1f\x8b'
        with gzip.open(path, 'rb') if packed else path.open('rb') as stream:
            for number, line in enumerate(stream, start=1):
                reader.take(number, line)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, 'strerror', None) or error
        raise LogError(f'{path}: expected a readable log ({reason})') from error
    if not log.scans:
        raise LogError(
            f'{path}: no laser line in it: expected FLASER, RLASER, ROBOTLASER1 or LASER_READING'
        )
    return log


class _LineReader:
    """Turns lines into records; keeps the scan that waits for its particles."""

    def __init__(self, log: CarmenLog) -> None:
        self.log = log
        self.last_scan: LogScan | None = None

    def take(self, number: int, raw: bytes) -> None:
        try:
            words = raw.decode('ascii').split()
        except UnicodeDecodeError as error:
            raise self.fault(number, 'not text', 'a CARMEN log') from error
        if not words or words[0].startswith('#'):
            return
        kind = words[0]
        try:
            if kind in ('FLASER', 'RLASER'):
                self.keep(self.old_laser(number, kind, words))
            elif kind.startswith('ROBOTLASER'):
                self.keep(self.robot_laser(number, words))
            elif kind == 'LASER_READING':
                self.log.gmapping = True
                self.keep(self.gmapping_laser(number, words))
            elif kind == 'SM_UPDATE':
                self.particles(number, words)
            elif kind == 'RESAMPLE':
                self.resampling(number, words)
            elif kind == 'ODOM':
                self.keep_odometry(self.odometry(number, words))
            elif kind == 'PARAM' and len(words) > 2:
                self.log.parameters.setdefault(words[1], words[2])
            else:
                self.log.left_alone[kind] += 1
        except IndexError as error:
            wanted = f'more than {len(words)} fields (is the file cut off?)'
            raise self.fault(number, f'{kind} line ends too early', wanted) from error
        except PoseError as error:
            raise self.fault(number, f'{kind}: {error}', 'a pose') from error

    def keep(self, scan: LogScan) -> None:
        self.last_scan = scan
        self.log.records.append(scan)

    def keep_odometry(self, odometry: LogOdometry) -> None:
        if self.is_echo(odometry):
            self.log.echoes += 1
        else:
            self.log.records.append(odometry)

    def is_echo(self, odometry: LogOdometry) -> bool:
        """Whether the line only repeats the scan before it.

        GMapping's gfs2log writes after each FLASER an ODOM with the same pose whose time is 0 or
        uninitialised memory; sorted by time such lines would land anywhere. A robot that stands
        still has the same pose, too, but its time follows.
        """
        before = self.log.records[-1] if self.log.records else None
        if not isinstance(before, LogScan) or odometry.pose != before.laser_pose:
            return False
        return not 0.0 <= odometry.time_s - before.time_s <= ECHO_AFTER_S

    def fault(self, number: int, what: str, expected: str) -> LogError:
        return LogError(f'{self.log.path}, line {number}: {what}: expected {expected}')

    def number(self, line: int, words: list[str], index: int, name: str) -> float:
        try:
            value = float(words[index])
        except ValueError as error:
            raise self.fault(line, f'{name} is {words[index]!r}', 'a number') from error
        if not math.isfinite(value):
            raise self.fault(line, f'{name} is {words[index]!r}', 'a finite number')
        return value

    def count(
        self, line: int, words: list[str], index: int, name: str, *, at_least: int = 1
    ) -> int:
        value = self.number(line, words, index, name)
        if value != int(value) or value < at_least:
            expected = f'a whole number of {at_least} or more'
            raise self.fault(line, f'{name} is {words[index]!r}', expected)
        if index + int(value) >= len(words):
            raise IndexError
        return int(value)

    def pose(self, line: int, words: list[str], index: int) -> Pose2D:
        x, y, yaw = (
            self.number(line, words, index + k, n) for k, n in enumerate(('x', 'y', 'theta'))
        )
        return Pose2D(x, y, yaw)

    def readings(self, line: int, words: list[str], first: int, count: int) -> Float64Array:
        try:
            values = np.array(words[first : first + count], dtype=np.float64)
        except ValueError as error:
            raise self.fault(line, 'a range is no number', f'{count} ranges') from error
        if values.size != count:
            raise IndexError
        return values

    def old_angles(self, line: int, count: int) -> float:
        if count not in OLD_FORMAT_STEP_DEG:
            known = ', '.join(map(str, OLD_FORMAT_STEP_DEG))
            raise self.fault(line, f'{count} readings without angles', f'one of {known}')
        return math.radians(OLD_FORMAT_STEP_DEG[count])

    def old_laser(self, line: int, kind: str, words: list[str]) -> LogScan:
        """FLASER n ranges... x y theta odom_x odom_y odom_theta time host logger_time."""
        count = self.count(line, words, 1, 'number of readings')
        end = 2 + count
        start = math.radians(-50.0 if count == 401 else -90.0)
        return LogScan(
            line,
            'front' if kind == 'FLASER' else 'rear',
            self.number(line, words, end + 6, 'time'),
            self.readings(line, words, 2, count),
            start,
            self.old_angles(line, count),
            0.0,
            self.pose(line, words, end),
        )

    def robot_laser(self, line: int, words: list[str]) -> LogScan:
        """ROBOTLASERn type start fov step max accuracy remission_mode n ranges... m values...

        then laser x y theta, robot x y theta, five motion fields, time host logger_time.
        """
        start, step, max_range = (
            self.number(line, words, index, name)
            for index, name in ((2, 'start angle'), (4, 'resolution'), (5, 'maximum range'))
        )
        count = self.count(line, words, 8, 'number of readings')
        remissions = self.count(line, words, 9 + count, 'number of remissions', at_least=0)
        end = 10 + count + remissions
        return LogScan(
            line,
            words[0].removeprefix('ROBOTLASER') or '1',
            self.number(line, words, end + 11, 'time'),
            self.readings(line, words, 9, count),
            start,
            step,
            max_range,
            self.pose(line, words, end),
        )

    def gmapping_laser(self, line: int, words: list[str]) -> LogScan:
        """LASER_READING n ranges... odom_x odom_y odom_theta time."""
        count = self.count(line, words, 1, 'number of readings')
        end = 2 + count
        return LogScan(
            line,
            'front',
            self.number(line, words, end + 3, 'time'),
            self.readings(line, words, 2, count),
            math.radians(-90.0),
            self.old_angles(line, count),
            0.0,
            self.pose(line, words, end),
        )

    def particles(self, line: int, words: list[str]) -> None:
        """SM_UPDATE m (x y theta log_weight)...: the belief about the scan before it."""
        if self.last_scan is None:
            raise self.fault(line, 'SM_UPDATE before any LASER_READING', 'the scan first')
        count = self.count(line, words, 1, 'number of particles')
        table = self.readings(line, words, 2, 4 * count).reshape(count, 4)
        if not np.isfinite(table).all():
            raise self.fault(line, 'a particle is not finite', 'finite numbers')
        self.last_scan.particles = PoseSamples(
            np.ascontiguousarray(table[:, :3]), particle_weights(table[:, 3])
        )
        self.last_scan.log_weights = np.ascontiguousarray(table[:, 3])

    def resampling(self, line: int, words: list[str]) -> None:
        """RESAMPLE m parents...: which of the particles before each of the next descends from."""
        if self.last_scan is None or self.last_scan.log_weights is None:
            raise self.fault(line, 'RESAMPLE before any SM_UPDATE', 'the particles first')
        count = self.count(line, words, 1, 'number of particles')
        parents = self.readings(line, words, 2, count)
        known = np.isin(parents, np.arange(self.last_scan.log_weights.size)).all()
        if count != self.last_scan.log_weights.size or not known:
            wanted = f'{self.last_scan.log_weights.size} of the particles before'
            raise self.fault(line, 'RESAMPLE names others', wanted)
        self.last_scan.parents = parents.astype(np.int64)

    def odometry(self, line: int, words: list[str]) -> LogOdometry:
        """ODOM x y theta [tv rv accel] time [host logger_time]."""
        pose = self.pose(line, words, 1)
        if len(words) == 5:
            return LogOdometry(line, self.number(line, words, 4, 'time'), pose)
        return LogOdometry(
            line,
            self.number(line, words, 7, 'time'),
            pose,
            self.number(line, words, 4, 'tv'),
            self.number(line, words, 5, 'rv'),
        )
