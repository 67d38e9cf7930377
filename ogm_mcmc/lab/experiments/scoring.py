"""Scores of maps whose truth is known; pooled ones are Table II and Fig. 5 and 6 of [patch]."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array
from ogm_mcmc.evaluation import (
    ThresholdCounts,
    aligned,
    brier_score,
    confusion_counts,
    reliability,
)
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.lab.experiments.results import save_picture
from ogm_mcmc.plotting import Series, curves_png
from ogm_mcmc.simulation import GridWorld

__all__ = [
    'SCORES',
    'THRESHOLDS',
    'against_cells',
    'counts_of',
    'draw_scores',
    'pooled',
    'summary',
]

THRESHOLDS = np.linspace(0.0, 1.0, 101)

# The lines of Table II.
SCORES = (
    'max precision',
    'max F1',
    'threshold for max F1',
    'precision at max F1',
    'recall at max F1',
)


def against_cells(probability: Float64Array, occupied: BoolArray) -> dict[str, float]:
    """Return the figures of cells (N,) beside what they are: (N,), true where occupied.

    `best_f1` over all thresholds, `f1` at 0.5, `roc_area`, `brier`, `calibration_error` (mean over
    cells in ten bins of what is said).
    """
    counts = confusion_counts(probability, occupied)
    return {
        'best_f1': counts.best().f1,
        'f1': confusion_counts(probability, occupied, np.array([0.5])).scores(0).f1,
        'roc_area': counts.roc_area(),
        'brier': float(brier_score(probability, occupied)),
        'calibration_error': reliability(probability, occupied, 10).expected_error(),
    }


def counts_of(grid_map: GridMap, world: GridWorld, prior: float) -> dict[str, Any]:
    """Return confusion counts over all cells, as lists for JSON; unmapped cells are at `prior`."""
    measured = aligned(grid_map, world.truth())
    known = np.isfinite(measured)
    probability = np.where(known, measured, np.float32(prior))
    counts = confusion_counts(probability, world.occupied == 1, THRESHOLDS)
    return {
        'true_positives': counts.true_positives.astype(int).tolist(),
        'false_positives': counts.false_positives.astype(int).tolist(),
        'positives': counts.positives,
        'negatives': counts.negatives,
        'measured': float(known.mean()),
    }


def pooled(results: Iterable[Mapping[str, Any]]) -> ThresholdCounts:
    """Return the counts of all data sets together."""
    empty = np.zeros(THRESHOLDS.size)
    total = ThresholdCounts(THRESHOLDS[::-1], empty, empty, 0, 0)
    for result in results:
        one = ThresholdCounts(
            THRESHOLDS[::-1],
            np.array(result['true_positives'], np.float64),
            np.array(result['false_positives'], np.float64),
            int(result['positives']),
            int(result['negatives']),
        )
        total = total.pooled(one)
    return total


def summary(counts: ThresholdCounts) -> dict[str, float]:
    """Return the numbers of Table II by the names in SCORES.

    Precision counts at thresholds from which on any cell is called occupied at all.
    """
    best = counts.best()
    called = counts.true_positives + counts.false_positives > 0
    highest = float(counts.precision()[called].max())
    return dict(
        zip(
            SCORES,
            (highest, best.f1, best.threshold, best.precision, best.recall),
            strict=True,
        )
    )


def draw_scores(folder: Path, methods: Mapping[str, ThresholdCounts]) -> dict[str, str]:
    """Draw both figures with a curve for each method; return the captions by file name."""
    curves = [Series(name, of.recall(), of.precision()) for name, of in methods.items()]
    save_picture(
        folder / 'precision_recall.png',
        curves_png(curves, 'recall', 'precision', x_limits=(0.5, 1.0), y_limits=(0.5, 1.0)),
    )
    over = [Series(name, of.thresholds, of.f1()) for name, of in methods.items()]
    save_picture(
        folder / 'f1.png',
        curves_png(over, 'threshold', 'F1', x_limits=(0.0, 1.0), y_limits=(0.0, 1.0)),
    )
    return {
        'precision_recall.png': 'Precision and recall over all data sets (Fig. 5 of [patch])',
        'f1.png': 'F1 over the threshold (Fig. 6 of [patch])',
    }
