"""Every mapper on recorded logs and generated buildings, at three densities of beams.

Maps are made of even beams: all of them, every fourth, every twentieth. All odd beams judge, where
the localizer was right (the truth of a building, the poses of a log). With joint poses, the even
beams that are mapped also move the poses, and odd beams judge a log at these. Cells that a map
does not know are occupied with the same probability, whoever made it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc import __version__
from ogm_mcmc.arrays import BoolArray, Float64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig, TrajectoryConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.config.sampling import CHAINS_SAID
from ogm_mcmc.config.settings import flatten
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.evaluation import (
    ForwardModel,
    HeldOutBeams,
    aligned,
    beam_log_likelihood,
    held_out_beams,
    held_out_points,
    probability_at,
    score_points,
)
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import GridMap, PlacedScan, Scan
from ogm_mcmc.lab.experiments.contests import (
    FILTER,
    LOGS,
    RUN,
    Contest,
    building_contest,
    log_contest,
)
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.leaderboard_gains import BORDER
from ogm_mcmc.lab.experiments.leaderboard_page import leaderboard_page
from ogm_mcmc.lab.experiments.mappers import (
    BURN_IN,
    MAPPERS,
    SWEEPS,
    WITH_JOINT_POSES,
    Mapped,
    Resources,
)
from ogm_mcmc.lab.experiments.pose_sim import (
    BEAMS,
    DROPOUT,
    FILTERS,
    MAX_STOPS,
    NOISE_M,
    REACH_M,
)
from ogm_mcmc.lab.experiments.results import row
from ogm_mcmc.lab.experiments.scoring import against_cells

__all__ = ['BASE', 'PERCENTS', 'UNKNOWN', 'judging_scans', 'run', 'score', 'thinned']

PERCENTS = {100: 1, 25: 4, 5: 20}
BUILDINGS = 10

# What others are compared with, beam by beam.
BASE = 'two_assumption'

# Of a cell that a map does not know, whoever made the map ([gibbs] section IV).
UNKNOWN = 0.15
JUDGE = ForwardModelConfig(sigma=0.05)
POINT_STEP_M = 0.5

# Quick: so many of the first scans.
QUICK_SCANS = 60

NOTES = [
    'Maps of even beams, odd beams judge. Differences are to `two_assumption` at the same poses, '
    'paired beam by beam; their standard errors take scans as independent.',
    'Joint poses of a log are judged where they are, so figures of fixed and joint poses speak of '
    'maps with their poses. Buildings are judged at the true poses.',
    'Time is of processors, without compiling; memory is the rise of the resident set.',
]


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Map and judge everything; quick: the first scans of Belgioioso and of a building, 25 %."""
    names = [*LOGS, *(f'building-{number}' for number in range(1, BUILDINGS + 1))]
    percents = list(PERCENTS)
    every = {'names': list(names), 'percents': list(percents)}
    if quick:
        names, percents = ['belgioioso', 'building-2'], percents[1:2]
    short = {'scans': QUICK_SCANS} if quick else {}
    for name in names:
        if name in LOGS:
            LOGS[name].path()  # what is missing is said before hours have gone by
    parts = run_all(
        folder / 'datasets',
        score,
        {
            f'{name}_{percent}_{poses}': {
                'name': name,
                'percent': percent,
                'poses': poses,
                'seed': seed,
                **short,
            }
            for percent in percents
            for name in names
            for poses in ('fixed', 'joint')
        },
        title='leaderboard',
        depends_on={
            'mappers': sorted(MAPPERS),
            'judge': str(JUDGE),
            'unknown': UNKNOWN,
            'point_step_m': POINT_STEP_M,
            'sweeps': [SWEEPS, BURN_IN],
            'chains': CHAINS_SAID,
            'live': flatten(MapperConfig()),
            'sampler': flatten(RefineSamplerConfig()),
            'model': asdict(ForwardModelConfig()),
            'poses': flatten(TrajectoryConfig()),
            'filter': [RUN, asdict(FILTERS[FILTER])],
            'logs': 'the trajectory that a SLAM system came to in the end',
            'lidar': [BEAMS, REACH_M, NOISE_M, DROPOUT, MAX_STOPS],
        },
    )
    rows = [
        row(
            f'{entry["data"]}, {entry["percent"]} %, {entry["poses"]} poses, {mapper}: '
            'nats a held-out beam',
            figures['nats'],
            None,
            f'{figures["difference"]:+.3f} +- {figures["difference_error"]:.3f} to {BASE}',
        )
        for entry in parts.values()
        for mapper, figures in entry['mappers'].items()
    ]
    found: dict[str, Any] = {'entries': list(parts.values())}
    page = leaderboard_page(
        {**found, 'version': __version__, 'seed': seed, 'every': every | short}
    )
    with replacing(folder / 'leaderboard.md') as file:
        file.write_text(page, encoding='utf-8')
    return {
        **found,
        'rows': rows,
        'settings': {
            'seed': seed,
            'judge': str(JUDGE),
            'unknown': UNKNOWN,
            'sweeps': SWEEPS,
            'burn_in': BURN_IN,
            'chains': CHAINS_SAID,
            **short,
        },
        'notes': NOTES,
    }


