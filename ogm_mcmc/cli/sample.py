"""`sample BAG -o DIR`: the full posterior of a bag's scans, for as long as one likes."""

from __future__ import annotations

import argparse
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.cli.bag_scans import BagScans, read_bag, record
from ogm_mcmc.cli.kept_state import KeptState
from ogm_mcmc.cli.option_ranges import Range, check_options
from ogm_mcmc.cli.options import (
    Subparsers,
    add_config_options,
    add_json,
    add_max_cells,
    add_scheduler,
    add_stream_options,
    config_from,
    print_result,
)
from ogm_mcmc.cli.sample_answer import answer_text, sampling_figures
from ogm_mcmc.cli.sample_files import SampledMaps, check_room, write_all
from ogm_mcmc.cli.sampling_bar import refine_poses, sample
from ogm_mcmc.config import (
    OutputConfig,
    PlacingConfig,
    PosesConfig,
    RecordingConfig,
    SamplerConfig,
    ShownConfig,
    StopConfig,
    TrajectoryConfig,
    check_limits,
    flatten,
    settings_of,
)
from ogm_mcmc.config.nodes import REFINE_CONFIGS, RefineSamplerConfig
from ogm_mcmc.engine.joint_poses import PoseRefinement, choose_joint
from ogm_mcmc.engine.odometry import said_odometry
from ogm_mcmc.engine.pose_choice import is_called_odom
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.tiled_refinement import TiledRefinement
from ogm_mcmc.engine.warm_up import warm_up_sampling
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.output_files import checked_name, makeable_folder
from ogm_mcmc.files.saying import said_if_slow, said_if_stopped, say
from ogm_mcmc.files.signals import interruptible
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan
from ogm_mcmc.io.map_files import load_grid
from ogm_mcmc.lab.cluster import DistantSampler, distribute
from ogm_mcmc.lab.tile_cluster import ClusterTiles
from ogm_mcmc.lab.workers import Workers, connected

__all__ = ['add_to']

# The same classes, and so the same defaults, as in `refine_server`.
CONFIGS = (
    RefineSamplerConfig,
    StopConfig,
    RecordingConfig,
    OutputConfig,
    ShownConfig,
    PosesConfig,
    PlacingConfig,
)

RANGES = {'samples': Range(0), 'thin': Range(1)}

# While it samples Ctrl-C means enough. Before, there is nothing to be had.
TOO_SOON = 'stopped before the first sweep: nothing was sampled, and nothing is written'
TWICE = 'stopped twice: the map is not written'

