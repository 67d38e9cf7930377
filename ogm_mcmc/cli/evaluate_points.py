"""`evaluate MAP --beams BAG --points`: a map as a classifier of points along held-out beams."""

from __future__ import annotations

from typing import Any

import numpy as np

from ogm_mcmc.cli.evaluate_answer import Answer
from ogm_mcmc.config import EvaluationConfig, HeldOutPointsConfig, flatten
from ogm_mcmc.evaluation import (
    HeldOutBeams,
    HeldOutPoints,
    PointScores,
    Ratio,
    Reliability,
    held_out_points,
    probability_at,
    score_points,
)
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.plotting import Picture, Series, curves_png

__all__ = ['by_points', 'judged_points', 'point_figures', 'reliability_png']


def by_points(
    grid_map: GridMap, beams: HeldOutBeams, config: EvaluationConfig, choice: HeldOutPointsConfig
) -> Answer:
    """Judge a map by points of beams: free along them, occupied where they returned."""
    points = held_out_points(beams, choice.point_step)
    scores = judged_points(grid_map, points, config)
    figures = point_figures(points, scores)
    return Answer(
        figures, _rows(figures), [('Held-out points', _pictures(scores))], flatten(choice)
    )


def judged_points(
    grid_map: GridMap, points: HeldOutPoints, config: EvaluationConfig
) -> PointScores:
    """Return the scores of what a map says of points."""
    given = probability_at(grid_map, points.xy_m, config.unknown)
    return score_points(points, given, floor=config.floor, bins=config.bins)


def point_figures(points: HeldOutPoints, scores: PointScores) -> dict[str, Any]:
    """Return the figures of points for the JSON."""
    return {
        'points': points.occupied.size,
        'occupied_points': int(points.occupied.sum()),
        'roc_area': scores.counts.roc_area(),
        'log_loss': _named(scores.log_loss),
        'log_loss_clipped_points': scores.clipped,
        'brier_score': _named(scores.brier),
        'expected_calibration_error': scores.reliability.expected_error(),
    }


def reliability_png(bins_of: dict[str, Reliability]) -> bytes:
    """Draw the reliability curves of maps by name."""
    unit, diagonal = (0.0, 1.02), np.array([0.0, 1.0])
    curves = []
    for name, bins in bins_of.items():
        filled = bins.cells > 0
        curves.append(Series(name, bins.predicted()[filled], bins.observed()[filled], 'o-'))
    return curves_png(
        [*curves, Series('perfectly calibrated', diagonal, diagonal, 'k:')],
        'predicted probability',
        'share that is occupied',
        x_limits=unit,
        y_limits=unit,
    )


def _named(ratio: Ratio) -> dict[str, float]:
    return {'value': ratio.value, 'standard_error': ratio.standard_error}


def _rows(of: dict[str, Any]) -> list[tuple[str, str]]:
    clipped = of['log_loss_clipped_points']
    floor = f' ({clipped} points moved to the floor)' if clipped else ''
    return [
        ('points of held-out beams', f'{of["points"]} ({of["occupied_points"]} occupied)'),
        ('  area under ROC', f'{of["roc_area"]:.4f}'),
        ('  log-loss, nats', f'{_shown(of["log_loss"])}{floor}'),
        ('  Brier score', _shown(of['brier_score'])),
        ('  expected calibration error', f'{of["expected_calibration_error"]:.4f}'),
    ]


def _shown(figure: dict[str, float]) -> str:
    value, error = figure['value'], figure['standard_error']
    return f'{value:.4f}' + (f' +- {error:.4f}' if np.isfinite(error) else '')


def _pictures(scores: PointScores) -> list[Picture]:
    unit = (0.0, 1.02)
    counts, bins = scores.counts, scores.reliability
    roc = [Series('', counts.false_positive_rate(), counts.recall())]
    return [
        Picture(
            curves_png(
                roc, 'false positive rate', 'true positive rate', x_limits=unit, y_limits=unit
            ),
            f'ROC of points; area {counts.roc_area():.4f}',
        ),
        Picture(
            reliability_png({'map': bins}),
            f'Reliability at points; expected calibration error {bins.expected_error():.4f}',
        ),
    ]
