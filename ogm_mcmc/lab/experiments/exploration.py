"""A robot that goes where a scan is expected to tell most ([gibbs] section I), and by which map.

"Exploration algorithms ... evaluate the expected information" of a view, from a map that says how
uncertain it is. The robot stands, scans, maps, and chooses among places in reach the one with most
nats for the way there. What it expects comes from the traditional map, from the posterior mean
(border prior) or from samples; all else is the same, and its poses are known. `frontier` asks no
map: it is the explorer of `ogm_mcmc.simulation.exploration`, which goes to borders of the known.

Whatever led the robot, what it measured is judged by the same maps: area covered and F1 at
0.5 of the traditional map of its scans after so many metres, F1 of the border map at the end.
Area covered is of cells that a beam crossed. With few beams it grows wherever the robot scans
again, also in a room that a map has inferred, so space seen is counted as well: free cells that
an ideal lidar of the same reach sees from the same stops.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.config.settings import flatten
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.evaluation import aligned, confusion_counts
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.exploration_views import (
    BEAMS,
    BURN_IN,
    CHAINS,
    COUNTED,
    KEPT,
    LIVE,
    MEAN,
    PATIENCE_M,
    PLACES,
    POLICIES,
    SAMPLES,
    SETTLING,
    UNKNOWN,
    WORTHLESS_NATS,
    Explorer,
    border_map,
)
from ogm_mcmc.lab.experiments.results import markdown_table, row, save_picture
from ogm_mcmc.plotting import Series, curves_png
from ogm_mcmc.simulation import Exploration, GridWorld, Lidar, explore, generate_floor, seen_from

__all__ = ['run', 'score']

BUILDINGS, SEEDS = 10, 5

# After so many metres a robot is judged; it stops after the last.
METRES = (10.0, 20.0, 40.0, 80.0)

LIDAR = Lidar(90, range_min_m=0.0, range_max_m=7.5, noise_m=0.1, clutter=0.02)
MODEL = ForwardModelConfig(sigma=0.1, clutter=0.02, missing=0.01)

MEASURES = {
    'area_m2': 'area covered, m2',
    'seen_m2': 'space seen, m2',
    'f1': 'F1 at 0.5, traditional map',
}
AT_END = {'border_f1': 'F1 at 0.5, border map', 'stops': 'stops'}

NOTES = [
    '+- are standard errors over buildings: runs of one are alike. Differences to `traditional '
    'map` are paired by building and seed: the same start, the same lidar.',
    'Cells that were never measured count as free in F1: half a map misses the other half.',
]


class Visited(NamedTuple):
    """A scan from a stop and how far the robot has driven by then, m."""

    placed: PlacedScan
    driven_m: float


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Five seeds in each of ten buildings; quick: two in two."""
    buildings = (2, 8) if quick else tuple(range(1, BUILDINGS + 1))
    numbers = range(1, 3 if quick else SEEDS + 1)
    names = {
        (building, number): f'building{building:02d}_seed{number}'
        for number in numbers
        for building in buildings
    }
    results = run_all(
        folder / 'datasets',
        score,
        {
            f'{name}_{policy.split()[0]}': {
                'building': building,
                'number': number,
                'policy': policy,
                'seed': seed,
            }
            for (building, number), name in names.items()
            for policy in POLICIES
        },
        title='exploration',
        depends_on={
            'lidar': asdict(LIDAR),
            'model': asdict(MODEL),
            'metres': METRES,
            'measures': {**MEASURES, **AT_END},
            'views': [PLACES, BEAMS, PATIENCE_M, WORTHLESS_NATS, UNKNOWN],
            'sweeps': [CHAINS, SETTLING, KEPT, BURN_IN, COUNTED],
            'live': flatten(MapperConfig()),
            'sampler': flatten(RefineSamplerConfig()),
        },
    )
    of_policy = {
        policy: [results[f'{name}_{policy.split()[0]}'] for name in names.values()]
        for policy in POLICIES
    }
    settings = {
        'seed': seed,
        'runs': len(names),
        'buildings': buildings,
        'lidar': asdict(LIDAR),
        'model': asdict(MODEL),
    }
    pictures = _draw(folder, of_policy)
    of = [building for building, _ in names]
    rows = rows_of(of_policy, of)
    with replacing(folder / 'table.md') as file:
        file.write_text(table_of(of_policy, of), encoding='utf-8')
    return {'rows': rows, 'pictures': pictures, 'settings': settings, 'notes': NOTES}


def score(building: int, number: int, policy: str, seed: int) -> dict[str, Any]:
    """Let one robot explore by one policy; judge what it measured on the way."""
    world = generate_floor(building, seed)
    visited = list(_explored(world, policy, (seed, building, number)))
    scans = [one.placed for one in visited]
    found: dict[str, Any] = {what: [] for what in MEASURES}
    for limit in METRES:
        so_far = [one.placed for one in visited if one.driven_m <= limit]
        live = map_of(so_far, MapperConfig(resolution=world.spec.resolution_m))
        area = np.count_nonzero(np.isfinite(live.probability)) * world.spec.resolution_m**2
        found['area_m2'].append(float(area))
        found['seen_m2'].append(_seen_m2(so_far, world))
        found['f1'].append(_f1(live, world))
    ended = border_map(scans, MODEL, world.spec.resolution_m, seed)
    return {
        **found,
        'border_f1': _f1(ended, world),
        'stops': len(visited),
        'driven_m': visited[-1].driven_m,
    }


