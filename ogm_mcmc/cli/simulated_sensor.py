"""Options of `simulate` that describe the sensor: a lidar or a ring of sonars."""

from __future__ import annotations

import argparse
import math
from typing import Any

from ogm_mcmc.cli.option_ranges import Range, check_options, is_given, option_name, refused
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.simulation import Lidar, SonarRing

__all__ = ['FURTHEST_M', 'add_sensor_options', 'check_sensor_options', 'sensor_from']

# What only one of the two has, by the option's name.
OWN = {'beams': 'lidar', 'localize': 'lidar', 'sonars': 'sonar', 'ring_radius': 'sonar'}

FURTHEST_M = 100_000.0

RANGES = {
    'beams': Range(1, 100_000),
    'sonars': Range(1, 1000),
    'ring_radius': Range(0, 10, 'm'),
    'range_max': Range(0, FURTHEST_M, 'm'),
    'range_min': Range(0, FURTHEST_M, 'm'),
    'noise': Range(0, FURTHEST_M, 'm'),
    'noise_cells': Range(0, FURTHEST_M, 'cells'),
    'dropout': Range(0, 1, below=True),
    'clutter': Range(0, 1, below=True),
}

# Angles between beams that a LaserScan can hold.
VIEWS = {
    'lidar': Range(0.001, 360, 'degrees'),
    'sonar': Range(0.001, 180, 'degrees', below=True),
}


def add_sensor_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options; those not given keep the default of their sensor."""
    lidar, ring = Lidar(), SonarRing()
    group = parser.add_argument_group('sensor')
    group.add_argument(
        '--sensor',
        choices=('lidar', 'sonar'),
        default='lidar',
        help='lidar: LaserScan on /scan; sonar: a ring of them, Range on /range',
    )
    group.add_argument('--beams', type=int, help=f'of the lidar; default {lidar.beams}')
    group.add_argument('--sonars', type=int, help=f'in the ring; default {ring.sonars}')
    group.add_argument(
        '--ring-radius', type=float, help=f'from the middle to a sonar, m; default {ring.radius_m}'
    )
    group.add_argument(
        '--field-of-view',
        type=float,
        help='of the lidar, or the cone of each sonar, degrees; default '
        f'{math.degrees(lidar.field_of_view_rad):.0f}, of a sonar '
        f'{math.degrees(ring.field_of_view_rad):.1f}',
    )

    def both(option: str, field: str, text: str, to: Any = group) -> None:
        defaults = f'{getattr(lidar, field):g}, of a sonar {getattr(ring, field):g}'
        to.add_argument(option, type=float, help=f'{text}; default {defaults}')

    both('--range-max', 'range_max_m', 'm')
    both('--range-min', 'range_min_m', 'm')
    noise = group.add_mutually_exclusive_group()
    both('--noise', 'noise_m', 'of the ranges, m', noise)
    noise.add_argument('--noise-cells', type=float, help='likewise, in cells of the world')
    both('--dropout', 'dropout', 'share of lost returns')
    both('--clutter', 'clutter', 'share of arbitrary readings')


def check_sensor_options(options: argparse.Namespace) -> None:
    """Raise ConfigError for an option of the other sensor or a value that cannot be."""
    for name, sensor in OWN.items():
        if is_given(options, name) and sensor != options.sensor:
            expected = f'expected with --sensor {sensor}, not {options.sensor}'
            raise ConfigError(f'{option_name(name)}: {expected}')
    check_options(options, {**RANGES, 'field_of_view': VIEWS[options.sensor]})
    default = SonarRing() if options.sensor == 'sonar' else Lidar()
    nearest = default.range_min_m if options.range_min is None else options.range_min
    furthest = default.range_max_m if options.range_max is None else options.range_max
    if nearest < furthest:
        return
    if options.range_max is not None:
        raise refused('range_max', furthest, f'expected more than --range-min ({nearest:g} m)')
    raise refused('range_min', nearest, f'expected less than --range-max ({furthest:g} m)')


def sensor_from(options: argparse.Namespace, cell_m: float) -> Lidar | SonarRing:
    """Make the sensor from options that were checked."""
    values: dict[str, Any] = {
        'field_of_view_rad': options.field_of_view,
        'range_min_m': options.range_min,
        'range_max_m': options.range_max,
        'noise_m': options.noise,
        'dropout': options.dropout,
        'clutter': options.clutter,
    }
    if options.field_of_view is not None:
        values['field_of_view_rad'] = math.radians(options.field_of_view)
    if options.noise_cells is not None:
        values['noise_m'] = options.noise_cells * cell_m
    if options.sensor == 'sonar':
        values.update(sonars=options.sonars, radius_m=options.ring_radius)
    else:
        values['beams'] = options.beams
    given = {name: value for name, value in values.items() if value is not None}
    return SonarRing(**given) if options.sensor == 'sonar' else Lidar(**given)
