"""Options of `simulate --drive`: a robot that scans while it moves."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from ogm_mcmc.cli.option_ranges import Range, check_options, is_given, option_name
from ogm_mcmc.cli.simulated_world import exploration_from
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.simulation import (
    Building,
    DrivenScan,
    Driving,
    GridWorld,
    Lidar,
    drive,
    explore,
    tour_of,
    true_ranges,
)

__all__ = ['add_drive_options', 'check_drive_options', 'driven']

RANGES = {
    'rate': Range(0.1, 1000, 'Hz'),
    'duration': Range(0, 1e6, 's'),
    'speed': Range(0.01, 10, 'm/s'),
    'turn_rate': Range(0.01, 10, 'rad/s'),
    'stand': Range(0, 3600, 's'),
    'drift': Range(0, 10),
}

# Option to field of `Driving`.
FIELDS = {
    'rate': 'rate_hz',
    'duration': 'duration_s',
    'speed': 'speed_m_s',
    'turn_rate': 'turn_rad_s',
    'stand': 'stand_s',
    'drift': 'drift',
}


def add_drive_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    default = Driving()
    group = parser.add_argument_group('drive')
    group.add_argument(
        '--drive',
        action='store_true',
        help='the robot goes round all the time and scans while it moves; odometry on /odom',
    )

    def add(option: str, text: str) -> None:
        value = getattr(default, FIELDS[option[2:].replace('-', '_')])
        group.add_argument(option, type=float, help=f'{text}; default {value:g}')

    add('--rate', 'scans a second')
    add('--duration', 's; 0: one tour')
    add('--speed', 'm/s')
    add('--turn-rate', 'rad/s')
    add('--stand', 'how long it stands at every waypoint, s')
    add('--drift', 'errors of odometry, 1: of bad wheels')
    group.add_argument(
        '--poses',
        choices=('true', 'drifting'),
        help='what /pose says; drifting: what odometry says, until the robot is back where it '
        'began and a loop closes: corrected poses come on /trajectory then; default true',
    )


def check_drive_options(options: argparse.Namespace) -> None:
    """Refuse what does not go together, and numbers that no robot has."""
    for name in (*FIELDS, 'poses'):
        if is_given(options, name) and not options.drive:
            raise ConfigError(f'{option_name(name)}: expected with --drive')
    if options.drive and options.localize:
        raise ConfigError('--localize: expected without --drive')
    if options.drive and options.sensor == 'sonar':
        raise ConfigError('--drive: expected with --sensor lidar')
    check_options(options, RANGES)


def driven(
    options: argparse.Namespace,
    world: Building | GridWorld,
    lidar: Lidar,
    rng: np.random.Generator,
) -> Iterator[DrivenScan]:
    """Return the scans of a drive that options describe."""
    values = {field: getattr(options, name) for name, field in FIELDS.items()}
    given = {field: value for field, value in values.items() if value is not None}
    driving = Driving(**given, drifting=options.poses == 'drifting')
    bearings = lidar.bearings()
    if isinstance(world, Building):
        walls = world.walls
        return drive(
            lambda pose: true_ranges(walls, pose, bearings), world.waypoints, lidar, driving, rng
        )
    exploration = exploration_from(options, lidar.range_max_m, world.spec.resolution_m)
    tour = tour_of(world, explore(world, exploration, rng))
    if len(tour) < 2:
        raise ConfigError(
            f'{options.world}: seen from one place: expected a world to drive in, or more '
            '--max-scans'
        )
    grid, depth = world, options.depth
    return drive(
        lambda pose: grid.ranges(pose, bearings, lidar.range_max_m, depth),
        tour,
        lidar,
        driving,
        rng,
    )
