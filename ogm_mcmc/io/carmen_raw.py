"""Raw laser lines of a CARMEN log, which name no pose: placed by the odometry around them.

The robot's pose is interpolated between the ODOM lines before and after a scan. Nothing is
extrapolated, no gap of more than `MAX_GAP_S` is bridged unless the robot stands, and no scan is
placed where the odometry was set elsewhere meanwhile. Where a laser sits on the robot CARMEN's
parameters say (`robot_frontlaser_offset` and its like), if the log has them.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence

from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.geometry.motion import jumps
from ogm_mcmc.geometry.pose import interpolate, wrap_angle
from ogm_mcmc.io.carmen_lines import LineParser, LogOdometry, LogScan, fault
from ogm_mcmc.io.carmen_times import NS_PER_S, storable_times

__all__ = ['MAX_GAP_S', 'RawLines', 'laser_place', 'place_raw_scans']

MAX_GAP_S = 2.0

# A robot that has not gone further than this over a gap has stood still.
STANDS_M = 0.01
STANDS_RAD = 0.01


class RawLines:
    """Raw scans as they come, each with the number of other records before it, and faults.

    `field_of_view_rad`: of lines that name no angles, as for `LineParser`.
    """

    def __init__(self, field_of_view_rad: float = 0.0) -> None:
        self.parse = LineParser(field_of_view_rad)
        self.scans: list[tuple[int, LogScan]] = []
        self.damaged = 0
        self.first_damage = ''

    def take(self, line: int, words: list[str], n_records: int) -> None:
        """Read a line; one that cannot be used is counted."""
        try:
            self.scans.append((n_records, self.parse.raw_laser(line, words)))
        except IndexError:
            self._leave_out(fault(line, f'{words[0]} line ends too early', 'more fields'))
        except LogError as error:
            self._leave_out(error)

    def doubt_last(self) -> None:
        """Leave out a last scan that no line end follows where its time lost digits."""
        if len(self.scans) > 1 and self.scans[-1][1].time_s < self.scans[-2][1].time_s:
            scan = self.scans.pop()[1]
            self._leave_out(fault(scan.line, 'RAWLASER line is cut off', 'the end of a line'))

    def _leave_out(self, error: LogError) -> None:
        self.damaged += 1
        self.first_damage = self.first_damage or str(error)

    def among(self, records: Sequence[LogScan | LogOdometry]) -> list[LogScan | LogOdometry]:
        """Return the raw scans where they stood among other records."""
        merged: list[LogScan | LogOdometry] = []
        done = 0
        for position, scan in self.scans:
            merged += [*records[done:position], scan]
            done = position
        return [*merged, *records[done:]]


def place_raw_scans(
    records: Sequence[LogScan | LogOdometry], parameters: Mapping[str, str]
) -> list[LogScan | LogOdometry]:
    """Return the records with each raw scan placed; without those that odometry does not cover.

    records in the order of the file; parameters: PARAM lines of the log, by name.
    """
    if not records:
        return []
    times = storable_times([record.time_s for record in records]).times_s
    odometry = sorted(
        (
            (time, record.pose)
            for time, record in zip(times, records, strict=True)
            if isinstance(record, LogOdometry)
        ),
        key=lambda entry: entry[0],
    )
    known = [time for time, _ in odometry]
    kept: list[LogScan | LogOdometry] = []
    for time, record in zip(times, records, strict=True):
        if isinstance(record, LogScan):
            robot = _robot_at(time, known, odometry)
            if robot is None:
                continue
            record.laser_pose = robot.compose(laser_place(record.laser, parameters))
        kept.append(record)
    return kept


def _robot_at(
    time_s: float, known: Sequence[float], odometry: Sequence[tuple[float, Pose2D]]
) -> Pose2D | None:
    """Return where the robot was; None where the odometry (sorted, by `known`) does not say."""
    later = bisect.bisect_left(known, time_s)
    if later == len(known):
        return None
    after_s, after = odometry[later]
    if after_s == time_s:
        return after
    if later == 0:
        return None
    before_s, before = odometry[later - 1]
    apart_s = after_s - before_s
    if jumps(before, after, round(apart_s * NS_PER_S)):
        return None
    if apart_s > MAX_GAP_S and not _stands(before, after):
        return None
    return interpolate(before, after, (time_s - before_s) / apart_s)


def _stands(before: Pose2D, after: Pose2D) -> bool:
    way = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    turn = abs(wrap_angle(after.yaw_rad - before.yaw_rad))
    return way <= STANDS_M and turn <= STANDS_RAD


def laser_place(laser: str, parameters: Mapping[str, str]) -> Pose2D:
    """Return where a raw laser (by its number) sits on the robot, as CARMEN's parameters say.

    Laser 1 is the front one and 2 the rear one, which looks back, unless the log says otherwise;
    offsets are m and rad. One of which nothing is said sits at the robot's origin.
    """
    for side, usual, yaw in (('frontlaser', '1', 0.0), ('rearlaser', '2', math.pi)):
        prefix = f'robot_{side}'
        named = parameters.get(f'{prefix}_id', usual)
        if laser != named or not any(name.startswith(f'{prefix}_') for name in parameters):
            continue
        return Pose2D(
            _number(parameters, f'{prefix}_offset', 0.0),
            _number(parameters, f'{prefix}_side_offset', 0.0),
            _number(parameters, f'{prefix}_angular_offset', yaw),
        )
    return Pose2D(0.0, 0.0, 0.0)


def _number(parameters: Mapping[str, str], name: str, default: float) -> float:
    try:
        value = float(parameters[name])
    except (KeyError, ValueError):
        return default
    return value if math.isfinite(value) else default
