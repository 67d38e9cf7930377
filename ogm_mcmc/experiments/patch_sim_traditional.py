"""Table II of [patch], column "Traditional OGM": scores on a hundred simulated data sets.

All 500 x 500 x 100 cells are pooled; unmapped ones are estimated at the cell prior. The prior
0.234 is that of the paper's patches; beams count one by one, as Eq. 2 of [gibbs] has it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.evaluation import ThresholdCounts, aligned, confusion_counts
from ogm_mcmc.experiments.datasets import run_all
from ogm_mcmc.experiments.hundred_sets import set_names, simulated_set
from ogm_mcmc.experiments.results import row
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.plotting import Series, curves_png

__all__ = ['run', 'score']

NOISE_CELLS = 3.0
CELL_PRIOR = 0.234
THRESHOLDS = np.linspace(0.0, 1.0, 101)

# Table II, column "Traditional OGM".
PUBLISHED = {
    'max precision': 0.9717,
    'max F1': 0.9328,
    'threshold for max F1': 0.20,
    'precision at max F1': 0.9310,
    'recall at max F1': 0.9346,
}


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Map and score all data sets; quick: one run on each of the ten maps."""
    names = set_names(runs=1 if quick else 10)
    settings = {'seed': seed, 'noise_cells': NOISE_CELLS, 'prior': CELL_PRIOR}
    results = run_all(
        folder / 'datasets',
        score,
        {name: {'building': b, 'run': r, **settings} for name, (b, r) in names.items()},
        title='patch-sim-traditional',
    )
    counts = pooled(results)
    best = counts.best()
    called = counts.true_positives + counts.false_positives > 0
    ours = {
        'max precision': float(counts.precision()[called].max()),
        'max F1': best.f1,
        'threshold for max F1': best.threshold,
        'precision at max F1': best.precision,
        'recall at max F1': best.recall,
    }
    _draw(folder, counts)
    scans = [result['scans'] for result in results.values()]
    return {
        'rows': [row(what, ours[what], PUBLISHED[what]) for what in PUBLISHED],
        'pictures': {
            'precision_recall.png': 'Precision and recall over all data sets (Fig. 5 of [patch])',
            'f1.png': 'F1 over the threshold (Fig. 6 of [patch])',
        },
        'settings': {
            **settings,
            'data_sets': len(results),
            'scans_per_set': f'{min(scans)} to {max(scans)}',
            'measured_cells': f'{np.mean([r["measured"] for r in results.values()]):.3f}',
        },
        'notes': [
            "The paper's ten maps are not public and the number of beams is not given; the "
            'buildings here are generated. Compare columns of one table, not digits.'
        ],
        'counts': _as_lists(counts),
    }


def score(building: int, run: int, seed: int, noise_cells: float, prior: float) -> dict[str, Any]:
    """Map one data set and count over all cells."""
    data = simulated_set(building, run, seed=seed, noise_cells=noise_cells)
    spec = data.world.spec
    pipeline = MappingPipeline(
        MapperConfig(fusion='per_beam', resolution=spec.resolution_m, prior=prior)
    )
    for scan, pose in data.scans:
        pipeline.update(scan, PoseBelief(pose))
    measured = aligned(pipeline.map(), data.world.truth())
    probability = np.where(np.isfinite(measured), measured, np.float32(prior))
    counts = confusion_counts(probability, data.world.occupied == 1, THRESHOLDS)
    return {
        **_as_lists(counts),
        'scans': len(data.scans),
        'measured': float(np.isfinite(measured).mean()),
    }


def pooled(results: dict[str, dict[str, Any]]) -> ThresholdCounts:
    """Return the counts over all data sets."""
    total: ThresholdCounts | None = None
    for result in results.values():
        one = ThresholdCounts(
            THRESHOLDS[::-1],
            np.array(result['true_positives'], np.float64),
            np.array(result['false_positives'], np.float64),
            int(result['positives']),
            int(result['negatives']),
        )
        total = one if total is None else total.pooled(one)
    assert total is not None, 'there is always a data set'
    return total


def _as_lists(counts: ThresholdCounts) -> dict[str, Any]:
    return {
        'true_positives': counts.true_positives.astype(int).tolist(),
        'false_positives': counts.false_positives.astype(int).tolist(),
        'positives': counts.positives,
        'negatives': counts.negatives,
    }


def _draw(folder: Path, counts: ThresholdCounts) -> None:
    series = [Series('traditional', counts.recall(), counts.precision())]
    (folder / 'precision_recall.png').write_bytes(
        curves_png(series, 'recall', 'precision', x_limits=(0.5, 1.0), y_limits=(0.5, 1.0))
    )
    over = [Series('traditional', counts.thresholds, counts.f1())]
    (folder / 'f1.png').write_bytes(
        curves_png(over, 'threshold', 'F1', x_limits=(0.0, 1.0), y_limits=(0.0, 1.0))
    )
