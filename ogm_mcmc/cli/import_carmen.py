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
    codes = ', '.join(f'{count} at {code} m' for code, count in summary.no_return_codes_m.items())
    scans = ', '.join(f'{count} on {topic}' for topic, count in summary.scans.items())
    reach = ', '.join(f'{value:g}' for value in summary.range_max_m.values())
    lines = [
        f'{summary.source} -> {summary.bag}',
        f'  scans         {scans}; {summary.beams} beams, {summary.angle_increment_deg} degrees '
        f'apart, range_max {reach} m',
        f'  no return     {summary.no_return} of {summary.readings} readings ({share:.1%}) -> inf'
        + (f': {codes}' if codes else ''),
    ]
    if summary.particles_per_scan:
        lines.append(f'  particles     {summary.particles_per_scan} per scan')
    if summary.odometry:
        lines.append(f'  odometry      {summary.odometry} on odom{_odometry_remark(summary)}')
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
        mended.append(
            f'  repeated      {summary.repeated_stamps} stamps spread out, '
            f'by up to {summary.largest_shift_s:.3g} s'
        )
    if summary.odometry_echoes:
        mended.append(
            f'  echoes        {summary.odometry_echoes} ODOM lines that only repeat the scan '
            'before them, without a time of their own: left out'
        )
    return mended or ['  mended        nothing']
