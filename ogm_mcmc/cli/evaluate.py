"""`evaluate MAP --truth MAP`: every figure of a map against the true one, and a page of pictures.

MAP is a map YAML or, better, the NPZ that `map` writes: the image of a YAML knows no
probabilities between 0 and 1.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config import EvaluationConfig, add_arguments, build, given
from ogm_mcmc.errors import OutputError
from ogm_mcmc.evaluation import Comparison, compare
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.map_files import checked_name, load_grid, replacing, writable_folder
from ogm_mcmc.plotting import (
    Page,
    Picture,
    Series,
    agreement_png,
    curves_png,
    heat_png,
    probability_png,
    require_matplotlib,
)

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('evaluate', help='compare a map with the true one')
    parser.add_argument('map', type=Path, help='NPZ with probabilities, or map YAML')
    parser.add_argument('--truth', type=Path, required=True, metavar='MAP', help='likewise')
    parser.add_argument(
        '-o', dest='folder', type=Path, default=Path('out/evaluate'), metavar='DIR'
    )
    parser.add_argument('--name', default='evaluation', help='name of the JSON and HTML file')
    add_arguments(parser.add_argument_group('what counts'), EvaluationConfig)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    config = build(EvaluationConfig, given(options, EvaluationConfig))
    checked_name(options.name)
    require_matplotlib()
    grid_map, truth = load_grid(options.map), load_grid(options.truth)
    comparison = compare(grid_map, truth, config)
    writable_folder(options.folder)
    paths = {kind: options.folder / f'{options.name}.{kind}' for kind in ('html', 'json')}
    for path in paths.values():
        if path.is_dir():
            raise OutputError(f'{path}: is a folder; expected a name for a file')
    result = {
        'map': str(options.map),
        'truth': str(options.truth),
        **_finite(comparison.figures),
        'files': {kind: str(path) for kind, path in paths.items()},
    }
    page = make_page(truth, comparison, result)
    with replacing(paths['json']) as json_file, replacing(paths['html']) as html_file:
        json_file.write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')
        html_file.write_text(page.html(), encoding='utf-8')
    lines = [f'{name:<28} {value}' for name, value in table_rows(comparison)]
    print_result(options, result, '\n'.join([*lines, str(paths['html'])]))
    return 0


def table_rows(comparison: Comparison) -> list[tuple[str, str]]:
    """Return the figures as name and value, for people."""
    of = comparison.figures
    at, best, distance = of['at_threshold'], of['best'], of['occupied_distance']
    to_truth, to_map = distance['map_to_truth_m'], distance['truth_to_map_m']
    clipped = of['divergence_clipped_cells']
    floor = f' ({clipped} cells moved to the floor)' if clipped else ''
    return [
        ('cells that count', f'{of["cells"]} ({of["measured_cells"]} of them measured)'),
        ('occupied in the truth', str(of['occupied_cells'])),
        ('divergence, nats', f'{of["divergence_nats"]:.6g}{floor}'),
        ('  per cell', f'{of["divergence_per_cell"]:.4g}'),
        ('entropy, nats', f'{of["entropy_nats"]:.6g}'),
        (f'at threshold {at["threshold"]:.3g}', _scores(at)),
        (f'best, at {best["threshold"]:.3g}', _scores(best)),
        ('area under ROC', f'{of["roc_area"]:.4f}'),
        ('average precision', f'{of["average_precision"]:.4f}'),
        ('expected calibration error', f'{of["expected_calibration_error"]:.4f}'),
        ('Brier score', f'{of["brier_score"]:.4f}'),
        ('drawn to true wall, m', f'{to_truth["mean"]:.3f} mean, {to_truth["largest"]:.3f} worst'),
        ('true to drawn wall, m', f'{to_map["mean"]:.3f} mean, {to_map["largest"]:.3f} worst'),
    ]


def _scores(scores: dict[str, float]) -> str:
    return (
        f'F1 {scores["f1"]:.4f}, precision {scores["precision"]:.4f}, '
        f'recall {scores["recall"]:.4f}'
    )


def _finite(value: Any) -> Any:
    """Replace what JSON has no number for (nan, inf) by None."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def make_page(truth: GridMap, comparison: Comparison, result: dict[str, Any]) -> Page:
    """Return the page with all figures and pictures."""
    settings = result['settings']
    threshold, counted = settings['threshold'], comparison.counted
    page = Page(f'{Path(result["map"]).name} against {Path(result["truth"]).name}')
    page.table((), table_rows(comparison))
    page.heading('Maps')
    called = comparison.probability >= threshold
    page.pictures(
        [
            Picture(probability_png(comparison.measured), 'The map, on the cells of the truth'),
            Picture(probability_png(truth.probability), 'The truth'),
            Picture(
                agreement_png(called, comparison.occupied, counted),
                f'At threshold {threshold:g}: walls found (black), missed (blue), drawn where '
                'there is none (red); grey does not count',
            ),
            Picture(
                heat_png(np.where(counted, comparison.divergence, np.nan), 1.0),
                'Divergence per cell: white 0, black 1 nat or more',
            ),
        ]
    )
    page.heading('Curves')
    page.pictures(_curves(comparison))
    page.heading('Settings')
    page.table(('setting', 'value'), sorted(settings.items()))
    return page


def _curves(comparison: Comparison) -> list[Picture]:
    counts, bins = comparison.counts, comparison.reliability
    unit, diagonal = (0.0, 1.02), np.array([0.0, 1.0])
    precision, recall, f1 = counts.precision(), counts.recall(), counts.f1()
    filled = bins.cells > 0
    return [
        Picture(
            curves_png(
                [Series('', recall, precision)],
                'recall',
                'precision',
                x_limits=unit,
                y_limits=unit,
            ),
            f'Precision and recall; average precision {counts.average_precision():.4f}',
        ),
        Picture(
            curves_png(
                [Series('', counts.false_positive_rate(), recall)],
                'false positive rate',
                'true positive rate',
                x_limits=unit,
                y_limits=unit,
            ),
            f'ROC; area {counts.roc_area():.4f}',
        ),
        Picture(
            curves_png(
                [
                    Series('F1', counts.thresholds, f1),
                    Series('precision', counts.thresholds, precision, '--'),
                    Series('recall', counts.thresholds, recall, ':'),
                ],
                'threshold',
                'score',
                x_limits=unit,
                y_limits=unit,
            ),
            'Scores over the threshold',
        ),
        Picture(
            curves_png(
                [
                    Series('map', bins.predicted()[filled], bins.observed()[filled], 'o-'),
                    Series('perfectly calibrated', diagonal, diagonal, 'k:'),
                ],
                'predicted probability',
                'share of occupied cells',
                x_limits=unit,
                y_limits=unit,
            ),
            f'Reliability; expected calibration error {bins.expected_error():.4f}',
        ),
    ]
