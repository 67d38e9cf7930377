"""Table II of [patch], column "Traditional OGM": scores on a hundred simulated data sets.

All 500 x 500 x 100 cells are pooled; unmapped ones are estimated at the cell prior. The prior
0.234 is that of the paper's patches; beams count one by one, as the update of [gibbs] section II
has it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.experiments.datasets import run_all
from ogm_mcmc.experiments.hundred_sets import set_names, simulated_set
from ogm_mcmc.experiments.results import row
from ogm_mcmc.experiments.scoring import SCORES, counts_of, draw_scores, pooled, summary
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['run', 'score']

NOISE_CELLS = 3.0
CELL_PRIOR = 0.234

# Table II, column "Traditional OGM".
PUBLISHED = dict(zip(SCORES, (0.9717, 0.9328, 0.20, 0.9310, 0.9346), strict=True))


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
    counts = pooled(results.values())
    ours = summary(counts)
    scans = [result['scans'] for result in results.values()]
    return {
        'rows': [row(what, ours[what], PUBLISHED[what]) for what in SCORES],
        'pictures': draw_scores(folder, {'traditional': counts}),
        'settings': {
            **settings,
            'data_sets': len(results),
            'scans_per_set': f'{min(scans)} to {max(scans)}',
            'measured_share': f'{np.mean([r["measured"] for r in results.values()]):.3f}',
        },
        'f1_by_data_set': {name: summary(pooled([r]))['max F1'] for name, r in results.items()},
        'notes': [
            "The paper's ten maps are not public and the number of beams is not given; the "
            'buildings here are generated. Compare columns of one table, not digits.'
        ],
    }


def score(building: int, run: int, seed: int, noise_cells: float, prior: float) -> dict[str, Any]:
    """Map one data set and count over all cells."""
    data = simulated_set(building, run, seed=seed, noise_cells=noise_cells)
    pipeline = MappingPipeline(
        MapperConfig(fusion='per_beam', resolution=data.world.spec.resolution_m, prior=prior)
    )
    for scan, pose in data.scans:
        pipeline.update(scan, PoseBelief(pose))
    return {**counts_of(pipeline.map(), data.world, prior), 'scans': len(data.scans)}
