"""`demo [INPUT]`: the main job end to end, with the real nodes in processes of their own.

INPUT (a CARMEN log or a bag; a simulated building when none is named) -> `replay` -> DDS -+
                                                                                          |
`online_mapper` -> `~/save_map` -> DIR/map.pgm, map.yaml, map.png                       <-+
`refine_server` -> `~/refine` -> `~/save_map` -> DIR/map_refined.pgm, .yaml, .png       <-+
both side by side                             -> DIR/maps.png
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ogm_mcmc.cli.demo_input import DemoInput, prepare
from ogm_mcmc.cli.options import (
    BELIEF_METHODS,
    Subparsers,
    add_config_options,
    add_stream_options,
    config_from,
    print_result,
)
from ogm_mcmc.config import PlacingConfig, StopConfig, given
from ogm_mcmc.config.nodes import NodeMapperConfig
from ogm_mcmc.errors import BagError, ConfigError, OgmError
from ogm_mcmc.files.output_files import folder_to_fill
from ogm_mcmc.files.processes import ending_with_this
from ogm_mcmc.files.saying import say
from ogm_mcmc.io.map_sheet import save_side_by_side

__all__ = ['add_to']

NODE_START_S = 400.0  # compiling all kernels on a slow machine
SERVICE_S = 30.0
INDEXING_S = 60.0  # beside the time for sampling
PATIENT_S = 86_400.0  # longer than any demo; no node takes more

# Of fewer maps nothing is known: a machine that is slow or busy gets more time, so often at most.
LEAST_SWEEPS, MOST_ROUNDS = 16, 5

Show = Callable[[dict[str, str]], None]

# So many rays are swept often enough, by so many chains, in the time that a demo may take.
MOST_RAYS = 50_000
CHAINS, BURN_IN = 2, 10


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'demo', help='replay a log, bag or simulation into the nodes, then refine the map'
    )
    parser.add_argument('input', nargs='?', type=Path, help='CARMEN log or bag')
    parser.add_argument(
        '-o', dest='folder', type=Path, default=Path('out/demo'), metavar='DIR', help='output'
    )
    parser.add_argument('--rate', type=float, default=0.0, help='0: as fast as the nodes take it')
    parser.add_argument(
        '--sampling-time', type=float, default=10.0, metavar='S', help='time for ~/refine, s'
    )
    parser.add_argument(
        '--field-of-view',
        type=float,
        default=0.0,
        metavar='DEG',
        help='of a CARMEN log that names no angles; 0: by the number of readings',
    )
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_config_options(parser, 'mapping', NodeMapperConfig, PlacingConfig)
    add_stream_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    try:
        from ogm_mcmc.ros.demo_client import DemoClient
    except ImportError as error:
        raise ConfigError(
            f'the demo needs rclpy ({error}): pip install "ogm_mcmc[ros]", or source a ROS 2 setup'
        ) from error
    # Wrong values are refused before anything starts.
    if config_from(options, NodeMapperConfig).method == 'sonar':
        raise ConfigError(
            '--method sonar: expected one for LaserScan, which both maps are made of'
        )
    StopConfig(max_time=options.sampling_time)
    with (
        folder_to_fill(options.folder.absolute()) as folder,
        tempfile.TemporaryDirectory(prefix='ogm_mcmc-') as scratch,
    ):
        source = prepare(options.input, folder, options)
        os.environ.update(
            {
                # The demo stays on this machine and out of the way of other nodes on it.
                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                'ROS_LOG_DIR': os.environ.get('ROS_LOG_DIR', scratch),
            }
        )
        namespace = f'/ogm_mcmc_demo_{os.getpid()}'
        with DemoClient(namespace) as client:
            result = _map_and_refine(options, source, folder, client)
    result = {'input': str(options.input or 'simulated office'), **result}
    print_result(options, result, _text(result))
    return 0


def _map_and_refine(
    options: argparse.Namespace, source: DemoInput, folder: Path, client: Any
) -> dict[str, Any]:
    """Run the nodes; return what happened."""
    namespace = client.namespace
    mapper_arguments = _mapper_arguments(options, source, folder)
    refiner_arguments = _refiner_arguments(options, source, folder)
    with (
        _process('online_mapper', [*mapper_arguments, '-r', f'__ns:={namespace}']) as mapper,
        _process('refine_server', [*refiner_arguments, '-r', f'__ns:={namespace}']) as refiner,
    ):

        def alive() -> bool:
            return mapper.poll() is None and refiner.poll() is None

        client.wait_for_nodes(NODE_START_S, alive)
        with _process('replay', _replay_arguments(options, source, namespace)) as player:
            client.spin_while(lambda: player.poll() is None and alive())
            if player.returncode:
                raise BagError(f'{source.bag}: replay ended with code {player.returncode}')
        if not alive():
            name = 'refine_server' if mapper.poll() is None else 'online_mapper'
            raise OgmError(f'{name} ended during replay: expected it to go on')
        client.call('online_mapper/save_map', SERVICE_S)
        settled = client.settled()
        with _progress_bar(options.sampling_time) as show:
            refined = _refined(client, options.sampling_time + INDEXING_S, alive, show)
        client.wait_for_map(settled, SERVICE_S)
        client.call('refine_server/save_map', SERVICE_S)
        report = client.report()
    r_hat = float(refined['R-hat (99 % of cells below)'])
    figures: dict[str, Any] = {
        'sweeps': int(refined['sweeps']),
        'rays': int(refined['rays']),
        'beam_stride': _beam_stride(source),
        'r_hat': r_hat if math.isfinite(r_hat) else None,  # JSON knows no infinity
        'stopped_because': refined['stopped because'],
    }
    saved, saved_refined = (str(folder / f'{name}.yaml') for name in ('map', 'map_refined'))
    sheet = folder / 'maps.png'
    panels = [('live map (online_mapper)', saved), ('refined (refine_server)', saved_refined)]
    save_side_by_side(
        [(title, Path(path)) for title, path in panels], sheet, _caption(options, report, figures)
    )
    return {
        'saved': saved,
        **report,
        'refined': {'saved': saved_refined, **figures},
        'side_by_side': str(sheet),
    }


def _refined(
    client: Any, timeout_s: float, alive: Callable[[], bool], show: Show
) -> dict[str, str]:
    """Have the map refined until something is known; return the last diagnostics."""
    for _ in range(MOST_ROUNDS):
        report: dict[str, str] = client.refine(timeout_s, alive, show)
        if int(report['sweeps']) >= LEAST_SWEEPS:
            break
    return report


def _beam_stride(source: DemoInput) -> int:
    return max(1, -(-source.n_scans * source.beams // MOST_RAYS))


def _mapper_arguments(options: argparse.Namespace, source: DemoInput, folder: Path) -> list[str]:
    parameters = {**_common(options, source, folder), **given(options, NodeMapperConfig)}
    file = [] if options.params_file is None else ['--params-file', str(options.params_file)]
    return _node_arguments('online_mapper', parameters, file)


def _refiner_arguments(options: argparse.Namespace, source: DemoInput, folder: Path) -> list[str]:
    mapping = config_from(options, NodeMapperConfig)
    parameters = {
        **_common(options, source, folder),
        'window.resolution': mapping.resolution,
        'window.max_range': mapping.max_range,
        'window.no_return': mapping.no_return,
        'window.beam_stride': _beam_stride(source),
        'chain.chains': CHAINS,
        'chain.burn_in': BURN_IN,
        'max_scans': source.n_scans,
        'max_rays': source.n_scans * source.beams,
        'max_sweeps': 10**6,
        'max_time': float(options.sampling_time),
    }
    return _node_arguments('refine_server', parameters, [])


def _common(options: argparse.Namespace, source: DemoInput, folder: Path) -> dict[str, Any]:
    said = {
        'map_frame': source.map_frame,
        'base_frame': source.base_frame,
        'pose_source': source.pose_source,
        # What is left of tf is told as parameters, or on a topic of its own: tf is not sent.
        'mount_source': 'topic' if source.moving else 'parameters',
        'mount.frames': source.mounts,
        'save_directory': str(folder),
        # Scans come when both nodes have compiled, and no more of them while maps are refined:
        # who has none for a while misses nothing.
        'stale_after': PATIENT_S,
        **given(options, PlacingConfig),
    }
    return {name: value for name, value in said.items() if value != ''}


def _node_arguments(name: str, parameters: dict[str, Any], extra: list[str]) -> list[str]:
    arguments = ['-m', 'ogm_mcmc.ros', name, '--ros-args', *extra]
    for key, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ['-p', f'{key}:={text}']
    return arguments


def _replay_arguments(options: argparse.Namespace, source: DemoInput, namespace: str) -> list[str]:
    # The nodes' topic for poses is named like the source: `pose`, `odom`, ...
    names = dict.fromkeys(source.scan_topics, 'scan')
    if not source.computed:
        names[source.pose_topic] = source.pose_source
    remap = ','.join(f'{old}={new}' for old, new in names.items())
    return [
        *('-m', 'ogm_mcmc.ros', 'replay', str(source.bag), '--rate', str(options.rate)),
        *('--topics', ','.join(names), '--remap', remap, *_computed(options, source)),
        *('--wait', '20', '--wait-topics', str(len(source.scan_topics) + 1 + source.moving)),
        *('--wait-subscribers', '2', '--progress', '--ros-args', '-r', f'__ns:={namespace}'),
    ]


def _computed(options: argparse.Namespace, source: DemoInput) -> list[str]:
    """Return what tells `replay` of the poses to compute."""
    if not source.computed:
        return ['--pose-source', 'none']
    said = ['--scan-topic', ','.join(source.scan_topics)]
    if source.computed != 'trajectory':
        frames = ['--map-frame', source.map_frame, '--base-frame', source.base_frame]
        return [*said, '--pose-source', source.computed, *frames]
    said += ['--trajectory', str(options.trajectory)]
    if options.trajectory_stamps is not None:
        said += ['--trajectory-stamps', str(options.trajectory_stamps)]
    if config_from(options, NodeMapperConfig).method in BELIEF_METHODS:
        # They count once: the refined map takes poses as they come.
        said.append('--trajectory-deviations')
    return said


@contextlib.contextmanager
def _process(name: str, arguments: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run a node in a process of its own; end it quietly, and complain if it does not.

    Where this process is killed the node ends by itself.
    """
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=sys.stderr, env=ending_with_this()
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            say(f'{name} did not stop on SIGINT and was killed')


