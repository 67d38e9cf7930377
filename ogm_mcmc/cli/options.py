"""Options that several commands share."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from ogm_mcmc.config import (
    MapperConfig,
    PlacingConfig,
    add_arguments,
    build,
    given,
    settings_of,
)
from ogm_mcmc.config.nodes import NODE_CONFIGS
from ogm_mcmc.config.pose_sources import OFFLINE_POSE_SOURCES, POSE_SOURCES_TEXT
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.errors import ConfigError, OgmError, OutputError
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.io.map_images import MOST_CELLS
from ogm_mcmc.io.parameter_files import read_parameter_file

__all__ = [
    'Subparsers',
    'add_config_options',
    'add_json',
    'add_max_cells',
    'add_scheduler',
    'add_stream_options',
    'config_from',
    'drop_output',
    'path_argument',
    'print_result',
    'require_matplotlib',
    'stream_choice',
]

T = TypeVar('T')

# Others take the mean of a pose for the pose.
BELIEF_METHODS = ('pose_uncertain', 'adaptive')
Subparsers = Any  # argparse gives its sub-parser action no public name


def path_argument(text: str) -> Path:
    """Return the path of an option; argparse names the option where it is none."""
    try:
        return user_path(text)
    except OgmError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def add_max_cells(parser: argparse.ArgumentParser) -> None:
    """Declare --max-cells, of commands that read maps."""
    parser.add_argument(
        '--max-cells',
        type=_count,
        default=MOST_CELLS,
        metavar='N',
        help=f'larger maps and images are refused before they take memory; default {MOST_CELLS}',
    )


def _count(text: str) -> int:
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 16 else 0
    if number < 1:
        raise argparse.ArgumentTypeError(f'{text!r}: expected a whole number, 1 or more')
    return number


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare --json."""
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def add_scheduler(parser: argparse.ArgumentParser, remark: str = '') -> None:
    """Declare --scheduler."""
    parser.add_argument(
        '--scheduler',
        default='',
        metavar='ADDRESS',
        help='work on a Dask cluster (tcp://host:8786) instead of local processes; needs the '
        f'extra "cluster"{remark}. Name a scheduler you trust: whoever runs it, or can reach '
        'it, can run code here; with TLS (tls://host:8786 and certificates in the settings of '
        'Dask) only who holds a certificate can',
    )


def require_matplotlib() -> None:
    """Raise ConfigError where matplotlib is not installed; call it before long work."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise ConfigError(
            f'curves need matplotlib ({error}): pip install "ogm_mcmc[plots]"'
        ) from error


def print_result(options: argparse.Namespace, values: dict[str, Any], text: str) -> None:
    """Print for machines or for people. Raises OutputError where that is not possible."""
    try:
        print(json.dumps(values) if options.json else text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        drop_output()
        raise OutputError(f'standard output: cannot be written ({error.strerror})') from error


def drop_output() -> None:
    """Have whatever is left to print forgotten, also at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def add_config_options(
    parser: argparse.ArgumentParser,
    title: str,
    *configs: type,
    without: tuple[str, ...] = (),
    short: Mapping[str, str] | None = None,
) -> None:
    """Declare the settings of config classes, and --params-file for all of them."""
    group = parser.add_argument_group(title)
    for config in configs:
        add_arguments(group, config, without, short)
    group.add_argument('--params-file', type=Path, help='ROS parameter file (YAML)')


def config_from(
    options: argparse.Namespace,
    config: type[T],
    node: str = 'online_mapper',
    node_configs: tuple[type, ...] = NODE_CONFIGS,
) -> T:
    """Build a config: defaults, then the parameter file, then the command line.

    The file is that of a node, whose parameters `node_configs` declares.
    """
    values: dict[str, Any] = {}
    named = given(options, config)
    if options.params_file is not None:
        # The file is the node's: what is no setting of this config belongs to the rest of it.
        known = {leaf.name for leaf in settings_of(config)}
        held = read_parameter_file(options.params_file, node)
        _refuse_unknown(options.params_file, held, node_configs)
        values.update({name: value for name, value in held.items() if name in known})
    try:
        return build(config, {**values, **named})
    except ConfigError as error:
        name = str(error).partition(' is ')[0]
        if name in values and name not in named:
            raise ConfigError(f'{options.params_file}: {error}') from error
        raise


def _refuse_unknown(path: Path, held: dict[str, Any], configs: tuple[type, ...]) -> None:
    every = {leaf.name for config in configs for leaf in settings_of(config)}
    unknown = sorted(set(held) - every - {'use_sim_time'})
    if unknown:
        raise ConfigError(
            f'{path}: unknown parameter {unknown[0]!r}: expected one of {", ".join(sorted(every))}'
        )


def add_stream_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that choose scans and poses of a bag."""
    group = parser.add_argument_group('what to read')
    group.add_argument(
        '--scan-topic',
        default='',
        help='one or several, named with commas; default: every laser of one robot that is known '
        'to sit on it; with --method sonar every Range',
    )
    group.add_argument('--pose-topic', default='', help='default: what covers the scans best')
    group.add_argument(
        '--pose-source',
        choices=OFFLINE_POSE_SOURCES,
        default='auto',
        help=f'auto (default): what covers the scans best; {POSE_SOURCES_TEXT}',
    )
    group.add_argument(
        '--trajectory',
        type=path_argument,
        metavar='FILE',
        help='poses of a file in place of the bag: TUM, EuRoC, KITTI, g2o, CSV of `simulate`. '
        f'{" and ".join(BELIEF_METHODS)} average over its standard deviations, if these are in '
        'NAME_deviations.csv beside it',
    )
    group.add_argument(
        '--trajectory-stamps',
        type=path_argument,
        metavar='FILE',
        help='stamps of a KITTI file (one a line) or of a g2o file (id and stamp a line), s',
    )
    group.add_argument(
        '--trajectory-frame',
        default='',
        metavar='FRAME',
        help='whose poses the file holds, where it is not the base (the laser, for instance)',
    )
    group.add_argument('--map-frame', default='', metavar='FRAME', help='of tf; default: map')
    group.add_argument(
        '--base-frame', default='', metavar='FRAME', help='of tf; default: base_link'
    )


def stream_choice(
    options: argparse.Namespace, placing: PlacingConfig, config: MapperConfig
) -> StreamChoice:
    """Build the StreamChoice of a command. Raises ConfigError for options that contradict."""
    if options.trajectory is None and (options.trajectory_stamps or options.trajectory_frame):
        raise ConfigError('--trajectory-stamps, --trajectory-frame: expected with --trajectory')
    if options.trajectory is not None and (options.pose_topic or options.pose_source != 'auto'):
        raise ConfigError('--trajectory: expected without --pose-topic and --pose-source')
    return StreamChoice(
        options.scan_topic,
        options.pose_topic,
        options.pose_source,
        placing.max_pose_gap,
        'range' if config.method == 'sonar' else 'scan',
        placing.mount,
        placing.max_speed,
        placing.max_turn_rate,
        placing.deskew,
        placing.no_return_code,
        options.trajectory,
        options.trajectory_stamps,
        options.trajectory_frame,
        options.map_frame.lstrip('/'),  # as ROS 1 has them
        options.base_frame.lstrip('/'),
        beliefs=config.method in BELIEF_METHODS,
    )
