"""Options of `simulate` that describe the world and the way through it."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from ogm_mcmc.cli.option_ranges import Range, check_options, is_given, option_name, refused
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.io.world_files import load_world, world_kind
from ogm_mcmc.simulation import Building, Exploration, GridWorld, Turned

__all__ = [
    'add_world_options',
    'check_cells',
    'check_world_options',
    'exploration_from',
    'loaded',
    'true_map',
    'turned',
]


class Use(NamedTuple):
    """The kinds of worlds that have a use for an option, in words too, and its default there."""

    kinds: tuple[str, ...]
    expected: str
    default: Any


def _of_cells(default: Any) -> Use:
    return Use(('building', 'map', 'image'), 'a world of cells', default)


# Of the namespace; an option that was not given is None there until `check_world_options`.
USES = {
    'world_seed': Use(('building',), 'building-1 to building-10', 0),
    'resolution': Use(('walls', 'image'), 'office, ring or an image', 0.05),
    'unknown': Use(('map', 'image'), 'a map YAML, an NPZ or an image', 'occupied'),
    'depth': _of_cells(0.5),
    'radius': _of_cells(0.25),
    'min_scans': _of_cells(0),
    'max_scans': _of_cells(1000),
    'localize': _of_cells(False),
    'particles': _of_cells(100),
    'turn': _of_cells(0.0),
    'truth_resolution': _of_cells(0.0),
}

# A cell of a truth is no smaller.
LEAST_M = 1e-4

RANGES = {
    'world_seed': Range(0),
    'resolution': Range(0.002, 10, 'm'),
    'depth': Range(0, 1),
    'min_scans': Range(0),
    'max_scans': Range(1),
    'particles': Range(1, 100_000),
    'turn': Range(-360, 360, 'degrees'),
    'truth_resolution': Range(0, 10, 'm'),
}

# Of what a robot can do, see `Exploration`; so in metres it depends on the world.
CELLS = {'radius': Range(0, 100), 'range_max': Range(1, 100_000, below=True)}


def add_world_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""

    def add(option: str, kind: type, text: str) -> None:
        use = USES[option[2:].replace('-', '_')]
        told = f'{text}; default {use.default}; of {use.expected}'
        group.add_argument(option, type=kind, help=told)

    group = parser.add_argument_group('worlds')
    add('--world-seed', int, 'which of the generated buildings')
    add('--resolution', float, "m per pixel of an image; the true map's")
    group.add_argument(
        '--unknown', choices=('occupied', 'free'), help='what unknown cells are; default occupied'
    )
    add('--depth', float, 'of a reflection: 0 where the beam enters a cell')
    add('--radius', float, 'of the robot, m')
    add('--min-scans', int, 'stops; go on after all was covered')
    add('--max-scans', int, 'stops at most')
    group.add_argument(
        '--localize', action='store_true', help='poses from odometry and a particle filter'
    )
    add('--particles', int, 'of a belief, in the bag (--localize)')
    add(
        '--turn',
        float,
        'the world lies turned by this about its middle, degrees: no wall follows the lattice of '
        'the map. Cells of the truth are occupied from half of their area on, free where nothing '
        'of them is solid, else unknown',
    )
    add('--truth-resolution', float, 'side of a cell of the truth, m (--turn); 0: as in the world')


def check_world_options(options: argparse.Namespace) -> None:
    """Refuse what the chosen world has no use for, or cannot be; fill in defaults."""
    kind = world_kind(options.world)
    for name, use in USES.items():
        if is_given(options, name) and kind not in use.kinds:
            expected = f'expected with {use.expected}, not {options.world}'
            raise ConfigError(f'{option_name(name)}: {expected}')
    if options.particles is not None and not options.localize:
        raise ConfigError('--particles: expected with --localize')
    if options.turn is not None and (options.localize or options.drive):
        raise ConfigError('--turn: expected without --localize and --drive')
    if options.truth_resolution is not None and not options.turn:
        raise ConfigError('--truth-resolution: expected with --turn')
    check_options(options, RANGES)
    if options.truth_resolution and options.truth_resolution < LEAST_M:
        expected = f'expected 0, or {LEAST_M:g} to {RANGES["truth_resolution"].high:g} m'
        raise refused('truth_resolution', options.truth_resolution, expected)
    for name, use in USES.items():
        if getattr(options, name) is None:
            setattr(options, name, use.default)
    if options.min_scans > options.max_scans:
        at_most = f'expected at most --max-scans ({options.max_scans})'
        raise refused('min_scans', options.min_scans, at_most)


def loaded(options: argparse.Namespace) -> Building | GridWorld:
    """Load the world of options that were checked."""
    return load_world(
        options.world,
        resolution_m=options.resolution,
        unknown_occupied=options.unknown == 'occupied',
        world_seed=options.world_seed,
        most_cells=options.max_cells,
    )


def true_map(options: argparse.Namespace, world: GridWorld) -> GridMap:
    """Return the truth of a world of cells as it lies in the map. Raises ConfigError."""
    if options.turn == 0.0:
        return world.truth()
    lying = Turned.about_middle(world, math.radians(options.turn))
    spec = lying.spec(options.truth_resolution or world.spec.resolution_m)
    if spec.width * spec.height > options.max_cells:
        raise ConfigError(
            f'the turned truth of {options.world} would have {spec.width} x {spec.height} cells: '
            f'expected at most {options.max_cells} (--max-cells, --truth-resolution)'
        )
    return lying.truth(spec)


def turned(
    options: argparse.Namespace, world: GridWorld, scans: Iterator[PlacedScan]
) -> Iterator[PlacedScan]:
    """Return scans taken in a world of cells where they are in the map."""
    if options.turn == 0.0:
        return scans
    return Turned.about_middle(world, math.radians(options.turn)).placed(scans)


def check_cells(name: str, length_m: float, cell_m: float) -> None:
    """Refuse a length that is no sensible number of cells; `name`: of the option."""
    allowed = CELLS[name]
    if not allowed.holds(length_m / cell_m):
        in_metres = Range(allowed.low * cell_m, allowed.high * cell_m, 'm', allowed.below)
        raise refused(name, length_m, f'expected {in_metres} ({allowed} cells of {cell_m:g} m)')


def exploration_from(
    options: argparse.Namespace, range_max_m: float, cell_m: float
) -> Exploration:
    """Return how the robot explores a world of cells. Raises ConfigError."""
    check_cells('radius', options.radius, cell_m)
    check_cells('range_max', range_max_m, cell_m)
    return Exploration(
        reach=range_max_m / cell_m,
        radius=options.radius / cell_m,
        min_stops=options.min_scans,
        max_stops=options.max_scans,
    )
