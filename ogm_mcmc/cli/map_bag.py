"""`map BAG -o DIR`: the offline way to a map."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ogm_mcmc.cli.options import (
    Subparsers,
    add_config_options,
    add_json,
    add_stream_options,
    config_from,
    print_result,
    stream_choice,
)
from ogm_mcmc.config import MapperConfig, OutputConfig, PlacingConfig, flatten
from ogm_mcmc.engine.bag_scans import PlacedScans, choose_topics
from ogm_mcmc.files.output_files import checked_name, makeable_folder, replacing_set
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.map_files import save_npz, write_map
from ogm_mcmc.io.tree_files import save_tree
from ogm_mcmc.mapping import AdaptiveMapper, MappingMethod, RandomFieldMapper
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('map', help='map a bag: PGM, YAML, PNG and NPZ')
    parser.add_argument('bag', type=Path, help='ROS 1 bag or rosbag2 with scans and poses')
    parser.add_argument(
        '-o', dest='folder', type=Path, required=True, metavar='DIR', help='folder for the map'
    )
    parser.add_argument('--name', default='map', help='name of the files')
    # The PGM is trinary and the NPZ holds probabilities: nothing for `output` to choose.
    configs = (MapperConfig, OutputConfig, PlacingConfig)
    add_config_options(parser, 'mapping', *configs, without=('output',))
    add_stream_options(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    config, output = config_from(options, MapperConfig), config_from(options, OutputConfig)
    placing = config_from(options, PlacingConfig)
    pipeline = MappingPipeline(config)
    # What cannot be saved is better said before the work than after it.
    checked_name(options.name)
    makeable_folder(options.folder)
    started = time.perf_counter()
    with BagReader(options.bag) as bag:
        choice = stream_choice(options, placing, config)
        topics = choose_topics(bag, choice)
        with tqdm(total=topics.n_scans, unit=' scans', desc='map', disable=None) as bar:
            scans = PlacedScans(bag, topics, choice, on_scan=bar.update)
            for placed in scans:
                pipeline.update(placed)
    # A single sensor may well sit at mount.x, mount.y; several of them hardly do.
    frames = scans.frames
    mounted = {*placing.mount.named(), *scans.mounted_by_tf}
    unmounted = sorted(frames - mounted) if len(frames) > 1 else []
    settings = {**flatten(config), **flatten(output), **flatten(placing)}
    grid_map = pipeline.map()
    kinds = ('npz', 'json', 'png', 'pgm', 'yaml')
    paths = {kind: options.folder / f'{options.name}.{kind}' for kind in kinds}
    result: dict[str, Any] = {
        'bag': str(options.bag),
        'scan_topic': ','.join(topic.name for topic in topics.scans),
        'pose_topic': topics.pose.name,
        'scans': topics.n_scans,
        'scans_used': pipeline.scans_used,
        'dropped': dict(scans.placer.dropped),
        'frames_without_mount': unmounted,
        'mounts_from_tf': {
            frame: [mount.pose.x_m, mount.pose.y_m, mount.pose.yaw_rad, mount.upside_down]
            for frame, mount in scans.mounted_by_tf.items()
        },
        'width': grid_map.spec.width,
        'height': grid_map.spec.height,
        'origin': [grid_map.spec.origin_x_m, grid_map.spec.origin_y_m],
        'seconds': round(time.perf_counter() - started, 3),
        'files': {kind: str(path) for kind, path in paths.items() if kind != 'json'},
        'settings': settings,
    }
    if isinstance(pipeline.method, AdaptiveMapper):
        result['tree'] = pipeline.method.statistics()._asdict()
        paths['tree'] = options.folder / f'{options.name}_tree.npz'
        result['files']['tree'] = str(paths['tree'])
    _write(grid_map, output, settings, result, paths, pipeline.method)
    print_result(options, result, _text(result))
    return 0


def _write(
    grid_map: GridMap,
    output: OutputConfig,
    settings: dict[str, Any],
    result: dict[str, Any],
    paths: dict[str, Path],
    method: MappingMethod,
) -> None:
    """Write all files of a map; an old set is replaced as a whole."""
    folder, name = paths['yaml'].parent, paths['yaml'].stem
    of_another = () if 'tree' in paths else (f'{name}_tree.npz',)
    with replacing_set(folder, name, of_another) as scratch:
        write_map(grid_map, scratch, output, name)
        layers = {}
        if isinstance(method, RandomFieldMapper):
            layers['variance'] = method.variance(grid_map.spec.box)
        save_npz(grid_map, scratch / f'{name}.npz', settings, layers)
        if isinstance(method, AdaptiveMapper):
            save_tree(method, scratch / paths['tree'].name)
        (scratch / f'{name}.json').write_text(
            json.dumps(result, indent=2) + '\n', encoding='utf-8'
        )


def _text(result: dict[str, Any]) -> str:
    dropped = ', '.join(f'{count} {reason}' for reason, count in result['dropped'].items())
    side_x = result['width'] * result['settings']['resolution']
    side_y = result['height'] * result['settings']['resolution']
    return (
        f'{result["scans_used"]} of {result["scans"]} scans -> {result["files"]["yaml"]}: '
        f'{result["width"]} x {result["height"]} cells ({side_x:.1f} m x {side_y:.1f} m) '
        f'in {result["seconds"]:.2f} s'
        + (f'; dropped: {dropped}' if dropped else '')
        + _unmounted_text(result['frames_without_mount'])
        + _mounts_text(result['mounts_from_tf'])
        + (_tree_text(result['tree']) if 'tree' in result else '')
    )


def _unmounted_text(frames: list[str]) -> str:
    if not frames:
        return ''
    named = ', '.join(frames[:3]) + (', ...' if len(frames) > 3 else '')
    return f'; without a mount of their own (--mount.frames), all at (mount.x, mount.y): {named}'


def _mounts_text(mounts: dict[str, list[Any]]) -> str:
    return ''.join(
        f'; {frame} sits at {x:.3f} {y:.3f} m, {yaw:.4f} rad'
        + (', upside down' if turned else '')
        + ' (from tf)'
        for frame, (x, y, yaw, turned) in mounts.items()
    )


def _tree_text(tree: dict[str, Any]) -> str:
    return (
        f'; {tree["leaves"]} leaves for {tree["measured_cells"]} cells, '
        f'{tree["n_bytes"] / 1e6:.2f} MB (a regular grid: {tree["regular_bytes"] / 1e6:.2f} MB)'
    )
