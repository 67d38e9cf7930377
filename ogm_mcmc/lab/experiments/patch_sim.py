"""Table II, Fig. 5 and 6 of [patch]: four ways to map a hundred simulated data sets.

All 500 x 500 x 100 cells are pooled; cells that a method says nothing about are at the cell
prior, or, beside the border prior, where the chain starts: occupied. As published the chains
start from the traditional map thresholded at 0.2 (unmapped cells occupied), the prior is learned
from the ten buildings that are mapped, and each method draws a hundred maps or more, the cheap
border prior three hundred. What was counted in these drawings is taken nearly at its word
(`CLEAN`): they have no speckles.

Two more priors are tried on the first run in every building, one learned from ten other
buildings of the same kinds, and the one that comes with the package, of real maps of finer
cells. They answer how much knowing the building itself is worth.
"""

from __future__ import annotations

import time
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.config import LearningConfig, PatchTableConfig
from ogm_mcmc.engine.prior_files import default_prior_file, load_prior
from ogm_mcmc.lab.experiments.chains import (
    CUT_SIGMA,
    DEPTH,
    ChainPlan,
    rays_of,
    sampled_map,
    traditional_map,
)
from ogm_mcmc.lab.experiments.datasets import digest_of, run_all
from ogm_mcmc.lab.experiments.hundred_sets import set_names, simulated_set
from ogm_mcmc.lab.experiments.results import row
from ogm_mcmc.lab.experiments.scoring import SCORES, counts_of, draw_scores, pooled, summary
from ogm_mcmc.sampling.patch_learning import PatchCounts, count_map, total_of
from ogm_mcmc.sampling.patch_prior import PatchTable, make_table
from ogm_mcmc.simulation import FLOOR_PLANS, generate_floor

__all__ = ['buildings_prior', 'run', 'score']

BEAMS = 360
NOISE_CELLS = 3.0
START_THRESHOLD = 0.2
CELL_M = 0.1

# Cells around all rays that patches may change, too.
MARGIN = 8

# Counts of drawings without speckles, nearly as they are; nothing is impossible all the same.
CLEAN = PatchTableConfig(backoff_weight=0.5, min_windows=1, min_probability=0.001, max_floor=0.001)

TRADITIONAL, CELLS, PATCHES, BORDER = 'traditional', 'L = 1', 'L = 9', 'border, L = 9'
OTHER_BUILDINGS, REAL_MAPS = 'border, other buildings', 'border, real maps'

# The methods in the order in which they are computed, and what their files are called.
FILES = {
    TRADITIONAL: 'traditional',
    BORDER: 'border',
    CELLS: 'cells',
    PATCHES: 'patches',
    OTHER_BUILDINGS: 'other_buildings',
    REAL_MAPS: 'real_maps',
}

# Results of data sets by their names, by method.
Results = dict[str, dict[str, dict[str, Any]]]

PLANS = {
    CELLS: ChainPlan(samples=100, burn_in=20),
    PATCHES: ChainPlan(samples=100, burn_in=20),
    BORDER: ChainPlan(samples=300, burn_in=60),
}

