"""The lines of a CARMEN or GMapping log that hold a laser's readings or odometry, one by one."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import FURTHEST_M, Pose2D, PoseSamples

__all__ = ['LineParser', 'LogOdometry', 'LogScan', 'fault']

# CARMEN's rule for the old format, which names no angles: a SICK starts at -90 degrees and its
# number of readings tells the resolution.
OLD_FORMAT_STEP_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5, 401: 0.25}


@dataclass(slots=True)
class LogScan:
    """One laser line; `max_range_m` 0 where the format does not name it.

    Of GMapping: `particles` after the scan, with their `log_weights` as printed; `parents` where
    the filter was resampled after that: the particle each of the next ones descends from, empty
    where it is not known because a line is damaged.
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


def fault(line: int, what: str, expected: str) -> LogError:
    """Say what is wrong with a line."""
    return LogError(f'line {line}: {what}: expected {expected}')


class LineParser:
    """Turns the words of a line into a scan or odometry.

    field_of_view_rad: of scans that name no angles; 0: by CARMEN's rule. Scans whose number of
    readings that rule does not know are counted in `without_angles`.
    Raises LogError for a number that is none, IndexError for a line that ends too early.
    """

    def __init__(self, field_of_view_rad: float = 0.0) -> None:
        """Start counting."""
        self.field_of_view_rad = field_of_view_rad
        self.without_angles: Counter[int] = Counter()

    def number(self, line: int, words: list[str], index: int, name: str) -> float:
        """Return a finite number."""
        try:
            value = float(words[index])
        except ValueError as error:
            raise fault(line, f'{name} is {words[index]!r}', 'a number') from error
        if not math.isfinite(value):
            raise fault(line, f'{name} is {words[index]!r}', 'a finite number')
        return value

    def count(
        self, line: int, words: list[str], index: int, name: str, *, at_least: int = 1
    ) -> int:
        """Return a count of words that follow."""
        value = self.number(line, words, index, name)
        if value != int(value) or value < at_least:
            expected = f'a whole number of {at_least} or more'
            raise fault(line, f'{name} is {words[index]!r}', expected)
        if index + int(value) >= len(words):
            raise IndexError
        return int(value)

    def pose(self, line: int, words: list[str], index: int) -> Pose2D:
        """Return three numbers as a pose."""
        x, y, yaw = (
            self.number(line, words, index + k, n) for k, n in enumerate(('x', 'y', 'theta'))
        )
        if max(abs(x), abs(y)) > FURTHEST_M:
            raise fault(line, f'position ({x:g}, {y:g})', f'numbers up to {FURTHEST_M:g} m')
        return Pose2D(x, y, yaw)

    def readings(self, line: int, words: list[str], first: int, count: int) -> Float64Array:
        """Return numbers (count,), which need not be finite."""
        try:
            values = np.array(words[first : first + count], dtype=np.float64)
        except ValueError as error:
            raise fault(line, 'a range is no number', f'{count} ranges') from error
        if values.size != count:
            raise IndexError
        return values

    def old_angles(self, line: int, count: int) -> tuple[float, float]:
        """Return start and step in rad of a scan that names none."""
        if self.field_of_view_rad > 0.0:
            step = self.field_of_view_rad / max(1, count - 1)
            return -self.field_of_view_rad / 2.0, step
        if count not in OLD_FORMAT_STEP_DEG:
            self.without_angles[count] += 1
            known = ', '.join(map(str, OLD_FORMAT_STEP_DEG))
            expected = f'one of {known}, or --field-of-view'
            raise fault(line, f'{count} readings without angles', expected)
        start_deg = -50.0 if count == 401 else -90.0
        return math.radians(start_deg), math.radians(OLD_FORMAT_STEP_DEG[count])

    def old_laser(self, line: int, kind: str, words: list[str]) -> LogScan:
        """FLASER n ranges... x y theta odom_x odom_y odom_theta time host logger_time."""
        count = self.count(line, words, 1, 'number of readings')
        end = 2 + count
        start, step = self.old_angles(line, count)
        return LogScan(
            line,
            'front' if kind == 'FLASER' else 'rear',
            self.number(line, words, end + 6, 'time'),
            self.readings(line, words, 2, count),
            start,
            step,
            0.0,
            self.pose(line, words, end),
        )

    def robot_laser(self, line: int, words: list[str]) -> LogScan:
        """ROBOTLASERn type start fov step max accuracy remission_mode n ranges... m values...

        then laser x y theta, robot x y theta, five motion fields, time host logger_time.
        """
        scan, end = self.new_laser(line, words, words[0].removeprefix('ROBOTLASER') or '1')
        scan.time_s = self.number(line, words, end + 11, 'time')
        scan.laser_pose = self.pose(line, words, end)
        return scan

    def raw_laser(self, line: int, words: list[str]) -> LogScan:
        """RAWLASERn as ROBOTLASERn up to its remissions, then time host logger_time: no pose."""
        scan, end = self.new_laser(line, words, words[0].removeprefix('RAWLASER') or '1')
        scan.time_s = self.number(line, words, end, 'time')
        return scan

    def new_laser(self, line: int, words: list[str], laser: str) -> tuple[LogScan, int]:
        """Return a scan without time and pose, and which word comes after its remissions."""
        start, step, max_range = (
            self.number(line, words, index, name)
            for index, name in ((2, 'start angle'), (4, 'resolution'), (5, 'maximum range'))
        )
        count = self.count(line, words, 8, 'number of readings')
        if step == 0.0:
            # Some loggers leave the resolution to the field of view, or name no angle at all.
            view = self.number(line, words, 3, 'field of view')
            start, step = (
                (start, view / max(1, count - 1)) if view else self.old_angles(line, count)
            )
        remissions = self.count(line, words, 9 + count, 'number of remissions', at_least=0)
        ranges = self.readings(line, words, 9, count)
        scan = LogScan(line, laser, 0.0, ranges, start, step, max_range, Pose2D(0.0, 0.0, 0.0))
        return scan, 10 + count + remissions

    def gmapping_laser(self, line: int, words: list[str]) -> LogScan:
        """LASER_READING n ranges... odom_x odom_y odom_theta time."""
        count = self.count(line, words, 1, 'number of readings')
        end = 2 + count
        start, step = self.old_angles(line, count)
        return LogScan(
            line,
            'front',
            self.number(line, words, end + 3, 'time'),
            self.readings(line, words, 2, count),
            start,
            step,
            0.0,
            self.pose(line, words, end),
        )

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
