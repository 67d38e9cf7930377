"""`simulate WORLD -o BAG`: a recording from a simulated building, and the truth beside it.

BAG_truth.pgm, .yaml and .png are the true map, BAG_poses.csv holds the true pose of every scan.
With --drive BAG_trajectory.tum holds the true poses of the nodes that a SLAM system would keep.
With sonars BAG_sonars.yaml says where they sit, as `map --params-file` takes it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from ogm_mcmc.cli.option_ranges import Range, check_options
from ogm_mcmc.cli.options import Subparsers, add_json, add_max_cells, print_result
from ogm_mcmc.cli.simulated_drive import add_drive_options, check_drive_options, driven
from ogm_mcmc.cli.simulated_sensor import add_sensor_options, check_sensor_options, sensor_from
from ogm_mcmc.cli.simulated_world import (
    add_world_options,
    check_world_options,
    exploration_from,
    loaded,
    true_map,
    turned,
)
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import write_shown
from ogm_mcmc.errors import OutputError
from ogm_mcmc.files.output_files import makeable_folder, refuse_folder, replacing_set
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.io.recording_bag import write_drive, write_localized, write_recording
from ogm_mcmc.io.sonar_bag import write_sonar_parameters, write_sonar_recording
from ogm_mcmc.io.trajectory_files import write_tum
from ogm_mcmc.io.world_files import WORLD_NAMES, write_poses
from ogm_mcmc.simulation import (
    Building,
    GridWorld,
    Lidar,
    SonarRing,
    rasterised,
    record,
    record_exploration,
    record_exploration_with_sonars,
    record_localized,
    record_with_sonars,
)

__all__ = ['add_to']


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
    add_world_options(parser)
    add_drive_options(parser)
    add_max_cells(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    check_options(options, {'seed': Range(0)})
    check_sensor_options(options)
    check_world_options(options)
    check_drive_options(options)
    simulated = _simulated(options)
    output, ring = options.output, simulated.ring
    if not output.name:
        raise OutputError(f'{output}: expected the name of a bag')
    beside = _files_beside(options)
    makeable_folder(output.parent)
    poses: dict[int, Pose2D] = {}
    nodes: list[int] = []
    # Another sensor or way of the bag that is replaced left these.
    others = [_beside(output, suffix).name for suffix in ('_trajectory.tum', '_sonars.yaml')]
    truth_name = f'{output.name}_truth'
    with replacing_set(output.parent, truth_name, others if options.overwrite else ()) as scratch:
        with tqdm(simulated.scans, unit=' scans', desc='simulate', disable=None) as bar:
            count = simulated.write(_noted(bar, simulated.truth_of, poses, nodes), scratch)
        write_poses(scratch / beside['poses'].name, poses.items())
        if options.drive:
            kept = (poses[stamp_ns] for stamp_ns in nodes)
            write_tum(scratch / beside['trajectory'].name, nodes, kept)
        if ring is not None:
            write_sonar_parameters(scratch / beside['sonars'].name, ring)
        write_shown(simulated.truth, scratch, OutputConfig(), truth_name)
    told = {name: str(path) for name, path in beside.items() if name not in ('pgm', 'png')}
    result = {'bag': str(output), 'scans': count, 'seed': options.seed, **told}
    what = 'scans' if ring is None else 'readings'
    text = f'{count} {what} -> {output} (seed {options.seed}); truth: '
    print_result(options, result, text + ', '.join(told.values()))
    return 0


def _beside(output: Path, suffix: str) -> Path:
    return output.with_name(output.name + suffix)


def _files_beside(options: argparse.Namespace) -> dict[str, Path]:
    """Return the files to come. Raises OutputError where one is there and may not be replaced."""
    suffixes = {'pgm': '_truth.pgm', 'truth': '_truth.yaml', 'png': '_truth.png'}
    suffixes['poses'] = '_poses.csv'
    if options.drive:
        suffixes['trajectory'] = '_trajectory.tum'
    if options.sensor == 'sonar':
        suffixes['sonars'] = '_sonars.yaml'
    beside = {name: _beside(options.output, suffix) for name, suffix in suffixes.items()}
    for path in beside.values():
        refuse_folder(path)
        if path.exists() and path.resolve() == user_path(options.world).resolve():
            raise OutputError(f'{path}: is the world itself; expected a new name')
        if path.exists() and not options.overwrite:
            raise OutputError(f'{path}: exists already; expected a new name (or --overwrite)')
    return beside


class _Truth(NamedTuple):
    """The robot's true pose at the stamp of a scan; whether a SLAM system keeps it."""

    stamp_ns: int
    pose: Pose2D
    is_node: bool = False


