"""`simulate WORLD -o BAG`: a recording from a simulated building, and the truth beside it.

BAG_truth.pgm, .yaml and .png are the true map, BAG_poses.csv holds the true pose of every scan.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from tqdm import tqdm

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.errors import ConfigError, OutputError, require
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.io.map_files import save_map, writable_folder
from ogm_mcmc.io.recording_bag import write_localized, write_recording
from ogm_mcmc.io.world_files import WORLD_NAMES, load_world, write_poses
from ogm_mcmc.simulation import (
    Building,
    Exploration,
    Lidar,
    LocalizedScan,
    SimulatedScan,
    rasterised,
    record,
    record_exploration,
    record_localized,
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
    lidar = parser.add_argument_group('lidar')
    lidar.add_argument('--beams', type=int, default=360)
    lidar.add_argument('--field-of-view', type=float, default=360.0, help='degrees')
    lidar.add_argument('--range-max', type=float, default=12.0, help='m')
    lidar.add_argument('--range-min', type=float, default=0.1, help='m')
    noise = lidar.add_mutually_exclusive_group()
    noise.add_argument('--noise', type=float, default=0.01, help='of the ranges, m')
    noise.add_argument('--noise-cells', type=float, help='likewise, in cells of the world')
    lidar.add_argument('--dropout', type=float, default=0.002, help='share of lost returns')
    lidar.add_argument('--clutter', type=float, default=0.0, help='share of arbitrary readings')
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
    grid.add_argument('--min-scans', type=int, default=0, help='go on after all was covered')
    grid.add_argument('--max-scans', type=int, default=1000)
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
    truth, scans = _recording(options)
    output = options.output
    if not output.name:
        raise OutputError(f'{output}: expected the name of a bag')
    beside = [
        output.with_name(output.name + suffix)
        for suffix in ('_truth.pgm', '_truth.yaml', '_truth.png', '_poses.csv')
    ]
    for path in beside:
        if path.is_dir() or (path.exists() and not options.overwrite):
            raise OutputError(f'{path}: exists already; expected a new name (or --overwrite)')
    writable_folder(output.parent)
    poses: list[tuple[int, Pose2D]] = []
    with tqdm(scans, unit=' scans', desc='simulate', disable=None) as bar:
        noted = _noted(bar, poses)
        if options.localize:
            count = write_localized(
                output, noted, particles=options.particles, overwrite=options.overwrite
            )
        else:
            count = write_recording(
                output, ((one.scan, one.pose) for one in noted), overwrite=options.overwrite
            )
    write_poses(beside[3], poses)
    save_map(truth, output.parent, OutputConfig(), f'{output.name}_truth')
    result = {
        'bag': str(output),
        'scans': count,
        'seed': options.seed,
        'truth': str(beside[1]),
        'poses': str(beside[3]),
    }
    text = f'{count} scans -> {output} (seed {options.seed}); truth: {beside[1]}, {beside[3]}'
    print_result(options, result, text)
    return 0


def _noted(scans: Iterable[S], poses: list[tuple[int, Pose2D]]) -> Iterator[S]:
    """Pass scans on and note their true poses."""
    for one in scans:
        poses.append((one.scan.stamp_ns, one.pose))
        yield one


def _recording(options: argparse.Namespace) -> tuple[GridMap, Iterator[Any]]:
    """Return the true map and the scans to come."""
    world = load_world(
        options.world,
        resolution_m=options.resolution,
        unknown_occupied=options.unknown == 'occupied',
        world_seed=options.world_seed,
    )
    cell_m = options.resolution if isinstance(world, Building) else world.spec.resolution_m
    noise_m = options.noise if options.noise_cells is None else options.noise_cells * cell_m
    lidar = Lidar(
        options.beams,
        options.range_min,
        options.range_max,
        noise_m,
        options.dropout,
        options.clutter,
        math.radians(options.field_of_view),
    )
    rng = np.random.default_rng(options.seed)
    if isinstance(world, Building):
        if options.localize:
            raise ConfigError(f'--localize: expected a world of cells, not {options.world}')
        if not options.resolution > 0.0:
            raise ConfigError(f'resolution is {options.resolution}: must be positive')
        return rasterised(world, options.resolution), record(world, lidar, rng)
    exploration = Exploration(
        reach=options.range_max / cell_m,
        radius=options.radius / cell_m,
        min_stops=options.min_scans,
        max_stops=max(options.max_scans, options.min_scans),
    )
    make = record_localized if options.localize else record_exploration
    return world.truth(), make(world, lidar, exploration, rng, depth=options.depth)
