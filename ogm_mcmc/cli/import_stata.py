"""`import-stata BAG --poses CSV -o BAG`: a Stata Center bag and its poses become a rosbag2."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from ogm_mcmc.cli.option_ranges import Range, check_options
from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.errors import OutputError
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.stata_import import StataOptions, StataSummary, import_stata

__all__ = ['add_to']

RANGES = {
    'time_offset': Range(-(2.0**31), 2.0**31, 's'),
    'offset_x': Range(-100, 100, 'm'),
    'max_pose_gap': Range(1e-6, 3600, 's'),
}


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'import-stata', help='MIT Stata Center bag and laser poses to rosbag2'
    )
    parser.add_argument('bag', type=Path, help='ROS 1 bag of the PR2')
    parser.add_argument(
        '--poses', type=Path, required=True, metavar='CSV', help='its .gt.laser.poses file'
    )
    parser.add_argument('-o', '--output', type=Path, required=True, help='rosbag2 to make')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing bag')
    defaults = StataOptions()
    parser.add_argument('--scan-topic', default=defaults.scan_topic)
    parser.add_argument(
        '--odometry-topic', help=f'default: {defaults.odometry_topic}, if it is there'
    )
    parser.add_argument(
        '--time-offset', type=float, default=0.0, help='added to the times of the poses, s'
    )
    parser.add_argument(
        '--offset-x', type=float, default=0.0, help='moves poses ahead along their heading, m'
    )
    parser.add_argument(
        '--max-pose-gap',
        type=float,
        default=defaults.max_pose_gap_s,
        help='scans between poses further apart are left out, s',
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    check_options(options, RANGES)
    if options.output.exists() and options.output.resolve() == options.bag.resolve():
        raise OutputError(f'{options.output}: is the bag to read; expected a new name')
    if options.odometry_topic is not None:
        with BagReader(options.bag) as bag:  # one that was named is there
            bag.find('odometry', (ros_types.ODOMETRY,), options.odometry_topic)
    choices = StataOptions(
        options.scan_topic,
        options.odometry_topic or StataOptions().odometry_topic,
        options.time_offset,
        options.offset_x,
        options.max_pose_gap,
    )
    with tqdm(unit=' messages', desc='import-stata', disable=None) as bar:
        summary = import_stata(
            options.bag,
            options.poses,
            options.output,
            choices,
            overwrite=options.overwrite,
            on_record=bar.update,
        )
    print_result(options, summary.as_dict(), _text(summary))
    return 0


def _text(of: StataSummary) -> str:
    return '\n'.join(
        [
            f'{of.source} + {of.poses_file} -> {of.bag}',
            f'  poses      {of.poses} (out of order {of.poses_out_of_order}, '
            f'repeated and left out {of.poses_repeated})',
            f'  scans      {of.scans} (left out: {of.scans_before_first_pose} before the first '
            f'pose, {of.scans_after_last_pose} after the last, {of.scans_in_gaps} in gaps)',
            f'  odometry   {of.odometry} on odom',
        ]
    )
