"""Poses and maps of the ten generated buildings estimated together, judged by what is true.

The robot, its lidar and its particle filters are those of `pose-sim`: likeliest particle, all
particles (`pose_uncertain`) and true poses are as there, joint poses come between, also with the
map of `pose_uncertain` at the covariances they have in the end. With them the share of 95 %
intervals of poses that hold the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import MapperConfig, TrajectoryConfig
from ogm_mcmc.config.settings import flatten
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.evaluation import aligned
from ogm_mcmc.evaluation.trajectories import absolute_errors, coverage
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.hundred_sets import set_names
from ogm_mcmc.lab.experiments.pose_sim import (
    BEAMS,
    DROPOUT,
    FILTERS,
    MAX_STOPS,
    NOISE_M,
    REACH_M,
    likeliest,
    localized,
    mapper_config,
    pooled,
    threshold_counts,
)
from ogm_mcmc.lab.experiments.results import row
from ogm_mcmc.simulation import GridWorld, LocalizedScan, generate_floor
from ogm_mcmc.trajectory.points import poses_of, wrapped, xyyaw

__all__ = ['run', 'score']

LIKELIEST, ALL, JOINT, EXACT = 'likeliest particle', 'pose_uncertain', 'joint', 'true poses'
SPREAD = 'joint, spread over what poses leave open'

NOTES = [
    'Cells that a beam from a true pose measured count, the others do not; errors of poses are '
    'after rigid alignment, coverage is without.',
    'Beams of the simulator end half way through a cell of 10 cm: a wall is a staircase, seen '
    'deeper from the front than from aside. Poses are estimated from smooth surfaces, so this is '
    'their hardest case.',
]


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """One run in each building, the poor filter and the good one; quick: two buildings."""
    names = set_names(runs=1)
    if quick:
        names = {name: chosen for name, chosen in names.items() if chosen[0] in (2, 8)}
    results = run_all(
        folder / 'datasets',
        score,
        {
            f'{name}_{which.split()[0]}': {'building': b, 'run': r, 'which': which, 'seed': seed}
            for which in FILTERS
            for name, (b, r) in names.items()
        },
        title='joint-sim',
        depends_on={
            'filters': {which: asdict(of) for which, of in FILTERS.items()},
            'lidar': [BEAMS, REACH_M, NOISE_M, DROPOUT, MAX_STOPS],
            'map': flatten(mapper_config()),
            'poses': flatten(TrajectoryConfig()),
        },
    )
    rows = []
    for which in FILTERS:
        every = [result for name, result in results.items() if name.endswith(which.split()[0])]
        for method in (LIKELIEST, ALL, JOINT, SPREAD, EXACT):
            counts = pooled(result['methods'][method] for result in every)
            rows.append(row(f'{which}, {method}: best F1', counts.best().f1))
        for method in (LIKELIEST, JOINT):
            errors = [result['errors'][method] for result in every]
            rows += [
                row(f'{which}, {method}: error, m', _mean(errors, 'mean_m')),
                row(f'{which}, {method}: error, degrees', _mean(errors, 'mean_deg')),
            ]
        for k, axis in enumerate(('x', 'y', 'yaw')):
            share = float(np.mean([result['coverage'][k] for result in every]))
            rows.append(row(f'{which}: 95 % intervals of {axis} that hold the truth', share))
        seconds = [result['seconds'] for result in every]
        rows.append(
            row(f'{which}: time for poses, s', float(np.mean(seconds)), None, 'a data set')
        )
    settings = {'data_sets': len(results), 'seed': seed, **asdict(TrajectoryConfig(seed=seed))}
    return {'rows': rows, 'settings': settings, 'notes': NOTES}


def score(building: int, run: int, which: str, seed: int) -> dict[str, Any]:
    """Map one exploration at all poses; return counts, errors and coverage."""
    world = generate_floor(building, seed)
    scans = localized(world, FILTERS[which], np.random.default_rng((seed, building, run, 6)))
    truth = xyyaw([one.truth for one in scans])
    refinement = PoseRefinement([one.placed for one in scans], TrajectoryConfig(seed=seed))
    for progress in refinement.run():
        seconds = progress.seconds
    estimator = refinement.estimator
    poses = {
        LIKELIEST: xyyaw([likeliest(one.placed.belief) for one in scans]),
        JOINT: estimator.poses,
        EXACT: truth,
    }
    spread = np.sqrt(np.diagonal(estimator.covariances(), axis1=1, axis2=2))
    return {
        'methods': _counts(world, scans, poses, refinement.placed()),
        'errors': {name: absolute_errors(found, truth).summary() for name, found in poses.items()},
        'coverage': coverage(wrapped(estimator.poses - truth), spread).tolist(),
        'seconds': seconds,
        'scans': len(scans),
    }


def _counts(
    world: GridWorld,
    scans: Sequence[LocalizedScan],
    poses: dict[str, Float64Array],
    refined: Sequence[PlacedScan],
) -> dict[str, Any]:
    """Return what `pooled` takes, of maps at poses and of those of all particles and `refined`."""
    plain = mapper_config()
    maps = {name: _map(scans, found, plain) for name, found in poses.items()}
    averaging = replace(plain, method='pose_uncertain')
    maps[ALL] = map_of([one.placed for one in scans], averaging)
    maps[SPREAD] = map_of(refined, averaging)
    values = {name: aligned(found, world.truth()) for name, found in maps.items()}
    counted = np.isfinite(values[EXACT])
    occupied = world.occupied[counted] == 1
    methods = {}
    for name, found in values.items():
        probability = np.nan_to_num(found[counted], nan=0.5).astype(np.float64)
        methods[name] = threshold_counts(probability, occupied)
    return methods


def _map(scans: Sequence[LocalizedScan], poses: Float64Array, config: MapperConfig) -> GridMap:
    placed = zip(scans, poses_of(poses), strict=True)
    return map_of([PlacedScan.at(one.placed.scan, pose) for one, pose in placed], config)


def _mean(errors: Sequence[dict[str, float]], what: str) -> float:
    return float(np.mean([one[what] for one in errors]))