# Table II.
PUBLISHED = {
    TRADITIONAL: (0.9717, 0.9328, 0.20, 0.9310, 0.9346),
    CELLS: (0.9571, 0.9460, 0.10, 0.9026, 0.9939),
    PATCHES: (0.9913, 0.9458, 0.10, 0.9032, 0.9925),
    BORDER: (0.9976, 0.9820, 0.07, 0.9694, 0.9950),
}


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Map and score all data sets; quick: one run in every second building."""
    names = set_names(runs=1 if quick else 10)
    if quick:
        names = {name: chosen for name, chosen in names.items() if chosen[0] % 2 == 0}
    settings = {'seed': seed, 'noise_cells': NOISE_CELLS, 'beams': BEAMS}
    results = run_all(
        folder / 'datasets',
        score,
        {
            f'{name}_{FILES[method]}': {'building': b, 'run': r, 'method': method, **settings}
            for method in FILES
            for name, (b, r) in names.items()
            if method in PUBLISHED or r == 1
        },
        title='patch-sim',
        depends_on={
            'plans': PLANS,
            'table': asdict(CLEAN),
            'margin': MARGIN,
            'start_threshold': START_THRESHOLD,
            'real_maps': digest_of(default_prior_file().read_bytes()),
        },
    )
    by_method = {
        method: {name: results[key] for name in names if (key := f'{name}_{file}') in results}
        for method, file in FILES.items()
    }
    counts = {method: pooled(by_method[method].values()) for method in PUBLISHED}
    ours = {method: summary(of) for method, of in counts.items()}
    rows = [
        row(f'{method}: {what}', ours[method][what], published)
        for method, line in PUBLISHED.items()
        for what, published in zip(SCORES, line, strict=True)
    ]
    gained = ours[BORDER]['max F1'] - ours[TRADITIONAL]['max F1']
    rows.append(row('border, L = 9 above traditional, max F1', gained, 0.9820 - 0.9328))
    rows += [
        row(f'{method}: F1 at 0.5', float(of.f1()[of.thresholds == 0.5][0]))
        for method, of in counts.items()
    ]
    return {
        'rows': [*rows, *_first_runs(by_method)],
        'pictures': draw_scores(folder, counts),
        'settings': {**settings, 'data_sets': len(names), **_described(by_method, seed)},
        'f1_by_data_set': {
            name: {
                method: summary(pooled([by_method[method][name]]))['max F1']
                for method in PUBLISHED
            }
            for name in names
        },
        'notes': NOTES,
    }


def _described(by_method: Results, seed: int) -> dict[str, Any]:
    """Return what the numbers depend on beside the arguments of `score`."""
    every = list(by_method[TRADITIONAL].values())
    scans = [result['scans'] for result in every]
    return {
        'prior': f'{buildings_prior(seed).p_occupied:.4f}',
        'scans_per_set': f'{min(scans)} to {max(scans)}',
        'measured_share': f'{np.mean([result["measured"] for result in every]):.3f}',
        'samples': {method: plan.samples for method, plan in PLANS.items()},
        'burn_in': {method: plan.burn_in for method, plan in PLANS.items()},
        'start_threshold': START_THRESHOLD,
        'forward_model': f'gaussian, sigma {NOISE_CELLS:g} cells, depth {DEPTH:g}, '
        f'rays cut {CUT_SIGMA:g} sigma behind their reading',
        'seconds_per_set': {
            method: round(float(np.mean([result['seconds'] for result in sets.values()])), 2)
            for method, sets in by_method.items()
        },
    }


NOTES = [
    "The paper's ten maps are not public and it does not say how many beams a scan has. The "
    'buildings here are generated, with walls at any angle where those of the paper show 865 '
    'borders in all; 360 beams are one a degree.',
    'The first three methods are sampled or averaged over all cells; what no ray touches is at '
    'the cell prior, as published.',
    'The last rows use the first run in each building only: compare them with each other.',
]


def _first_runs(by_method: Results) -> list[dict[str, Any]]:
    """Rows of what was tried on the first run in each building only."""
    first = by_method[OTHER_BUILDINGS]
    return [
        row(
            f'{method}: max F1 on {len(first)} first runs',
            summary(pooled(by_method[method][name] for name in first))['max F1'],
        )
        for method in (TRADITIONAL, BORDER, OTHER_BUILDINGS, REAL_MAPS)
    ]


def score(
    building: int, run: int, method: str, seed: int, noise_cells: float, beams: int
) -> dict[str, Any]:
    """Map one data set in one way and count over all cells."""
    data = simulated_set(building, run, seed=seed, noise_cells=noise_cells, beams=beams)
    prior = buildings_prior(seed).p_occupied
    table = _table(method, seed)
    began = time.perf_counter()
    found, unmapped = traditional_map(data, prior), prior
    measured = float(np.isfinite(found.probability).mean())
    if method != TRADITIONAL:
        start = (np.nan_to_num(found.probability, nan=1.0) >= START_THRESHOLD).astype(np.uint8)
        window = rays_of(data, noise_cells, margin=MARGIN)
        plan = PLANS.get(method, PLANS[BORDER])
        found = sampled_map(data, window, plan, start, table=table, prior=prior, seed=seed)
        # Outside of the window a chain with the border prior keeps what it starts with.
        unmapped = prior if method in (CELLS, PATCHES) else 1.0
    seconds = time.perf_counter() - began
    return {
        **counts_of(found, data.world, unmapped),
        'measured': measured,
        'scans': len(data.scans),
        'seconds': round(seconds, 3),
    }


@lru_cache(maxsize=4)
def _table(method: str, seed: int) -> PatchTable | None:
    """Return the prior of a method as a table; None for cells on their own."""
    if method in (TRADITIONAL, CELLS):
        return None
    if method == REAL_MAPS:
        return make_table('border', 9, load_prior(default_prior_file()).counts)
    counts = buildings_prior(seed + 1 if method == OTHER_BUILDINGS else seed)
    return make_table('patch' if method == PATCHES else 'border', 9, counts, CLEAN)


@lru_cache(maxsize=4)
def buildings_prior(seed: int) -> PatchCounts:
    """Count the patches of the ten buildings of a seed, all of the drawing, as [patch] did."""
    whole = LearningConfig(resolution=CELL_M, margin=1000.0)
    floors = (generate_floor(number, seed) for number in range(1, len(FLOOR_PLANS) + 1))
    return total_of(count_map(floor.occupied.astype(np.int8), whole) for floor in floors)
