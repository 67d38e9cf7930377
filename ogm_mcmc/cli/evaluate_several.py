"""`evaluate NAME=MAP NAME=MAP ...`: several maps before the same judges, side by side."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.cli.evaluate_beams import (
    beam_figures,
    beam_settings,
    read_figures,
    read_held_out,
)
from ogm_mcmc.cli.evaluate_frames import alignment_of, frame_figures, frame_hint, frame_said
from ogm_mcmc.cli.evaluate_points import judged_points, point_figures, reliability_png
from ogm_mcmc.config import (
    EvaluationConfig,
    HeldOutConfig,
    HeldOutPointsConfig,
    PlacingConfig,
    SamplerConfig,
    flatten,
)
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.evaluation import ForwardModel, beam_log_likelihood, compare, held_out_points
from ogm_mcmc.evaluation.held_out import HeldOutBeams, cells_of_ends
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import GridSpec, Pose2D
from ogm_mcmc.io.map_files import JudgedMap, load_grid
from ogm_mcmc.plotting import Picture, kinds_png, probability_png

__all__ = [
    'MOST_IN_PAIRS',
    'Compared',
    'compared_by_beams',
    'compared_by_truth',
    'map_pictures',
    'named_maps',
]

# Every pair of so many maps has a line and a picture; more maps have a table, and pictures of the
# best one beside each of the others.
MOST_IN_PAIRS = 3

# Blocks on the longer side of a picture of who wins: single cells are hard to see.
BLOCKS = 120
# Of a difference: first by more than the step, by less, none, second by less, by more, no facts.
WINS = ((8, 81, 156), (158, 202, 225), (235, 235, 235), (253, 174, 107), (166, 54, 3))
NO_FACTS = (255, 255, 255)
STEP = 0.5  # nats


class Compared(NamedTuple):
    """What a judge says of several maps.

    `figures` and `columns` (header: text) by map, `common` what holds for all of them,
    `differences` between two, sections and settings as in `Answer`.
    """

    figures: dict[str, dict[str, Any]]
    columns: dict[str, dict[str, str]]
    common: dict[str, Any]
    differences: list[dict[str, Any]]
    sections: list[tuple[str, list[Picture]]]
    settings: dict[str, Any]


def named_maps(arguments: list[str]) -> dict[str, Path]:
    """Return maps by name: NAME=MAP, or MAP by the name of its file. Raises ConfigError."""
    maps: dict[str, Path] = {}
    for text in arguments:
        name, equals, file = text.partition('=')
        if not equals or os.path.exists(text):  # it knows what no path can be
            path = user_path(text, 'map', ConfigError)
            name = path.stem
        else:
            path = user_path(file, f'map {name}', ConfigError)
        if not name.strip():
            raise ConfigError(f'{text!r}: expected NAME=MAP or MAP')
        if name in maps:
            raise ConfigError(f'{text}: second map of name {name}: expected others, as NAME=MAP')
        maps[name] = path
    return maps


def map_pictures(maps: Mapping[str, JudgedMap]) -> list[Picture]:
    """Return every map as it is."""
    return [
        Picture(
            probability_png(one.probability),
            f'{name}: {one.spec.width} x {one.spec.height} cells of {one.spec.resolution_m:g} m',
        )
        for name, (one, _) in maps.items()
    ]


def compared_by_truth(
    maps: Mapping[str, JudgedMap], path: Path, config: EvaluationConfig, most_cells: int
) -> Compared:
    """Compare every map with the true one, and where on it one of two is nearer to it."""
    truth = load_grid(path, most_cells)
    of, figures, columns = {}, {}, {}
    for name, judged in maps.items():
        try:
            of[name] = compare(judged.known, truth, config, filled=judged.filled)
        except GridError as error:
            raise GridError(f'{name}: {error}') from error
        figures[name] = dict(of[name].figures)
        figures[name].pop('settings')
        columns[name] = {
            'divergence, nats': f'{figures[name]["divergence_nats"]:.6g}',
            'best F1': f'{figures[name]["best"]["f1"]:.4f}',
            'area under ROC': f'{figures[name]["roc_area"]:.4f}',
            'calibration error': f'{figures[name]["expected_calibration_error"]:.4f}',
            'Brier': f'{figures[name]["brier_score"]:.4f}',
        }

    def nearer(first: str, second: str) -> AnyArray:
        return np.where(
            of[first].counted & of[second].counted,
            np.asarray(of[second].divergence, np.float64) - of[first].divergence,
            np.nan,
        )

    differences = []
    for first, second in combinations(maps, 2):
        gap = nearer(first, second)
        differences.append(
            {'map': first, 'against': second, 'nearer': float(np.nansum(gap)), **_won(gap)}
        )
    pictures = [
        _wins(nearer(*pair), *pair, 'divergence of a cell')
        for pair in _drawn({name: -one['divergence_nats'] for name, one in figures.items()})
    ]
    curves = Picture(
        reliability_png({name: one.reliability for name, one in of.items()}),
        'Reliability of cells against the truth',
    )
    sections = [
        ('The truth', [Picture(probability_png(truth.probability), str(path)), curves]),
        ('Where one is nearer to the truth', pictures),
    ]
    return Compared(figures, columns, {'truth': str(path)}, differences, sections, flatten(config))


def compared_by_beams(
    options: argparse.Namespace,
    maps: Mapping[str, JudgedMap],
    config: EvaluationConfig,
    choice: HeldOutConfig,
    point_choice: HeldOutPointsConfig,
    placing: PlacingConfig,
    sampler: SamplerConfig,
) -> Compared:
    """Judge all maps by the same beams and the same points along them."""
    model = ForwardModel.from_config(sampler.model)
    filled = {name: one.filled for name, one in maps.items()}
    held = read_held_out(options, filled, choice, placing, sampler, config.unknown)
    beams, alignment = held.beams, alignment_of(options)
    values, scores, figures, columns = {}, {}, {}, {}
    for name, grid_map in filled.items():
        own = held.beams_in(name, grid_map)
        with tqdm(own.placed, unit=' scans', desc=f'judge {name}', disable=None) as bar:
            try:
                values[name] = beam_log_likelihood(grid_map, bar, model, prior=config.unknown)
            except GridError as error:
                raise GridError(f'{name}: {error}') from error
        figures[name] = beam_figures(own, values[name])
        if name in held.frames:
            figures[name]['alignment'] = frame_figures(
                held.frames[name], grid_map, beams, values[name], model, config.unknown
            )
        elif hint := frame_hint(grid_map, own, model, config.unknown):
            figures[name]['hint'] = hint
        mean = beams.mean(values[name])
        columns[name] = {
            'nats a beam': f'{mean.value:.4f} +- {mean.standard_error:.4f}',
            'end outside': f'{int(own.leaving.sum())} of {own.scan.size}',
        }
        if not options.points:
            continue
        points = held_out_points(own, point_choice.point_step)
        scores[name] = judged_points(grid_map, points, config)
        figures[name]['points'] = point_figures(points, scores[name])
        columns[name] |= {
            'points: area under ROC': f'{scores[name].counts.roc_area():.4f}',
            'points: log-loss': f'{scores[name].log_loss.value:.4f}',
            'points: Brier': f'{scores[name].brier.value:.4f}',
        }
    blocks = _blocks([_extent(held.frame_of(name), one.spec) for name, one in filled.items()])
    sections = [('Where one predicts held-out beams better', _all_wins(values, beams, blocks))]
    if scores:
        curves = Picture(
            reliability_png({name: one.reliability for name, one in scores.items()}),
            'Reliability at points of held-out beams',
        )
        sections.insert(0, ('Calibration at held-out points', [curves]))
    settings = {
        **beam_settings(choice, placing, sampler, held.no_return),
        **flatten(point_choice),
        **flatten(alignment),
    }
    common = read_figures(options, held)
    common['alignments'] = [
        f'{name}: {frame_said(one["alignment"], alignment)}'
        for name, one in figures.items()
        if 'alignment' in one
    ]
    common['hints'] = [f'{name}: {one["hint"]}' for name, one in figures.items() if 'hint' in one]
    differences = _differences(values, beams)
    return Compared(figures, columns, common, differences, sections, settings)


def _differences(values: Mapping[str, Float64Array], beams: HeldOutBeams) -> list[dict[str, Any]]:
    """Return by how much each map predicts the beams better than each after it, nats."""
    differences = []
    for first, second in combinations(values, 2):
        gap = values[first] - values[second]
        ratio = beams.mean(gap)
        by_scan = beams.per_scan(gap)
        differences.append({
            'map': first,
            'against': second,
            'nats_per_beam': ratio.value,
            'standard_error': ratio.standard_error,
            'scans_won': int((by_scan > 0.0).sum()),
            'scans_lost': int((by_scan < 0.0).sum()),
        })  # fmt: skip
    return differences


def _all_wins(
    values: Mapping[str, Float64Array], beams: HeldOutBeams, blocks: GridSpec
) -> list[Picture]:
    """Return where on the map one predicts the beams better than another, of those to be shown."""
    on_blocks = beams._replace(cell=cells_of_ends(beams.placed, blocks))
    what = f'log-likelihood of the beams that ended in {blocks.resolution_m:.2g} m'
    return [
        _wins(on_blocks.per_cell(values[first] - values[second], blocks), first, second, what)
        for first, second in _drawn({name: beams.mean(of).value for name, of in values.items()})
    ]


class _Extent(NamedTuple):
    """Lowest and highest x and y of a map in the frame of the beams, and its cells, m."""

    left: float
    right: float
    bottom: float
    top: float
    cell: float


def _extent(frame: Pose2D, spec: GridSpec) -> _Extent:
    left, right, bottom, top = spec.extent_m
    corners = [frame.compose(Pose2D(x, y)) for x in (left, right) for y in (bottom, top)]
    x, y = [one.x_m for one in corners], [one.y_m for one in corners]
    return _Extent(min(x), max(x), min(y), max(y), spec.resolution_m)


def _blocks(extents: list[_Extent]) -> GridSpec:
    """Return a coarse grid over all maps."""
    left = min(one.left for one in extents)
    bottom = min(one.bottom for one in extents)
    width = max(one.right for one in extents) - left
    height = max(one.top for one in extents) - bottom
    finest = max(one.cell for one in extents)
    side = max(finest, max(width, height) / BLOCKS)
    columns, rows = (max(1, int(np.ceil(length / side - 1e-9))) for length in (width, height))
    return GridSpec(side, columns, rows, anchor_x_m=left, anchor_y_m=bottom)


def _drawn(worth: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return the pairs that are drawn of maps by what they are worth."""
    if len(worth) <= MOST_IN_PAIRS:
        return list(combinations(worth, 2))
    best = max(worth, key=lambda name: worth[name])
    return [(best, name) for name in worth if name != best]


def _won(gap: AnyArray) -> dict[str, int]:
    return {'cells_won': int((gap > 0.0).sum()), 'cells_lost': int((gap < 0.0).sum())}


def _wins(gap: AnyArray, first: str, second: str, what: str) -> Picture:
    """Draw by how many nats the first of two maps is better, cell by cell; nan: no facts."""
    kinds = np.full(gap.shape, 5, np.uint8)
    kinds[gap == 0.0] = 2
    kinds[gap > 0.0], kinds[gap < 0.0] = 1, 3
    kinds[gap > STEP], kinds[gap < -STEP] = 0, 4
    return Picture(
        kinds_png(kinds, [*WINS, NO_FACTS]),
        f'{what}: blue where {first} is better than {second}, orange where it is worse '
        f'(dark: by more than {STEP:g} nats), grey as good; white: nothing to judge by',
    )
