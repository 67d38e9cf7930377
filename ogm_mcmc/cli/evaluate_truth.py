"""`evaluate MAP --truth MAP`: every figure of a map against the true one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.cli.evaluate_answer import Answer
from ogm_mcmc.config import EvaluationConfig
from ogm_mcmc.evaluation import Comparison, compare
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.map_files import JudgedMap, load_grid
from ogm_mcmc.io.map_images import MOST_CELLS
from ogm_mcmc.plotting import (
    Picture,
    Series,
    agreement_png,
    curves_png,
    heat_png,
    probability_png,
)

__all__ = ['against_truth']


def against_truth(
    judged: JudgedMap, path: Path, config: EvaluationConfig, most_cells: int = MOST_CELLS
) -> Answer:
    """Compare a map with the one of a file."""
    truth = load_grid(path, most_cells)
    comparison = compare(judged.known, truth, config, filled=judged.filled)
    figures = {'truth': str(path), **comparison.figures}
    settings = figures.pop('settings')
    sections = [
        ('Maps', _maps(truth, comparison, config.threshold)),
        ('Curves', _curves(comparison)),
    ]
    return Answer(figures, _rows(figures), sections, settings)


def _rows(of: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the figures as name and value, for people."""
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


def _maps(truth: GridMap, comparison: Comparison, threshold: float) -> list[Picture]:
    called, counted = comparison.probability >= threshold, comparison.counted
    return [
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
