"""`demo [INPUT]`: the main job end to end, with the real nodes in processes of their own.

INPUT (a CARMEN log or a bag; a simulated building when none is named) -> `replay` -> DDS ->
`online_mapper` -> `~/save_map` -> DIR/map.pgm, map.yaml, map.png.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.cli.import_carmen import describe
from ogm_mcmc.cli.options import Subparsers, add_config_options, config_from, print_result
from ogm_mcmc.config import MapperConfig, given
from ogm_mcmc.errors import BagError, ConfigError, LogError, OgmError
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen
from ogm_mcmc.io.map_files import writable_folder
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.simulation import WORLDS, Lidar, record

__all__ = ['add_to']

NODE_START_S = 60.0  # compiling all kernels on a slow machine
SERVICE_S = 30.0
BAG_SUFFIXES = ('.bag', '.mcap', '.db3')


class DemoInput(NamedTuple):
    """A bag to replay and what the mapper has to be told about it."""

    bag: Path
    from_log: bool
    scan_topic: str
    pose_topic: str
    pose_source: str
    map_frame: str
    n_messages: int


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('demo', help='replay a log, bag or simulation into the mapper')
    parser.add_argument('input', nargs='?', type=Path, help='CARMEN log or bag')
    parser.add_argument(
        '-o', dest='folder', type=Path, default=Path('out/demo'), metavar='DIR', help='output'
    )
    parser.add_argument(
        '--rate', type=float, default=0.0, help='0: as fast as the mapper takes it'
    )
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_config_options(parser, 'mapping', MapperConfig)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    try:
        from ogm_mcmc.ros.demo_client import DemoClient
    except ImportError as error:
        raise ConfigError(
            f'the demo needs rclpy ({error}): pip install "ogm_mcmc[ros]", or source a ROS 2 setup'
        ) from error
    config_from(options, MapperConfig)  # wrong values are refused before anything starts
    folder = writable_folder(options.folder).absolute()
    with tempfile.TemporaryDirectory(prefix='ogm_mcmc-') as scratch:
        source = _prepare(options.input, folder, Path(scratch))
        namespace = f'/ogm_mcmc_demo_{os.getpid()}'
        environment = {
            **os.environ,
            # The demo stays on this machine and out of the way of other nodes on it.
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_LOG_DIR': os.environ.get('ROS_LOG_DIR', scratch),
        }
        os.environ.update(environment)
        with (
            DemoClient(namespace) as client,
            _process(
                'online_mapper', _mapper_arguments(options, source, folder, namespace)
            ) as node,
        ):
            client.wait_for_mapper(NODE_START_S, lambda: node.poll() is None)
            with _process('replay', _replay_arguments(options, source, namespace)) as player:
                client.spin_while(lambda: player.poll() is None and node.poll() is None)
                if player.returncode:
                    raise BagError(f'{source.bag}: replay ended with code {player.returncode}')
            if node.poll() is not None:
                raise OgmError(f'online_mapper ended during replay, code {node.returncode}')
            saved = client.save_map(SERVICE_S)
            client.wait_for_map(SERVICE_S)
            report = client.report()
    result = {'input': str(options.input or 'simulated office'), 'saved': saved, **report}
    print_result(options, result, _text(result))
    return 0


def _prepare(path: Path | None, folder: Path, scratch: Path) -> DemoInput:
    """Turn whatever was named into a bag, and look into it."""
    from_log = False
    if path is None:
        bag_path = folder / 'recording'
        count = write_recording(
            bag_path, record(WORLDS['office'](), Lidar(), np.random.default_rng(1)), overwrite=True
        )
        print(f'simulated office: {count} scans -> {bag_path}', file=sys.stderr)
    elif path.is_dir() or path.suffix in BAG_SUFFIXES:
        bag_path = path
    else:
        bag_path, from_log = folder / 'recording', True
        if not path.exists():
            raise LogError(f'{path}: no such file; expected a CARMEN log or a bag')
        print(
            describe(import_carmen(path, bag_path, ImportOptions(), overwrite=True)),
            file=sys.stderr,
        )
    with BagReader(bag_path) as bag:
        scan = bag.find('scans', (ros_types.SCAN,))
        try:
            pose, source = bag.find('poses', (ros_types.POSE,)), 'pose'
        except BagError:
            pose, source = bag.find('poses', (ros_types.POSE, ros_types.PARTICLES)), 'particles'
        first = next(bag.records((pose.name,)), None)
        if first is None:
            raise BagError(f'{bag_path}: no message on {pose.name}, although its index names some')
        frame = messages.frame_of(bag.decode(first))
    total = scan.n_messages + pose.n_messages
    return DemoInput(bag_path, from_log, scan.name, pose.name, source, frame, total)


def _mapper_arguments(
    options: argparse.Namespace, source: DemoInput, folder: Path, namespace: str
) -> list[str]:
    parameters = {
        'map_frame': source.map_frame,
        'pose_source': source.pose_source,
        'save_directory': str(folder),
        **given(options, MapperConfig),
    }
    if source.from_log and 'no_return' not in parameters:
        # Indoors most beams of a SICK without a return point at glass or dark walls.
        print('no return: ignored (--no-return clear to let it clear)', file=sys.stderr)
        parameters['no_return'] = 'ignore'
    arguments = ['-m', 'ogm_mcmc.ros.online_mapper', '--ros-args', '-r', f'__ns:={namespace}']
    if options.params_file is not None:
        arguments += ['--params-file', str(options.params_file)]
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ['-p', f'{name}:={text}']
    return arguments


def _replay_arguments(options: argparse.Namespace, source: DemoInput, namespace: str) -> list[str]:
    topics = f'{source.scan_topic},{source.pose_topic}'
    # The mapper's topic for poses is named like the source: `pose` or `particles`.
    remap = f'{source.scan_topic}=scan,{source.pose_topic}={source.pose_source}'
    return [
        *('-m', 'ogm_mcmc.ros.replay', str(source.bag), '--rate', str(options.rate)),
        *('--topics', topics, '--remap', remap, '--wait', '20', '--wait-topics', '2'),
        *('--progress', '--ros-args', '-r', f'__ns:={namespace}'),
    ]


@contextlib.contextmanager
def _process(name: str, arguments: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run a node in a process of its own; end it quietly, and complain if it does not."""
    process = subprocess.Popen([sys.executable, *arguments], stdout=sys.stderr)
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
            print(f'{name} did not stop on SIGINT and was killed', file=sys.stderr)


def _text(result: dict[str, object]) -> str:
    stem = str(result['saved']).removesuffix('.yaml')
    return (
        f'{result["scans_used"]} of {result["scans_received"]} scans mapped, '
        f'{result["dropped"]} dropped; map {result["width"]} x {result["height"]} cells; '
        f'first map after {result["first_map_s"]:.1f} s\n'
        f'{stem}.pgm|yaml|png'
    )