def _explored(world: GridWorld, policy: str, seed: Sequence[int]) -> Iterator[Visited]:
    """Yield what a robot sees until it has driven the last of `METRES` or nothing is left."""
    way_rng, scan_rng, view_rng, chain_rng = np.random.default_rng(seed).spawn(4)
    cell_m = world.spec.resolution_m
    chain_seed = int(chain_rng.integers(2**31))
    explorer = Explorer(policy, world.spec, MODEL, LIDAR.range_max_m, view_rng, chain_seed)
    settings = Exploration(reach=LIDAR.range_max_m / cell_m, max_stops=1000)
    choose = None if policy == POLICIES[0] else explorer.choose
    bearings, driven = LIDAR.bearings(), 0.0
    for stop in explore(world, settings, way_rng, choose=choose):
        driven += (len(stop.way) - 1) * cell_m
        if driven > METRES[-1]:
            return
        exact = world.ranges(stop.pose, bearings, LIDAR.range_max_m, MODEL.depth)
        placed = PlacedScan.at(LIDAR.scan(LIDAR.observe(exact, scan_rng), 0), stop.pose)
        explorer.take(placed)
        yield Visited(placed, driven)


def _seen_m2(scans: Sequence[PlacedScan], world: GridWorld) -> float:
    """Return the space that an ideal lidar sees from where these scans were taken."""
    places = world.spec.in_cells(np.array([(one.pose.x_m, one.pose.y_m) for one in scans]))
    settings = Exploration(reach=LIDAR.range_max_m / world.spec.resolution_m)
    seen = np.count_nonzero(seen_from(world, settings, places))
    return float(seen * world.spec.resolution_m**2)


def _f1(grid_map: GridMap, world: GridWorld) -> float:
    """Return F1 at 0.5 over all cells that could be measured.

    Not at the best threshold: while most of a building is unmeasured, the best is to call all of
    it occupied.
    """
    seen = world.observable()
    probability = np.nan_to_num(aligned(grid_map, world.truth()), nan=0.0)[seen]
    counts = confusion_counts(probability, world.occupied[seen] == 1, np.array([0.5]))
    return float(counts.f1()[0])


def rows_of(
    of_policy: Mapping[str, Sequence[Mapping[str, Any]]], buildings: Sequence[int]
) -> list[dict[str, Any]]:
    """Return means with standard errors, and paired differences to the traditional map's.

    buildings  of each run, as many runs of each
    """
    of = np.array(buildings)
    measured = [
        (f'{what} after {metres:g} m', [_column(runs, key, k) for runs in of_policy.values()])
        for key, what in MEASURES.items()
        for k, metres in enumerate(METRES)
    ]
    measured += [
        (what, [_column(runs, key) for runs in of_policy.values()]) for key, what in AT_END.items()
    ]
    rows = []
    for what, columns in measured:
        by_policy = dict(zip(of_policy, columns, strict=True))
        for policy, values in by_policy.items():
            mean, error = _over_buildings(values, of)
            gained, of_gain = _over_buildings(values - by_policy[POLICIES[1]], of)
            remark = f'+- {error:.3g}; {gained:+.3g} +- {of_gain:.2g} to {POLICIES[1]}'
            rows.append(row(f'{what}: {policy}', mean, None, remark))
    return rows


def table_of(
    of_policy: Mapping[str, Sequence[Mapping[str, Any]]], buildings: Sequence[int]
) -> str:
    """Return means with standard errors, and all paired differences, as a table of Markdown.

    buildings  of each run, as many runs of each
    """
    of, last = np.array(buildings), len(METRES) - 1
    columns = [
        *((f'space seen after {m:g} m, m2', 'seen_m2', k, 0) for k, m in enumerate(METRES)),
        (f'area covered after {METRES[-1]:g} m, m2', 'area_m2', last, 0),
        (AT_END['border_f1'], 'border_f1', None, 3),
        (AT_END['stops'], 'stops', None, 0),
    ]

    def cells(first: str, second: str | None = None) -> Iterator[str]:
        for _, key, k, digits in columns:
            values = _column(of_policy[first], key, k)
            if second is not None:
                values = values - _column(of_policy[second], key, k)
            mean, error = _over_buildings(values, of)
            sign = '' if second is None else '+'
            yield f'{mean:{sign}.{digits}f} +- {error:.{digits}f}'

    lines = [(policy, *cells(policy)) for policy in of_policy]
    lines += [
        (f'{one} less {other}, paired', *cells(one, other))
        for one, other in combinations((MEAN, SAMPLES, POLICIES[0], LIVE), 2)
    ]
    return markdown_table([('goes by', *(title for title, *_ in columns)), *lines])


def _column(runs: Sequence[Mapping[str, Any]], key: str, k: int | None = None) -> Float64Array:
    return np.array([one[key] if k is None else one[key][k] for one in runs], np.float64)


def _over_buildings(values: Float64Array, buildings: AnyArray) -> tuple[float, float]:
    """Return the mean of runs (R,) and its standard error with buildings (R,) as independent."""
    means = np.array([values[buildings == one].mean() for one in np.unique(buildings)])
    error = means.std(ddof=1) / math.sqrt(means.size) if means.size > 1 else math.nan
    return float(values.mean()), float(error)


def _draw(folder: Path, of_policy: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, str]:
    captions = {}
    for key, what in MEASURES.items():
        curves = [
            Series(
                policy,
                np.array(METRES),
                np.array([_column(runs, key, k).mean() for k in range(len(METRES))]),
            )
            for policy, runs in of_policy.items()
        ]
        save_picture(folder / f'{key}.png', curves_png(curves, 'metres driven', what))
        captions[f'{key}.png'] = f'{what} over metres driven, mean of all runs'
    return captions
