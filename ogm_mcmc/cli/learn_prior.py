"""`learn-prior IMAGE... -o FILE`: count the patches of maps ([patch] section III)."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ogm_mcmc.arrays import Int8Array
from ogm_mcmc.cli.options import Subparsers, add_json, add_max_cells, print_result
from ogm_mcmc.config import (
    LearningConfig,
    PatchTableConfig,
    add_arguments,
    build,
    flatten,
    given,
)
from ogm_mcmc.engine.prior_files import Prior, save_prior
from ogm_mcmc.errors import OutputError, PriorError, require
from ogm_mcmc.files.output_files import makeable_folder, refuse_folder, writable_folder
from ogm_mcmc.io.training_maps import MapSource, TrainingMap, read_sources, read_training_map
from ogm_mcmc.sampling.patch_learning import PatchCounts, count_map, rescaled, total_of
from ogm_mcmc.sampling.patch_prior import make_table, nats_per_window
from ogm_mcmc.sampling.patch_statistics import PUBLISHED, patch_statistics

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
    counted, sources, skipped = _counted(options, config)
    if options.held_out and len(counted) < 2:
        raise PriorError('--held-out: expected at least two maps')
    counts = total_of(counted.values()).without_rare(options.least)
    require(
        counts.squares.patterns.size > 0,
        'least',
        options.least,
        'no 5 x 5 window was seen so often',
    )
    settings = {**flatten(config), 'least': options.least}
    writable_folder(options.output.parent)
    save_prior(Prior(counts, settings, tuple(sources)), options.output)
    result: dict[str, Any] = {
        'file': str(options.output),
        'bytes': options.output.stat().st_size,
        'maps': [dataclasses.asdict(source) for source in sources],
        'skipped': skipped,
        'settings': settings,
        'dropped_windows': counts.dropped,
        **patch_statistics(counts),
    }
    if options.held_out:
        result['held_out'] = _held_out(counted, table, options.least)
    print_result(options, result, _text(result))
    return 0


def _counted(
    options: argparse.Namespace, config: LearningConfig
) -> tuple[dict[Path, PatchCounts], list[MapSource], list[str]]:
    """Counts of each map, where the maps come from, and which ones were left out."""
    counted: dict[Path, PatchCounts] = {}
    sources: list[MapSource] = []
    skipped = []
    with tqdm(options.images, unit=' maps', desc='learn-prior', disable=None) as images:
        for image in images:
            training = read_training_map(
                image, _sources(options, image), options.image_resolution, options.max_cells
            )
            if config.coarser == 'skip' and _coarser(training, config):
                skipped.append(str(image))
                continue
            if image in counted:
                raise PriorError(f'{image}: given twice: expected each map once')
            try:
                counted[image] = count_map(_at_resolution(training, config), config)
            except PriorError as error:
                raise PriorError(f'{image}: {error}') from error
            sources.append(training.source)
    if not counted:
        raise PriorError(f'all maps are coarser than {config.resolution:g} m: expected finer ones')
    return counted, sources, skipped


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


def _coarser(training: TrainingMap, config: LearningConfig) -> bool:
    return training.resolution_m > config.resolution * (1.0 + 1e-6)


def _at_resolution(training: TrainingMap, config: LearningConfig) -> Int8Array:
    if config.coarser == 'as_is' and _coarser(training, config):
        return training.states
    return rescaled(training.states, training.resolution_m, config.resolution)


def _held_out(
    counted: dict[Path, PatchCounts], config: PatchTableConfig, least: int
) -> dict[str, float]:
    """-log p(patch | border) of each map's 3 x 3 patches under what the others say, nats."""
    scores = {}
    for path, counts in tqdm(counted.items(), unit=' maps', desc='held-out', disable=None):
        others = total_of(each for other, each in counted.items() if other != path)
        table = make_table('border', 9, others.without_rare(least), config)
        scores[str(path)] = nats_per_window(table, counts)
    return scores


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
