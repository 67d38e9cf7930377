"""`simulate WORLD -o BAG`: a recording from a simulated building, and the truth beside it.

BAG_truth.pgm, .yaml and .png are the true map, BAG_poses.csv holds the true pose of every scan.
With --drive BAG_trajectory.tum holds the true poses of the nodes that a SLAM system would keep.
With sonars BAG_sonars.yaml says where they sit, as `map --params-file` takes it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

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
)
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.errors import OutputError
from ogm_mcmc.files.output_files import makeable_folder, refuse_folder
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.io.recording_bag import write_drive, write_localized, write_recording
from ogm_mcmc.io.sonar_bag import write_sonar_parameters, write_sonar_recording
from ogm_mcmc.io.trajectory_files import write_tum
from ogm_mcmc.io.world_files import WORLD_NAMES, write_poses
from ogm_mcmc.simulation import (
    Building,
    DrivenScan,
    GridWorld,
    Lidar,
    LocalizedScan,
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
    sensor, truth, scans = _recording(options)
    output = options.output
    if not output.name:
        raise OutputError(f'{output}: expected the name of a bag')
    beside = _files_beside(options, sensor)
    makeable_folder(output.parent)
    poses: dict[int, Pose2D] = {}
    nodes: list[int] = []
    with tqdm(scans, unit=' scans', desc='simulate', disable=None) as bar:
        count = _write_bag(options, sensor, _noted(bar, sensor, poses, nodes))
    write_poses(beside['poses'], poses.items())
    if options.drive:
        write_tum(beside['trajectory'], nodes, (poses[stamp_ns] for stamp_ns in nodes))
    elif options.overwrite:
        _beside(output, '_trajectory.tum').unlink(missing_ok=True)
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
    if options.drive:
        suffixes['trajectory'] = '_trajectory.tum'
    if isinstance(sensor, SonarRing):
        suffixes['sonars'] = '_sonars.yaml'
    beside = {name: _beside(options.output, suffix) for name, suffix in suffixes.items()}
    for path in beside.values():
        refuse_folder(path)
        if path.exists() and path.resolve() == user_path(options.world).resolve():
            raise OutputError(f'{path}: is the world itself; expected a new name')
        if path.exists() and not options.overwrite:
            raise OutputError(f'{path}: exists already; expected a new name (or --overwrite)')
    return beside


def _write_bag(
    options: argparse.Namespace, sensor: Lidar | SonarRing, scans: Iterator[Any]
) -> int:
    """Write the bag; return the number of scans or readings."""
    output, overwrite = options.output, options.overwrite
    if options.drive:
        return write_drive(output, scans, overwrite=overwrite)
    if options.localize:
        return write_localized(output, scans, particles=options.particles, overwrite=overwrite)
    if isinstance(sensor, SonarRing):
        return write_sonar_recording(output, scans, sensor.mounts(), overwrite=overwrite)
    return write_recording(output, scans, overwrite=overwrite)


def _noted(
    scans: Iterable[Any],
    sensor: Lidar | SonarRing,
    poses: dict[int, Pose2D],
    nodes: list[int],
) -> Iterator[Any]:
    """Pass scans on and note the robot's true pose by stamp, and the stamps of nodes.

    Sonars of one stamp share the pose.
    """
    mounts = sensor.mounts() if isinstance(sensor, SonarRing) else {}
    for one in scans:
        if isinstance(one, DrivenScan):
            scan, pose = one.scan, one.truth
            if one.is_node:
                nodes.append(scan.stamp_ns)
        elif isinstance(one, LocalizedScan):
            scan, pose = one.placed.scan, one.truth
        else:
            scan, pose = one.scan, one.pose
        if scan.frame_id in mounts:
            pose = pose.compose(mounts[scan.frame_id].inverse())
        poses.setdefault(scan.stamp_ns, pose)
        yield one


def _recording(
    options: argparse.Namespace,
) -> tuple[Lidar | SonarRing, GridMap, Iterator[Any]]:
    """Return the sensor, the true map and the scans to come."""
    world = loaded(options)
    cell_m = options.resolution if isinstance(world, Building) else world.spec.resolution_m
    sensor = sensor_from(options, cell_m)
    rng = np.random.default_rng(options.seed)
    if isinstance(sensor, Lidar) and options.drive:
        return sensor, _truth(options, world), driven(options, world, sensor, rng)
    if isinstance(world, Building):
        truth = _truth(options, world)
        if isinstance(sensor, SonarRing):
            return sensor, truth, record_with_sonars(world, sensor, rng)
        return sensor, truth, record(world, sensor, rng)
    exploration = exploration_from(options, sensor.range_max_m, cell_m)
    depth = options.depth
    if isinstance(sensor, SonarRing):
        scans = record_exploration_with_sonars(world, sensor, exploration, rng, depth=depth)
        return sensor, _truth(options, world), scans
    make = record_localized if options.localize else record_exploration
    return sensor, _truth(options, world), make(world, sensor, exploration, rng, depth=depth)


def _truth(options: argparse.Namespace, world: Building | GridWorld) -> GridMap:
    return rasterised(world, options.resolution) if isinstance(world, Building) else world.truth()
