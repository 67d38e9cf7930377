"""`learn-prior IMAGE... -o FILE`: count the patches of maps ([patch] section III)."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ogm_mcmc.cli.options import Subparsers, add_json, add_max_cells, print_result
from ogm_mcmc.config import (
    LearningConfig,
    PatchTableConfig,
    add_arguments,
    build,
    given,
)
from ogm_mcmc.engine.prior_files import save_prior
from ogm_mcmc.engine.prior_learning import PUBLISHED, count_maps, patch_statistics
from ogm_mcmc.errors import OutputError, PriorError, require
from ogm_mcmc.files.output_files import folder_to_fill, makeable_folder, refuse_folder
from ogm_mcmc.io.training_maps import MapSource, TrainingMap, read_sources, read_training_map

__all__ = ['add_to']

SOURCES = 'SOURCES.csv'

MAP_FILES = ('.yaml', '.yml', '.pgm', '.png')


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('learn-prior', help='learn a patch prior from images of maps')
    parser.add_argument(
        'images', type=Path, nargs='+', metavar='IMAGE', help='map image, or its nav2 YAML'
    )
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE', help='NPZ')
    add_arguments(parser.add_argument_group('counting'), LearningConfig)
    add_arguments(parser.add_argument_group('table (for --held-out)'), PatchTableConfig)
    parser.add_argument(
        '--sources',
        type=Path,
        help=f'CSV with file, resolution_m, source, commit, licence (default: {SOURCES} beside '
        'an image)',
    )
    parser.add_argument(
        '--image-resolution',
        type=float,
        default=0.0,
        help='m per pixel where neither a YAML beside the image nor the sources say it',
    )
    parser.add_argument(
        '--least', type=int, default=1, help='drop 5 x 5 windows seen less often than this'
    )
    parser.add_argument(
        '--held-out',
        action='store_true',
        help='judge: predict each map with a prior learned from the others',
    )
    add_max_cells(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    config = build(LearningConfig, given(options, LearningConfig))
    table = build(PatchTableConfig, given(options, PatchTableConfig))
    require(options.least >= 1, 'least', options.least, 'expected 1 or more')
    require(
        options.image_resolution == 0.0 or 0.001 <= options.image_resolution <= 100.0,
        'image_resolution',
        options.image_resolution,
        'expected metres per pixel, 0.001 to 100',
    )
    refuse_folder(options.output)
    if any(options.output.resolve() == image.resolve() for image in _files_read(options)):
        raise OutputError(f'{options.output}: is a file to read; expected a new name')
    makeable_folder(options.output.parent)
    counted = count_maps(_training_maps(options), config)
    if options.held_out and len(counted.counts) < 2:
        raise PriorError('--held-out: expected at least two maps')
    prior = counted.prior(options.least)
    with folder_to_fill(options.output.parent):
        save_prior(prior, options.output)
    result: dict[str, Any] = {
        'file': str(options.output),
        'bytes': options.output.stat().st_size,
        'maps': [dataclasses.asdict(source) for source in counted.sources],
        'skipped': counted.skipped,
        'settings': prior.options,
        'dropped_windows': prior.counts.dropped,
        **patch_statistics(prior.counts),
    }
    if options.held_out:
        scores = counted.scores_left_out(table, options.least)
        bar = tqdm(scores, total=len(counted.counts), unit=' maps', desc='held-out', disable=None)
        result['held_out'] = {str(path): score for path, score in bar}
    print_result(options, result, _text(result))
    return 0


def _training_maps(options: argparse.Namespace) -> Iterator[tuple[Path, TrainingMap]]:
    """Read the maps one by one: what they take of memory goes with them."""
    with tqdm(options.images, unit=' maps', desc='learn-prior', disable=None) as images:
        for image in images:
            known = _sources(options, image)
            yield (
                image,
                read_training_map(image, known, options.image_resolution, options.max_cells),
            )


def _files_read(options: argparse.Namespace) -> list[Path]:
    """Return the maps, the files that may lie beside them, and the list of sources."""
    named = [*options.images, *([] if options.sources is None else [options.sources])]
    beside = [image.with_suffix(end) for image in options.images for end in MAP_FILES]
    return [*named, *beside, *(image.parent / SOURCES for image in options.images)]


def _sources(options: argparse.Namespace, image: Path) -> dict[str, MapSource]:
    """What is known about the maps: the list that was named, or the one beside the image."""
    if options.sources is not None:
        return read_sources(options.sources)
    beside = image.parent / SOURCES
    return read_sources(beside) if beside.is_file() else {}


LABELS = {
    'p_occupied': 'p(occupied)',
    'patches_seen': '3 x 3 patches seen, of 512',
    'patches_for_99.9_percent': '  that make up 99.9 %',
    'patch_free': '  all free',
    'patch_occupied': '  all occupied',
    'squares_seen': '5 x 5 patches seen, of 33 554 432',
    'squares_for_99.9_percent': '  that make up 99.9 %',
    'square_free': '  all free',
    'square_occupied': '  all occupied',
    'borders_seen': 'borders of 16 cells seen, of 65 536',
    'most_patches_per_border': '  most patches with one',
    'likeliest_patch': '  the likeliest patch, mean over borders',
    'likeliest_four': '  the four likeliest',
    'cell_borders_seen': 'borders of 8 cells seen, of 256',
    'cell_borders_undecided': '  around free and occupied cells',
}


def _text(result: dict[str, Any]) -> str:
    lines = [
        f'{len(result["maps"])} maps, {result["windows"]} windows of 5 x 5 cells of '
        f'{result["settings"]["resolution"]:g} m -> {result["file"]} ({result["bytes"]} bytes)'
    ]
    if result['skipped']:
        lines.append(f'left out, coarser: {", ".join(result["skipped"])}')
    if result['dropped_windows']:
        lines.append(f'dropped as too rare: {result["dropped_windows"]} windows')
    lines.append(f'{"":<42} {"here":>9} {"[patch]":>9}')
    lines += [
        f'{label:<42} {result[name]:>9.4g} {PUBLISHED[name]:>9.4g}'
        if isinstance(result[name], float)
        else f'{label:<42} {result[name]:>9} {PUBLISHED[name]:>9}'
        for name, label in LABELS.items()
    ]
    if 'held_out' in result:
        scores = result['held_out']
        lines.append('predicted from the other maps, -log p(patch | border), nats per window:')
        lines += [f'  {Path(name).name:<40} {score:>9.4f}' for name, score in scores.items()]
        lines.append(f'  {"mean":<40} {sum(scores.values()) / len(scores):>9.4f}')
    return '\n'.join(lines)