# A dotted name goes by its last part too, but where that says too little or something else.
SHORT = {
    leaf.name: f'--{leaf.name.rpartition(".")[2].replace("_", "-")}'
    for leaf in settings_of(RefineSamplerConfig)
    if not leaf.name.startswith('patch.')
} | {
    'model.kind': '--model',
    'chain.prior': '--cell-prior',
    'patch.prior': '--prior',
    'patch.size': '--patch-size',
    'patch.prior_file': '--prior-file',
    'unknown_margin': '--margin',
}


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'sample',
        help='sample maps from the full posterior: their mean, entropy, samples',
        description='Sample maps from the full posterior. The NPZ has layers: probability, where '
        'data moved it, nan elsewhere: of the maps drawn, and of what cells reflected; '
        'probability_everywhere, the same of every cell that a ray came to; '
        'posterior_mean, the mean of the maps drawn alone, of these cells; '
        'mcse, the standard error of that by chance; r_hat, by which chains agree (1: they do); '
        'ess, effective samples.',
    )
    parser.add_argument('bag', type=Path, help='ROS 1 bag or rosbag2 with scans and poses')
    parser.add_argument(
        '-o', dest='folder', type=Path, required=True, metavar='DIR', help='folder for the map'
    )
    parser.add_argument('--name', default='map', help='name of the files')
    parser.add_argument(
        '--samples',
        type=int,
        default=0,
        metavar='N',
        help='also write N maps drawn from the posterior',
    )
    parser.add_argument(
        '--thin',
        type=int,
        metavar='T',
        help='sweeps between drawn maps of a chain (default: 10)',
    )
    parser.add_argument(
        '--state',
        type=Path,
        metavar='FILE',
        help='continue from this state file if it exists, and save the state to it',
    )
    parser.add_argument(
        '--start-map', type=Path, metavar='FILE', help='first map of all chains (.yaml, .npz)'
    )
    add_config_options(parser, 'sampling', *CONFIGS, without=('output',), short=SHORT)
    add_stream_options(parser)
    add_max_cells(parser)
    add_scheduler(parser)
    parser.add_argument(
        '--tiles',
        metavar='NxM',
        help='cut the map into N x M tiles, each held by one worker of --scheduler with the rays '
        'that cross it: for windows that do not fit on one machine',
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    check_options(options, RANGES)
    chosen = _chosen(options)
    _refuse_unused(options, chosen)
    shape = _tiles(options)
    # What cannot be saved is better said before the work than after it.
    checked_name(options.name)
    makeable_folder(options.folder)
    if options.state is not None:
        KeptState.checked(options.state)
    else:  # chains that go on may have their burn-in behind them
        check_limits(chosen.sampler.chain, chosen.stop)
    start = None
    if options.start_map is not None:
        start = _on_lattice(load_grid(options.start_map, options.max_cells))
    with connected(options.scheduler) as executor:
        return _run(options, chosen, start, executor, shape)


def _run(
    options: argparse.Namespace,
    chosen: _Chosen,
    start: GridMap | None,
    executor: Workers | None,
    shape: tuple[int, int] | None,
) -> int:
    with said_if_stopped(TOO_SOON):
        work = _prepare(options, chosen, start, executor, shape)
    refinement, state = work.refinement, work.state
    with said_if_stopped(TWICE), interruptible() as interrupted:
        try:
            progress = sample(refinement, chosen.stop, interrupted, state.round_done)
            maps = _draw(refinement, options, interrupted)
        except Exception:
            # Between rounds chains on other machines stand here, whatever became of those.
            if executor is not None:
                state.rescue()
            raise
    result = {
        'bag': str(options.bag),
        **work.bag.topics.as_dict(),
        'dropped': work.bag.dropped,
        **sampling_figures(refinement, progress, chosen.stop, work.resumed, work.recording),
        'seconds': round(time.perf_counter() - work.started, 3),
        'settings': _settings(options, chosen),
    }
    failed = state.attempt()
    if options.state is not None and failed is None:
        result['state'] = str(options.state)
    if options.samples:
        result['maps_drawn'] = len(maps)
    if len(maps) < options.samples:
        say(f'{len(maps)} of {options.samples} maps drawn for --samples: interrupted')
    if work.tiles is not None and isinstance(refinement, TiledRefinement):
        result['tiles'] = {'groups': refinement.tiled.summaries.groups, **work.tiles.figures()}
    if work.distant is not None:
        result['cluster'] = work.distant.figures()
    if work.poses is not None:
        result['trajectory'] = work.poses.figures()
    trajectory = None if work.poses is None else work.poses.trajectory()
    margin = chosen.shown.unknown_margin
    sampled = SampledMaps(refinement, maps, margin, options.thin, trajectory)
    result['files'] = write_all(sampled, chosen.output, result, options.folder, options.name)
    beams = refinement.beams
    sensor = '' if beams.sensor is None else f'sensor, 95 %: {beams.sensor}'
    lines = filter(None, (answer_text(result), sensor, str(beams.no_return)))
    print_result(options, result, '\n'.join(lines))
    return 0 if failed is None else 1


class _Work(NamedTuple):
    """What is sampled, and with what; `started` on the clock of `time.perf_counter`."""

    bag: BagScans
    recording: Recording
    poses: PoseRefinement | None
    refinement: Refinement
    tiles: ClusterTiles | None
    distant: DistantSampler | None
    state: KeptState
    resumed: int
    started: float


def _prepare(
    options: argparse.Namespace,
    chosen: _Chosen,
    start: GridMap | None,
    executor: Workers | None,
    shape: tuple[int, int] | None,
) -> _Work:
    """Read the bag, estimate the poses if asked to, and find the rays of every cell."""
    started = time.perf_counter()
    joint, settings = chosen.poses.joint, chosen.poses.trajectory
    bag = read_bag(options, chosen.placing, beliefs=joint, odometry=joint and settings.odometry)
    read = time.perf_counter()
    with said_if_slow('loading or compiling the kernels of the sampler (kept for the next time)'):
        warm_up_sampling(chosen.sampler)
    started += time.perf_counter() - read  # compiling is no part of the work
    recording = Recording(chosen.recording, chosen.sampler, bounded=False)
    record(bag, recording)
    check_room(options.samples, recording.size.box.n_cells)
    tiles = None if shape is None or executor is None else ClusterTiles(executor)
    refinement = Refinement(chosen.sampler)
    if tiles is not None and shape is not None:
        refinement = TiledRefinement(chosen.sampler, *shape, tiles)
    scans = recording.snapshot()
    poses: PoseRefinement | None = None
    drifting = bag.topics.trajectory is None and is_called_odom(bag.topics.map_frame)
    cell_m = chosen.sampler.window.resolution
    choice = choose_joint(scans, chosen.poses, cell_m, drifting=drifting)
    if choice.why:
        say(choice.why)
    elif drifting and not choice.joint:
        say('poses are those of odometry, which drifts: --poses joint estimates them')
    if choice.joint:
        poses = _joint_poses(scans, settings, bag, drifting)
        poses = _that_hold(poses, chosen.poses)
        scans = scans if poses is None else poses.placed()
    refinement.take(scans, start)
    state = KeptState(refinement, options.state)
    resumed = state.resume()
    distant = None
    if executor is not None and tiles is None:
        distant = distribute(refinement, scans, executor)
    return _Work(bag, recording, poses, refinement, tiles, distant, state, resumed, started)


def _joint_poses(
    scans: list[PlacedScan], settings: TrajectoryConfig, bag: BagScans, drifting: bool
) -> PoseRefinement | None:
    """Estimate poses; None where that was ended before they were better than those given."""
    poses = PoseRefinement(scans, settings, bag.odometry, drifting=drifting)
    with interruptible() as interrupted:
        refine_poses(poses, interrupted)
    if interrupted.is_set():
        found = 'joint ones, as far as they are' if poses.usable else 'those given'
        say(f'poses ended: maps are sampled at {found}; Ctrl-C ends that, too, and saves the map')
        if not poses.usable:
            return None
    if settings.odometry:
        used = poses.wheels
        say(
            said_odometry(bag.odometry_name or 'the robot', used, len(scans), poses.odometry_scale)
        )
    if times := poses.said_beam_times():
        say(times)
    return poses


def _that_hold(poses: PoseRefinement | None, asked: PosesConfig) -> PoseRefinement | None:
    """Return poses as they are, None where `auto` is not to use them; warn where they are torn."""
    if poses is None or not (torn := poses.said_torn()):
        return poses
    kept = asked.poses == 'auto'
    say(f'{torn}: ' + ('poses stay as given' if kept else 'a SLAM system may know better'))
    return None if kept else poses


class _Chosen(NamedTuple):
    """All configs of the command."""

    sampler: SamplerConfig
    stop: StopConfig
    recording: RecordingConfig
    output: OutputConfig
    shown: ShownConfig
    placing: PlacingConfig
    poses: PosesConfig


def _chosen(options: argparse.Namespace) -> _Chosen:
    # The YAML of refine_server may name what belongs to its rim: of no use here, but no mistake.
    read = partial(config_from, options, node='refine_server', node_configs=REFINE_CONFIGS)
    return _Chosen(
        read(RefineSamplerConfig),
        read(StopConfig),
        read(RecordingConfig),
        read(OutputConfig),
        read(ShownConfig),
        read(PlacingConfig),
        read(PosesConfig),
    )


def _refuse_unused(options: argparse.Namespace, chosen: _Chosen) -> None:
    """Refuse options that change nothing; fill in a default."""
    if options.thin is not None and options.samples == 0:
        raise ConfigError('--thin: expected with --samples')
    if options.thin is None:
        options.thin = 10
    if getattr(options, 'patch.prior_file') and chosen.sampler.patch.prior == 'uniform':
        raise ConfigError('--prior-file: expected with --prior patch or border, not uniform')


def _tiles(options: argparse.Namespace) -> tuple[int, int] | None:
    """Return the columns and rows of --tiles."""
    if options.tiles is None:
        return None
    if not options.scheduler:
        raise ConfigError('--tiles: expected with --scheduler, whose workers hold them')
    columns, _, rows = options.tiles.partition('x')
    if not (columns.isdecimal() and rows.isdecimal() and int(columns) > 0 and int(rows) > 0):
        raise ConfigError(f'--tiles {options.tiles}: expected columns x rows, such as 2x2')
    return int(columns), int(rows)


def _settings(options: argparse.Namespace, chosen: _Chosen) -> dict[str, Any]:
    return {
        **{name: value for config in chosen for name, value in flatten(config).items()},
        'thin': options.thin,
        'start_map': None if options.start_map is None else str(options.start_map),
    }


def _on_lattice(grid_map: GridMap) -> GridMap:
    """Name the cells of a map file as the window does, if they lie where its cells do."""
    spec = grid_map.spec
    column, row = spec.origin_x_m / spec.resolution_m, spec.origin_y_m / spec.resolution_m
    if max(abs(column - round(column)), abs(row - round(row))) > 1e-3:
        return grid_map  # refused, with its origin, by whoever takes it
    there = GridSpec(spec.resolution_m, spec.width, spec.height, round(column), round(row))
    return GridMap(there, grid_map.probability)


def _draw(
    refinement: Refinement, options: argparse.Namespace, interrupted: threading.Event
) -> list[UInt8Array]:
    """Draw the whole maps that were asked for; fewer after Ctrl-C."""
    assert refinement.sampler is not None
    maps: list[UInt8Array] = []
    if options.samples == 0 or interrupted.is_set():
        return maps
    with tqdm(total=options.samples, desc='draw', unit=' maps', disable=None) as bar:
        for cells in refinement.sampler.draw_maps(options.samples, options.thin):
            maps.append(np.packbits(cells))
            bar.update()
            if interrupted.is_set():
                break
    return maps
