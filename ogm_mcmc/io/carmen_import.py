"""CARMEN or GMapping log -> rosbag2 with `scan`, `pose`, `particles` and `odom`.

Topics carry the pose of the laser itself, so that no mount has to be known: `scan` with `pose`
for the first laser of the log, `scan_NAME` with `pose_NAME` for further ones.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.errors import ConfigError, LogError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.geometry.pose_sampling import systematic
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagWriter
from ogm_mcmc.io.carmen import CarmenLog, LogOdometry, LogScan, read_carmen
from ogm_mcmc.io.carmen_times import (
    MAX_STAMP_S,
    NS_PER_S,
    storable_times,
    strictly_increasing,
)
from ogm_mcmc.io.no_return import LaserRange, laser_range

__all__ = ['ImportOptions', 'ImportSummary', 'import_carmen']


@dataclass(frozen=True)
class ImportOptions:
    """Choices of `import-carmen`; 0 stands for "as the log has it".

    Readings of `no_return_from_m` or more hit nothing; `field_of_view_deg` is the angle from the
    first to the last reading, the middle one straight ahead, of scans that name no angles.
    """

    range_max_m: float = 0.0
    no_return_from_m: float = 0.0
    field_of_view_deg: float = 0.0
    particles: int = 0
    repeat_step_s: float = 0.1
    time_offset_s: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        if not math.isfinite(self.no_return_from_m):
            raise ConfigError(f'no_return_from {self.no_return_from_m}: expected a finite number')
        numbers = (self.range_max_m, self.repeat_step_s, self.time_offset_s)
        if not all(map(math.isfinite, numbers)):
            raise ConfigError(f'range_max, repeat_step, time_offset {numbers}: expected finite')
        if self.repeat_step_s > 3600.0 or self.particles > 1_000_000:
            raise ConfigError('expected repeat_step up to 3600 s and up to 1000000 particles')
        if not (self.no_return_from_m >= 0.0 and 0.0 <= self.field_of_view_deg <= 360.0):
            raise ConfigError('expected no_return_from >= 0 and field_of_view of 0 to 360 degrees')
        if self.range_max_m < 0.0 or self.repeat_step_s <= 0.0 or self.particles < 0:
            raise ConfigError('expected range_max >= 0, particles >= 0 and a positive repeat_step')


@dataclass
class ImportSummary:
    """The truth about what was read and what was mended."""

    source: str
    bag: str
    scans: dict[str, int] = field(default_factory=dict)
    beams: list[int] = field(default_factory=list)
    angle_increment_deg: list[float] = field(default_factory=list)
    range_max_m: dict[str, float] = field(default_factory=dict)
    readings: int = 0
    no_return: int = 0
    no_return_codes_m: dict[str, int] = field(default_factory=dict)
    no_return_rules: dict[str, str] = field(default_factory=dict)
    odometry: int = 0
    odometry_echoes: int = 0
    odometry_to_pose_median_m: float | None = None
    particles_per_scan: int = 0
    out_of_order: dict[str, int] = field(default_factory=dict)
    repeated_stamps: int = 0
    without_times: bool = False
    largest_shift_s: float = 0.0
    clock_shift_s: float = 0.0
    clock_jumps: int = 0
    damaged_lines: int = 0
    first_damage: str = ''
    without_angles: dict[int, int] = field(default_factory=dict)
    without_particles: int = 0
    raw_scans: int = 0
    without_odometry: int = 0
    cut: str = ''
    left_alone: dict[str, int] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def import_carmen(
    log_path: Path, bag_path: Path, options: ImportOptions, *, overwrite: bool = False
) -> ImportSummary:
    """Convert a log. Raises LogError, OutputError or ConfigError; leaves no half-written bag."""
    log = read_carmen(log_path, math.radians(options.field_of_view_deg))
    summary = ImportSummary(
        str(log_path),
        str(bag_path),
        left_alone=dict(log.left_alone),
        odometry_echoes=log.echoes,
        damaged_lines=log.damaged,
        first_damage=log.first_damage,
        without_angles=dict(log.without_angles),
        without_particles=log.without_particles,
        raw_scans=log.raw_scans,
        without_odometry=log.without_odometry,
        cut=log.cut,
    )
    reach = _ranges_of(log, options)
    order, stamps = _stamp(log, options, summary)
    names = _topic_names(log)
    with BagWriter(bag_path, overwrite=overwrite) as bag:
        for index, stamp_ns in zip(order, stamps, strict=True):
            record = log.records[index]
            if isinstance(record, LogOdometry):
                message = ros_types.odometry(
                    stamp_ns, record.pose, record.speed_m_s, record.turn_rad_s
                )
                bag.write('/odom', ros_types.ODOMETRY, stamp_ns, message)
                summary.odometry += 1
            else:
                _write_scan(bag, record, stamp_ns, names, reach[record.laser], options, summary)
        bag.note('source', str(log_path.name))
        for suffix in names.values():
            for topic in ('/pose', '/particles'):
                bag.note_frame(f'{topic}{suffix}', f'laser{suffix}')
        bag.note('no_return_readings', str(summary.no_return))
    summary.beams = sorted({scan.ranges_m.size for scan in log.scans})
    summary.angle_increment_deg = sorted(
        {round(math.degrees(scan.increment_rad), 6) for scan in log.scans}
    )
    if not log.raw_scans:  # their poses are the odometry
        summary.odometry_to_pose_median_m = _odometry_agreement(log, order)
    return summary


def _topic_names(log: CarmenLog) -> dict[str, str]:
    lasers = list(dict.fromkeys(scan.laser for scan in log.scans))
    return {laser: '' if k == 0 else f'_{laser}' for k, laser in enumerate(lasers)}


def _ranges_of(log: CarmenLog, options: ImportOptions) -> dict[str, LaserRange]:
    """Find for each laser which readings are codes and how far it reaches."""
    found = {}
    for laser in dict.fromkeys(scan.laser for scan in log.scans):
        parameter = log.parameters.get(f'robot_{laser}_laser_max', '')
        own = laser_range(
            [scan for scan in log.scans if scan.laser == laser],
            chosen_m=options.no_return_from_m,
            parameter_m=_number_or_0(parameter),
        )
        found[laser] = own._replace(range_max_m=options.range_max_m or own.range_max_m)
    return found


def _number_or_0(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if math.isfinite(value) else 0.0


def _storable(log: CarmenLog, options: ImportOptions, summary: ImportSummary) -> list[float]:
    """Return times that a ROS stamp holds: as they are, or in the order of the file from 0 on."""
    times = [record.time_s + options.time_offset_s for record in log.records]
    if options.time_offset_s == 0.0:
        times, summary.clock_shift_s, summary.clock_jumps = storable_times(times)
    for time in (min(times), max(times)):
        if not 0.0 <= time < MAX_STAMP_S:
            raise LogError(
                f'{log.path}: a time is {time:g} s: expected 0 to {MAX_STAMP_S:g} s, '
                'what a ROS stamp holds'
            )
    return times


def _stamp(
    log: CarmenLog, options: ImportOptions, summary: ImportSummary
) -> tuple[list[int], list[int]]:
    times = _storable(log, options, summary)
    kinds = [
        'odometry' if isinstance(record, LogOdometry) else record.laser for record in log.records
    ]
    for kind in dict.fromkeys(kinds):
        own = [time for time, other in zip(times, kinds, strict=True) if other == kind]
        late = sum(1 for before, after in itertools.pairwise(own) if after < before)
        if late:
            summary.out_of_order[kind] = late
    order, stamps, summary.repeated_stamps = strictly_increasing(
        times, kinds, options.repeat_step_s
    )
    summary.without_times = summary.repeated_stamps > 0 and len(set(times)) == 1
    summary.largest_shift_s = max(
        abs(stamp / NS_PER_S - times[index]) for index, stamp in zip(order, stamps, strict=True)
    )
    return order, stamps


def _ros_ranges(scan: LogScan, reach: LaserRange, summary: ImportSummary) -> Float32Array:
    """REP 117: no return becomes inf; a valid reading beyond a chosen range_max stays as it is."""
    ranges = scan.ranges_m.astype(np.float32)
    missing = reach.missing(scan.ranges_m)
    ranges[missing] = np.inf
    summary.readings += ranges.size
    summary.no_return += int(missing.sum())
    codes, counts = np.unique(scan.ranges_m[missing], return_counts=True)
    for code, count in zip(codes, counts, strict=True):
        key = f'{code:g}'
        summary.no_return_codes_m[key] = summary.no_return_codes_m.get(key, 0) + int(count)
    return ranges


def _write_scan(
    bag: BagWriter,
    scan: LogScan,
    stamp_ns: int,
    names: dict[str, str],
    reach: LaserRange,
    options: ImportOptions,
    summary: ImportSummary,
) -> None:
    suffix = names[scan.laser]
    frame = f'laser{suffix}'
    ranges = _ros_ranges(scan, reach, summary)
    belief = scan.particles
    mean: Pose2D = scan.laser_pose if belief is None else belief.mean()
    covariance = np.zeros((3, 3)) if belief is None else belief.covariance()
    # The pose goes first: whoever reads in order has it when the scan comes.
    bag.write(
        f'/pose{suffix}',
        ros_types.POSE,
        stamp_ns,
        ros_types.pose_with_covariance(stamp_ns, 'map', mean, covariance),
    )
    if belief is not None:
        count = options.particles or belief.weights.size
        summary.particles_per_scan = count
        bag.write(
            f'/particles{suffix}',
            ros_types.PARTICLES,
            stamp_ns,
            ros_types.pose_array(stamp_ns, 'map', systematic(belief, count)),
        )
    bag.write(
        f'/scan{suffix}',
        ros_types.SCAN,
        stamp_ns,
        ros_types.laser_scan(
            stamp_ns,
            frame,
            ranges,
            angle_min=scan.start_angle_rad,
            angle_increment=scan.increment_rad,
            range_max=reach.range_max_m,
        ),
    )
    topic = f'scan{suffix}'
    summary.range_max_m[topic] = reach.range_max_m
    summary.no_return_rules[topic] = reach.rule
    summary.scans[topic] = summary.scans.get(topic, 0) + 1


def _odometry_agreement(log: CarmenLog, order: list[int]) -> float | None:
    """Median distance from each scan's pose to the ODOM line before it, m.

    It tells raw odometry from one that was corrected together with the scans and stays within
    centimetres of them.
    """
    last: LogOdometry | None = None
    distances = []
    for index in order:
        record = log.records[index]
        if isinstance(record, LogOdometry):
            last = record
        elif last is not None:
            pose = record.laser_pose if record.particles is None else record.particles.mean()
            distances.append(math.hypot(pose.x_m - last.pose.x_m, pose.y_m - last.pose.y_m))
    return float(np.median(distances)) if distances else None
