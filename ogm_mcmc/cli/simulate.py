"""`simulate WORLD -o BAG`: a recording from a simulated building, and the truth beside it.

BAG_truth.pgm, .yaml and .png are the true map, BAG_poses.csv holds the true pose of every scan.
With sonars BAG_sonars.yaml says where they sit, as `map --params-file` takes it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from tqdm import tqdm

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.cli.simulated_sensor import add_sensor_options, sensor_from
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.errors import ConfigError, OutputError, require
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.io.map_files import save_map, writable_folder
from ogm_mcmc.io.recording_bag import write_localized, write_recording
from ogm_mcmc.io.sonar_bag import write_sonar_parameters, write_sonar_recording
from ogm_mcmc.io.world_files import WORLD_NAMES, load_world, write_poses
from ogm_mcmc.simulation import (
    Building,
    Exploration,
    Lidar,
    LocalizedScan,
    SimulatedScan,
    SonarRing,
    rasterised,
    record,
    record_exploration,
    record_exploration_with_sonars,
    record_localized,
    record_with_sonars,
)

__all__ = ['add_to']

S = TypeVar('S', SimulatedScan, LocalizedScan)


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('simulate', help='record scans in a simulated building')
    parser.add_argument(
        'world', help=f'{", ".join(WORLD_NAMES)}; or a map YAML, an NPZ or an image'
    )
    parser.add_argument('-o', '--output', type=Path, required=True, help='rosbag2 to make')
    parser.add_argument('--overwrite', action='store_true', help='replace what exists')
    parser.add_argument('--seed', type=int, default=1, help='seed of the way and of the noise')
    add_sensor_options(parser)
    grid = parser.add_argument_group('worlds of cells')
    grid.add_argument('--world-seed', type=int, default=0, help='which of the generated buildings')
    grid.add_argument(
        '--resolution', type=float, default=0.05, help="m per pixel of an image; the true map's"
    )
    grid.add_argument('--unknown', choices=('occupied', 'free'), default='occupied')
    grid.add_argument(
        '--depth', type=float, default=0.5, help='of a reflection: 0 where the beam enters a cell'
    )
    grid.add_argument('--radius', type=float, default=0.25, help='of the robot, m')
    grid.add_argument(
        '--min-scans', type=int, default=0, help='stops; go on after all was covered'
    )
    grid.add_argument('--max-scans', type=int, default=1000, help='stops at most')
    grid.add_argument(
        '--localize', action='store_true', help='poses from odometry and a particle filter'
    )
    grid.add_argument('--particles', type=int, default=100, help='of a belief, in the bag')
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    require(options.seed >= 0, 'seed', options.seed, 'expected 0 or more')
    require(options.particles > 0, 'particles', options.particles, 'expected at least one')
    require(options.world_seed >= 0, 'world_seed', options.world_seed, 'expected 0 or more')
    require(0.0 <= options.depth <= 1.0, 'depth', options.depth, 'expected 0 to 1')
    sensor, truth, scans = _recording(options)
    output = options.output
    if not output.name:
        raise OutputError(f'{output}: expected the name of a bag')
    beside = _files_beside(options, sensor)
    writable_folder(output.parent)
    poses: dict[int, Pose2D] = {}
    with tqdm(scans, unit=' scans', desc='simulate', disable=None) as bar:
        count = _write_bag(options, _noted(bar, poses))
    write_poses(beside['poses'], poses.items())
    if isinstance(sensor, SonarRing):
        write_sonar_parameters(beside['sonars'], sensor)
    elif options.overwrite:
        _beside(output, '_sonars.yaml').unlink(missing_ok=True)  # of the bag replaced
    save_map(truth, output.parent, OutputConfig(), f'{output.name}_truth')
    told = {name: str(path) for name, path in beside.items() if name not in ('pgm', 'png')}
    result = {'bag': str(output), 'scans': count, 'seed': options.seed, **told}
    what = 'readings' if isinstance(sensor, SonarRing) else 'scans'
    text = f'{count} {what} -> {output} (seed {options.seed}); truth: '
    print_result(options, result, text + ', '.join(told.values()))
    return 0


def _beside(output: Path, suffix: str) -> Path:
    return output.with_name(output.name + suffix)


def _files_beside(options: argparse.Namespace, sensor: Lidar | SonarRing) -> dict[str, Path]:
    """Return the files to come. Raises OutputError where one is there and may not be replaced."""
    suffixes = {'pgm': '_truth.pgm', 'truth': '_truth.yaml', 'png': '_truth.png'}
    suffixes['poses'] = '_poses.csv'
    if isinstance(sensor, SonarRing):
        suffixes['sonars'] = '_sonars.yaml'
    beside = {name: _beside(options.output, suffix) for name, suffix in suffixes.items()}
    for path in beside.values():
        if path.is_dir() or (path.exists() and not options.overwrite):
            raise OutputError(f'{path}: exists already; expected a new name (or --overwrite)')
    return beside


def _write_bag(options: argparse.Namespace, scans: Iterator[Any]) -> int:
    """Write the bag; return the number of scans or readings."""
    output, overwrite = options.output, options.overwrite
    if options.localize:
        return write_localized(output, scans, particles=options.particles, overwrite=overwrite)
    placed = ((one.scan, one.pose) for one in scans)
    write = write_sonar_recording if options.sensor == 'sonar' else write_recording
    return write(output, placed, overwrite=overwrite)


def _noted(scans: Iterable[S], poses: dict[int, Pose2D]) -> Iterator[S]:
    """Pass scans on and note their true poses by stamp: sonars of one stamp share theirs."""
    for one in scans:
        poses[one.scan.stamp_ns] = one.pose
        yield one


def _recording(
    options: argparse.Namespace,
) -> tuple[Lidar | SonarRing, GridMap, Iterator[Any]]:
    """Return the sensor, the true map and the scans to come."""
    world = load_world(
        options.world,
        resolution_m=options.resolution,
        unknown_occupied=options.unknown == 'occupied',
        world_seed=options.world_seed,
    )
    cell_m = options.resolution if isinstance(world, Building) else world.spec.resolution_m
    sensor = sensor_from(options, cell_m)
    rng = np.random.default_rng(options.seed)
    if isinstance(world, Building):
        if options.localize:
            raise ConfigError(f'--localize: expected a world of cells, not {options.world}')
        if not options.resolution > 0.0:
            raise ConfigError(f'resolution is {options.resolution}: must be positive')
        truth = rasterised(world, options.resolution)
        if isinstance(sensor, SonarRing):
            return sensor, truth, record_with_sonars(world, sensor, rng)
        return sensor, truth, record(world, sensor, rng)
    exploration = Exploration(
        reach=sensor.range_max_m / cell_m,
        radius=options.radius / cell_m,
        min_stops=options.min_scans,
        max_stops=max(options.max_scans, options.min_scans),
    )
    depth = options.depth
    if isinstance(sensor, SonarRing):
        scans = record_exploration_with_sonars(world, sensor, exploration, rng, depth=depth)
        return sensor, world.truth(), scans
    make = record_localized if options.localize else record_exploration
    return sensor, world.truth(), make(world, sensor, exploration, rng, depth=depth)
