"""`map BAG -o DIR`: the offline way to a map."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.cli.bag_scans import placed_scans
from ogm_mcmc.cli.options import (
    Subparsers,
    add_config_options,
    add_json,
    add_stream_options,
    config_from,
    print_result,
)
from ogm_mcmc.config import OutputConfig, PlacingConfig, flatten
from ogm_mcmc.config.nodes import NodeMapperConfig
from ogm_mcmc.engine.recorded_map import check_mapping, map_recording, predicted_at
from ogm_mcmc.engine.saved_map import MapToSave, replacing_map
from ogm_mcmc.files.output_files import checked_name, makeable_folder
from ogm_mcmc.io.map_files import points_file, save_npz, table_file
from ogm_mcmc.io.point_files import read_points, write_prediction

__all__ = ['add_to']

# Of the field at a point that no observation reaches.
PRIOR_VARIANCE = 1.0


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('map', help='map a bag: PGM, YAML, PNG and NPZ')
    parser.add_argument('bag', type=Path, help='ROS 1 bag or rosbag2 with scans and poses')
    parser.add_argument(
        '-o', dest='folder', type=Path, required=True, metavar='DIR', help='folder for the map'
    )
    parser.add_argument('--name', default='map', help='name of the files')
    # The PGM is trinary and the NPZ holds probabilities: nothing for `output` to choose.
    configs = (NodeMapperConfig, OutputConfig, PlacingConfig)
    add_config_options(parser, 'mapping', *configs, without=('output',))
    parser.add_argument(
        '--points', type=Path, metavar='FILE',
        help='CSV of points x,y in m: NAME_points.csv tells log-odds, variance and probability '
        'there (method random_field)',
    )  # fmt: skip
    add_stream_options(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    config, output = config_from(options, NodeMapperConfig), config_from(options, OutputConfig)
    placing = config_from(options, PlacingConfig)
    check_mapping(config, at_points=options.points is not None)
    points = None if options.points is None else read_points(options.points)
    # What cannot be saved is better said before the work than after it.
    checked_name(options.name)
    makeable_folder(options.folder)
    started = time.perf_counter()
    with placed_scans(options, placing, config, title='map') as scans:
        pipeline, no_return, off_map = map_recording(config, scans)
    topics = scans.topics
    # A single sensor may well sit at mount.x, mount.y; several of them hardly do.
    sure = {f for f, m in scans.mounts.items() if m.origin.startswith('tf')}
    sure |= {topics.base_frame, *placing.mount.named()}
    unmounted = sorted(scans.frames - sure) if len(scans.frames) > 1 else []
    settings = {**flatten(pipeline.config), **flatten(output), **flatten(placing)}
    saved = MapToSave(pipeline)
    spec = saved.grid_map.spec
    files = {kind: f'{options.name}.{kind}' for kind in ('npz', 'png', 'pgm', 'yaml')} | {
        table: table_file(options.name, table) for table in saved.extras.tables
    }
    if points is not None:
        files['points'] = points_file(options.name)
        told = predicted_at(pipeline, points)
    result: dict[str, Any] = {
        'bag': str(options.bag),
        **topics.as_dict(),
        'scans_used': pipeline.scans_used,
        'dropped': dict(scans.placer.dropped),
        **({'refused': off_map} if off_map else {}),
        'no_return': no_return.as_dict(),
        'frames_without_mount': unmounted,
        'mounts': {frame: str(found) for frame, found in scans.mounts.items()},
        'width': spec.width,
        'height': spec.height,
        'origin': [spec.origin_x_m, spec.origin_y_m],
        **({} if points is None else _of_points(told.variance)),
        'seconds': round(time.perf_counter() - started, 3),
        'files': {kind: str(options.folder / file) for kind, file in files.items()},
        'settings': settings,
        **saved.extras.statistics,
    }
    with replacing_map(saved, options.folder, options.name, output) as scratch:
        save_npz(saved.grid_map, scratch / files['npz'], settings, saved.extras.layers)
        if points is not None:
            write_prediction(scratch / files['points'], points, *told)
        text = json.dumps(result, indent=2) + '\n'
        (scratch / f'{options.name}.json').write_text(text, encoding='utf-8')
    said = saved.extras.summary
    text = _text(result) + (f'; {said}' if said else '')
    if result.get('points_of_prior'):
        text += (
            f'\n{result["points_of_prior"]} of {result["points"]} points lie far from what was '
            'measured: they have the prior'
        )
    if str(no_return):
        text += f'\n{no_return}'
    print_result(options, result, text)
    return 0


def _of_points(variance: Float64Array) -> dict[str, int]:
    """Return how many points were asked about, and of how many nothing is known."""
    return {'points': variance.size, 'points_of_prior': int((variance >= PRIOR_VARIANCE).sum())}


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
    )


def _unmounted_text(frames: list[str]) -> str:
    if not frames:
        return ''
    named = ', '.join(frames[:3]) + (', ...' if len(frames) > 3 else '')
    return f'; without a mount of their own (--mount.frames), all at (mount.x, mount.y): {named}'
