"""`import-carmen LOG -o BAG`: a CARMEN or GMapping log becomes a rosbag2."""

from __future__ import annotations

import argparse
from pathlib import Path

from ogm_mcmc.cli.option_ranges import Range, check_options
from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.io.carmen_import import ImportOptions, ImportSummary, import_carmen

__all__ = ['add_to', 'describe']

# A `repeat_step` of no time at all would leave stamps as they are.
RANGES = {
    'range_max': Range(0, 100_000, 'm'),
    'no_return_from': Range(0, 100_000, 'm'),
    'field_of_view': Range(0, 360, 'degrees'),
    'particles': Range(0, 1_000_000),
    'repeat_step': Range(1e-6, 3600, 's'),
    'time_offset': Range(-(2.0**31), 2.0**31, 's'),
}


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('import-carmen', help='CARMEN or GMapping log to rosbag2')
    parser.add_argument('log', type=Path, help='log, plain or gzipped')
    parser.add_argument('-o', '--output', type=Path, required=True, help='rosbag2 to make')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing bag')
    parser.add_argument('--range-max', type=float, default=0.0, help='range_max of the scans, m')
    parser.add_argument(
        '--no-return-from',
        type=float,
        default=0.0,
        help='readings of so many m or more hit nothing; 0: found out from the log',
    )
    parser.add_argument(
        '--field-of-view',
        type=float,
        default=0.0,
        help='degrees from the first to the last reading, the middle one straight ahead, where '
        'the log names no angles; 0: by the number of readings',
    )
    parser.add_argument(
        '--particles', type=int, default=0, help='particles per scan; 0: as many as in the log'
    )
    parser.add_argument(
        '--repeat-step', type=float, default=0.1, help='largest step between repeated stamps, s'
    )
    parser.add_argument('--time-offset', type=float, default=0.0, help='added to all times, s')
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    check_options(options, RANGES)
    choices = ImportOptions(
        range_max_m=options.range_max,
        no_return_from_m=options.no_return_from,
        field_of_view_deg=options.field_of_view,
        particles=options.particles,
        repeat_step_s=options.repeat_step,
        time_offset_s=options.time_offset,
    )
    summary = import_carmen(options.log, options.output, choices, overwrite=options.overwrite)
    print_result(options, summary.as_dict(), describe(summary))
    return 0


def describe(summary: ImportSummary) -> str:
    """Say what was read and what was mended."""
    share = summary.no_return / max(1, summary.readings)
    codes = ', '.join(f'value {code}, {n}' for code, n in summary.no_return_codes_m.items())
    rules = ' / '.join(dict.fromkeys(summary.no_return_rules.values()))
    scans = ', '.join(f'{count} on {topic}' for topic, count in summary.scans.items())
    reach = ', '.join(f'{value:g}' for value in summary.range_max_m.values())
    lines = [
        f'{summary.source} -> {summary.bag}',
        f'  scans         {scans}; {summary.beams} beams, {summary.angle_increment_deg} degrees '
        f'apart, range_max {reach} m',
        f'  no return     {summary.no_return} of {summary.readings} readings ({share:.1%}) -> inf'
        + (f': {codes} ({rules})' if codes else ''),
    ]
    if summary.particles_per_scan:
        lines.append(f'  particles     {summary.particles_per_scan} per scan')
    if summary.odometry:
        lines.append(f'  odometry      {summary.odometry} on odom{_odometry_remark(summary)}')
    if summary.raw_scans:
        lines.append(
            '  poses         from odometry: RAWLASER lines name none; interpolated at the time of '
            'each scan'
        )
    lines.extend(_mended(summary))
    if summary.left_alone:
        left = ', '.join(f'{count} {kind}' for kind, count in summary.left_alone.items())
        lines.append(f'  left alone    {left}')
    return '\n'.join(lines)


def _odometry_remark(summary: ImportSummary) -> str:
    distance = summary.odometry_to_pose_median_m
    if distance is None:
        return ''
    kind = 'moved along with the corrected poses' if distance < 0.5 else 'a frame of its own'
    return f' ({kind}: median {distance:.2f} m from the scan pose)'


def _mended(summary: ImportSummary) -> list[str]:
    mended = []
    if summary.out_of_order:
        late = ', '.join(f'{count} {kind}' for kind, count in summary.out_of_order.items())
        mended.append(f'  out of order  {late}: sorted by time')
    if summary.repeated_stamps:
        no_times = '; all are the same: times between scans are made up'
        mended.append(
            f'  repeated      {summary.repeated_stamps} stamps spread out, by up to '
            f'{summary.largest_shift_s:.3g} s{no_times if summary.without_times else ""}'
        )
    if summary.odometry_echoes:
        mended.append(
            f'  echoes        {summary.odometry_echoes} ODOM lines that only repeat the scan '
            'before them, without a time of their own: left out'
        )
    if summary.clock_shift_s or summary.clock_jumps:
        mended.append(
            f'  clock         shifted by {summary.clock_shift_s:.12g} s to start at 0, '
            f'{summary.clock_jumps} jumps closed: in the order of the file'
        )
    if summary.damaged_lines:
        mended.append(
            f'  left out      {summary.damaged_lines} lines that cannot be used, '
            f'the first: {summary.first_damage}'
        )
    if summary.without_angles:
        counts = ', '.join(f'{n} of {beams}' for beams, n in summary.without_angles.items())
        mended.append(
            f'  no angles     scans by number of readings, left out: {counts}; '
            '--field-of-view gives them angles'
        )
    if summary.without_odometry:
        mended.append(
            f'  no pose       {summary.without_odometry} raw scans before, after or in gaps of '
            'the odometry: left out'
        )
    if summary.without_particles:
        mended.append(f'  no particles  {summary.without_particles} scans without: left out')
    if summary.cut:
        mended.append(f'  cut off       {summary.cut}: what comes before it is imported')
    return mended or ['  mended        nothing']