class _Simulated(NamedTuple):
    """The true map, the scans to come, what holds of each, the sonars.

    write  makes a bag of scans in a folder; returns how many
    """

    truth: GridMap
    scans: Iterator[Any]
    truth_of: Callable[[Any], _Truth]
    write: Callable[[Iterator[Any], Path], int]
    ring: SonarRing | None = None


def _noted(
    scans: Iterable[Any],
    truth_of: Callable[[Any], _Truth],
    poses: dict[int, Pose2D],
    nodes: list[int],
) -> Iterator[Any]:
    """Pass scans on and note the robot's true pose by stamp, and the stamps of nodes.

    Sonars of one stamp share the pose.
    """
    for one in scans:
        truth = truth_of(one)
        if truth.is_node:
            nodes.append(truth.stamp_ns)
        poses.setdefault(truth.stamp_ns, truth.pose)
        yield one


def _simulated(options: argparse.Namespace) -> _Simulated:
    world = loaded(options)
    cell_m = options.resolution if isinstance(world, Building) else world.spec.resolution_m
    sensor, rng = sensor_from(options, cell_m), np.random.default_rng(options.seed)
    if isinstance(sensor, SonarRing):
        return _by_sonars(options, world, sensor, rng)
    return _by_lidar(options, world, sensor, rng)


def _by_sonars(
    options: argparse.Namespace,
    world: Building | GridWorld,
    ring: SonarRing,
    rng: np.random.Generator,
) -> _Simulated:
    if isinstance(world, Building):
        scans = record_with_sonars(world, ring, rng)
    else:
        way = exploration_from(options, ring.range_max_m, world.spec.resolution_m)
        scans = record_exploration_with_sonars(world, ring, way, rng, depth=options.depth)
        scans = turned(options, world, scans)
    mounts, output, overwrite = ring.mounts(), options.output, options.overwrite
    back = {frame: mount.inverse() for frame, mount in mounts.items()}
    return _Simulated(
        _true_map(options, world),
        scans,
        lambda one: _Truth(one.scan.stamp_ns, one.pose.compose(back[one.scan.frame_id])),
        lambda held, into: write_sonar_recording(
            output, held, mounts, overwrite=overwrite, into=into
        ),
        ring,
    )


def _by_lidar(
    options: argparse.Namespace,
    world: Building | GridWorld,
    lidar: Lidar,
    rng: np.random.Generator,
) -> _Simulated:
    output, overwrite = options.output, options.overwrite
    truth = _true_map(options, world)
    if options.drive:
        return _Simulated(
            truth,
            driven(options, world, lidar, rng),
            lambda one: _Truth(one.scan.stamp_ns, one.truth, one.is_node),
            lambda held, into: write_drive(output, held, overwrite=overwrite, into=into),
        )
    placed = _Simulated(
        truth,
        iter(()),
        lambda one: _Truth(one.scan.stamp_ns, one.pose),
        lambda held, into: write_recording(output, held, overwrite=overwrite, into=into),
    )
    if isinstance(world, Building):
        return placed._replace(scans=record(world, lidar, rng))
    way, depth = (
        exploration_from(options, lidar.range_max_m, world.spec.resolution_m),
        options.depth,
    )
    if not options.localize:
        scans = record_exploration(world, lidar, way, rng, depth=depth)
        return placed._replace(scans=turned(options, world, scans))
    count = options.particles
    return _Simulated(
        truth,
        record_localized(world, lidar, way, rng, depth=depth),
        lambda one: _Truth(one.placed.scan.stamp_ns, one.truth),
        lambda held, into: write_localized(
            output, held, particles=count, overwrite=overwrite, into=into
        ),
    )


def _true_map(options: argparse.Namespace, world: Building | GridWorld) -> GridMap:
    if isinstance(world, Building):
        return rasterised(world, options.resolution)
    return true_map(options, world)