@contextlib.contextmanager
def _progress_bar(seconds: float) -> Iterator[Show]:
    """Yield a function that shows diagnostics of the refiner on a bar of so many seconds."""
    bar_format = '{desc}: {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s{postfix}'
    with tqdm(total=seconds, desc='refine', bar_format=bar_format, file=sys.stderr) as bar:

        def show(report: dict[str, str]) -> None:
            if report['state'] == 'indexing':
                bar.set_postfix_str('finding the rays of every cell')
            elif 'seconds' in report:
                bar.n = min(float(report['seconds']), seconds)
                bar.set_postfix_str(
                    f'{report["sweeps"]} sweeps, {report["sweeps per second"]}/s, '
                    f'R-hat {report["R-hat (99 % of cells below)"]}'
                )

        yield show


def _caption(options: argparse.Namespace, report: dict[str, Any], figures: dict[str, Any]) -> str:
    beams = 'all beams' if figures['beam_stride'] == 1 else f'1 of {figures["beam_stride"]} beams'
    agree = (
        'the chains do not agree everywhere yet'
        if figures['r_hat'] is None
        else f'99 % of the cells have R-hat at most {figures["r_hat"]:.2f}'
    )
    return (
        f'{options.input.name if options.input else "Simulated office"}: '
        f'{report["scans_used"]} scans. Left: the live map, every beam. Right: the posterior mean '
        f'of whole maps given all readings ({beams}, {figures["rays"]} rays), after '
        f'{figures["sweeps"]} sweeps of two chains; {agree}. '
        'White free, black occupied, blue-grey unknown.'
    )


def _text(result: dict[str, Any]) -> str:
    stem = str(result['saved']).removesuffix('.yaml')
    refined = result['refined']
    agree = '' if refined['r_hat'] is None else f'; R-hat {refined["r_hat"]:.3f}'
    stem_refined = str(refined['saved']).removesuffix('.yaml')
    return (
        f'{result["scans_used"]} of {result["scans_received"]} scans mapped, '
        f'{result["dropped"]} dropped; map {result["width"]} x {result["height"]} cells; '
        f'first map after {result["first_map_s"]:.1f} s\n'
        f'{refined["sweeps"]} sweeps over {refined["rays"]} rays{agree}\n'
        f'{stem}.pgm|yaml|png\n{stem_refined}.pgm|yaml|png\n{result["side_by_side"]}'
    )