def score(
    name: str, percent: int, poses: str, seed: int, scans: int | None = None
) -> dict[str, Any]:
    """Map one data set with every mapper that takes such poses, and judge the maps.

    `scans`: so many of the first ones map and judge; None: all.
    """
    contest = log_contest(name) if name in LOGS else building_contest(name, seed)
    contest = contest._replace(believed=contest.believed[:scans], judging=contest.judging[:scans])
    believed = [thinned(one, PERCENTS[percent]) for one in contest.believed]
    judging = judging_scans(contest)
    seconds_for_poses = 0.0
    if poses == 'joint':
        watch = Resources()
        refinement = PoseRefinement(believed, TrajectoryConfig(seed=seed))
        for _ in refinement.run():
            pass
        seconds_for_poses = watch.stop().seconds
        believed = refinement.placed()
        if contest.truth is None:
            judging = [
                PlacedScan.at(odd.scan, one.pose)
                for odd, one in zip(judging, believed, strict=True)
            ]
    chosen = WITH_JOINT_POSES if poses == 'joint' else contest.mappers
    maps = {mapper: MAPPERS[mapper](believed, contest, seed) for mapper in chosen}
    return {
        'data': name,
        'percent': percent,
        'poses': poses,
        'scans': len(believed),
        'seconds_for_poses': round(seconds_for_poses, 2),
        'mappers': _judged(contest, maps, judging),
    }


def thinned(placed: PlacedScan, every: int) -> PlacedScan:
    """Return a scan of which only each so many-th even beam says anything."""
    return _beams(placed, 0, 2 * every)


def judging_scans(contest: Contest) -> list[PlacedScan]:
    """Return the scans that judge maps: odd beams at the poses that are held to be right."""
    return [_beams(one, 1, 2) for one in contest.judging]


def _beams(placed: PlacedScan, first: int, step: int) -> PlacedScan:
    scan: Scan = placed.scan
    ranges = np.full_like(scan.ranges_m, np.nan)
    ranges[first::step] = scan.ranges_m[first::step]
    return PlacedScan(replace(scan, ranges_m=ranges), placed.belief)


def _judged(
    contest: Contest, maps: dict[str, Mapped], judging: Sequence[PlacedScan]
) -> dict[str, dict[str, Any]]:
    """Return the figures of each map."""
    beams = held_out_beams(judging, maps[BASE].grid_map.spec, no_return=contest.no_return)
    points = held_out_points(beams, POINT_STEP_M)
    base = _log_likelihood(maps[BASE].grid_map, beams, contest)
    counted = None if contest.truth is None else _measured(contest)
    best = _log_likelihood(maps[BORDER].grid_map, beams, contest) if BORDER in maps else None
    found = {}
    for name, (grid_map, used, chains) in maps.items():
        values = _log_likelihood(grid_map, beams, contest)
        gain = None if best is None else beams.mean(best - values).standard_error
        nats, difference = beams.mean(values), beams.mean(values - base)
        of_points = score_points(points, probability_at(grid_map, points.xy_m, UNKNOWN))
        found[name] = {
            'nats': nats.value,
            'nats_error': nats.standard_error,
            'difference': difference.value,
            'difference_error': difference.standard_error,
            'border_gain_error': gain,
            'points_roc_area': of_points.counts.roc_area(),
            'points_log_loss': of_points.log_loss.value,
            'seconds': round(used.seconds, 3),
            'megabytes': used.megabytes,
            'chains': chains,
            **({} if counted is None else _against_truth(grid_map, contest, counted)),
        }
    return found


def _log_likelihood(grid_map: GridMap, beams: HeldOutBeams, contest: Contest) -> Float64Array:
    return beam_log_likelihood(
        grid_map,
        beams.placed,
        ForwardModel.from_config(JUDGE),
        prior=UNKNOWN,
        no_return=contest.no_return,
    )


def _measured(contest: Contest) -> BoolArray:
    """Return the cells of the truth that count: those that any beam measured, at its true pose."""
    assert contest.truth is not None
    config = MapperConfig(resolution=contest.cell_m, no_return=contest.no_return)
    return np.isfinite(aligned(map_of(contest.judging, config), contest.truth))


def _against_truth(grid_map: GridMap, contest: Contest, counted: BoolArray) -> dict[str, float]:
    assert contest.truth is not None
    values = np.nan_to_num(aligned(grid_map, contest.truth)[counted], nan=UNKNOWN)
    occupied = contest.truth.probability[counted] >= 0.5
    return against_cells(values.astype(np.float64), occupied)
