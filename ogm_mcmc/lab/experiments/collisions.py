"""Are answers about ways to be believed? Said and true collisions in generated buildings.

A building is driven through, 5 % of the beams are mapped as `~/refine` does, and 4000 straight
ways of 0.5 to 4 m begin in cells that the map calls free. How likely each is blocked for a disc
is asked of the samples (`collision_risk`) and, for comparison, of the product of the cells'
probabilities. The truth is the building itself. A way that leaves what the map knows counts.
The places where the ways end are asked, too.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.config.settings import flatten
from ogm_mcmc.engine.collision import BEHIND, LUMP_M2, chance_of_unknown, collision_risk
from ogm_mcmc.engine.collision_kernels import reach
from ogm_mcmc.engine.kept_samples import MOST_SAMPLES
from ogm_mcmc.evaluation import reliability
from ogm_mcmc.geometry import GridMap, SampleBits
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.localization_logs import DRIVING, LIDAR, MOST_SCANS, log_of
from ogm_mcmc.lab.experiments.localization_maps import (
    BURN_IN,
    CHAINS,
    SWEEPS_BETWEEN,
    maps_of,
    some_beams,
)
from ogm_mcmc.lab.experiments.results import row
from ogm_mcmc.simulation import generate_floor

__all__ = ['product_risk', 'run', 'score']

BUILDINGS = (2, 4, 5, 6, 8, 9)
WAYS, RADIUS_M, SHARE = 4000, 0.2, 0.05
SHORTEST_M, LONGEST_M = 0.5, 4.0

NOTES = [
    'Error: mean over ways of the difference between what is said and what happens, in ten bins '
    'of what is said. Known: ways of which the disc meets no unknown cell; unknown: all others. '
    'Ends: single places, where the ways end. '
    'Product: all ways, asked of the cells as if they were independent.',
]


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Ask of six buildings, of all scans and of every second; quick: of one."""
    buildings, steps = (BUILDINGS[2:3], (1,)) if quick else (BUILDINGS, (1, 2))
    parts = run_all(
        folder / 'datasets',
        score,
        {
            f'building{number:02d}_step{step}': {'building': number, 'step': step, 'seed': seed}
            for step in steps
            for number in buildings
        },
        title='collisions',
        depends_on={
            'ways': [WAYS, RADIUS_M, SHARE, SHORTEST_M, LONGEST_M],
            'unknown': [LUMP_M2, BEHIND, 'geometric mean of the prior and built-up tiles'],
            'drive': [asdict(LIDAR), asdict(DRIVING), MOST_SCANS],
            'sweeps': [CHAINS, BURN_IN, SWEEPS_BETWEEN, MOST_SAMPLES],
            'sampler': flatten(RefineSamplerConfig()),
        },
    )
    rows = [
        row(
            f'building {one["building"]}, one of {one["step"]} scans, {ways} ways: error',
            one[ways]['error'],
            None,
            f'{one[ways]["ways"]} ways, said {one[ways]["said"]}, true {one[ways]["true"]}',
        )
        for one in parts.values()
        for ways in ('all', 'known', 'unknown', 'ends', 'product')
    ]
    settings = {'seed': seed, 'ways': WAYS, 'radius_m': RADIUS_M, 'share of beams': SHARE}
    return {'rows': rows, 'parts': list(parts.values()), 'settings': settings, 'notes': NOTES}


def score(building: int, step: int, seed: int) -> dict[str, Any]:
    """Map one building, ask of its ways and look what is true."""
    log, world = log_of(f'building-{building}', seed), generate_floor(building, seed)
    rng = np.random.default_rng((seed, building, step))
    maps = maps_of(some_beams(log.placed(slice(0, None, step)), SHARE, rng), 0.1, seed)
    ways = _ways(maps.mean, rng)
    true_map = world.occupied[np.newaxis]
    truth = SampleBits.of_maps(world.spec, true_map, np.ones(world.occupied.shape, np.bool_))
    nothing = maps.bits._replace(words=np.zeros_like(maps.bits.words))

    def asked(bits: SampleBits, unknown: float) -> Float64Array:
        return np.array([collision_risk(bits, way, RADIUS_M, unknown)[1:] for way in ways])

    chance = chance_of_unknown(maps.bits, maps.prior)
    (said_end, said), (blocked_end, blocked) = asked(maps.bits, chance).T, asked(truth, 1.0).T
    product = np.array([product_risk(maps.mean, way, RADIUS_M, maps.prior) for way in ways])
    known = asked(nothing, 1.0)[:, 1] == 0.0
    hit: BoolArray = blocked > 0.5
    return {
        'building': building,
        'step': step,
        'all': _told(said, hit),
        'known': _told(said[known], hit[known]),
        'unknown': _told(said[~known], hit[~known]),
        'ends': _told(said_end, blocked_end > 0.5),
        'product': _told(product, hit),
        'chance': chance,
    }


def _told(said: Float64Array, hit: BoolArray) -> dict[str, Any]:
    """Return the calibration error of answers, how many, and what was said and true on average."""
    if said.size == 0:
        return {'ways': 0, 'error': None, 'said': None, 'true': None}
    return {
        'ways': said.size,
        'error': reliability(said, hit).expected_error(),
        'said': float(said.mean()),
        'true': float(hit.mean()),
    }


def _ways(grid_map: GridMap, rng: np.random.Generator) -> Float64Array:
    """Return ways (WAYS, 2, 2), m, from where the map is free in any direction."""
    spec = grid_map.spec
    free = np.flatnonzero(grid_map.probability.reshape(-1) < 0.5)
    rows, columns = np.divmod(rng.choice(free, WAYS), spec.width)
    inside = np.column_stack((columns, rows)) + rng.random((WAYS, 2))
    start = inside * spec.resolution_m + (spec.origin_x_m, spec.origin_y_m)
    heading = rng.uniform(-math.pi, math.pi, WAYS)
    length = rng.uniform(SHORTEST_M, LONGEST_M, WAYS)
    along = np.column_stack((np.cos(heading), np.sin(heading)))
    return np.stack((start, start + length[:, np.newaxis] * along), axis=1)


def product_risk(grid_map: GridMap, way: Float64Array, radius_m: float, unknown: float) -> float:
    """Return how likely a disc meets something on a straight way if cells were independent.

    way  (2, 2), m: from, to. Cells that the map does not know have `unknown`.
    """
    spec = grid_map.spec
    (ax, ay), (bx, by) = spec.in_cells(way)
    radius, span, clear = radius_m / spec.resolution_m, np.empty(2), 1.0
    for y in range(math.floor(min(ay, by) - radius), math.floor(max(ay, by) + radius) + 1):
        reach(ax, ay, bx, by, radius, float(y), y + 1.0, span)
        if span[0] > span[1]:
            continue
        first, beyond = math.floor(span[0]), math.floor(span[1]) + 1
        here = np.full(beyond - first, np.nan, np.float32)
        left, right = max(first, 0), min(beyond, spec.width)
        if 0 <= y < spec.height and left < right:
            here[left - first : right - first] = grid_map.probability[y, left:right]
        clear *= float(np.prod(1.0 - np.nan_to_num(here.astype(np.float64), nan=unknown)))
    return 1.0 - clear
