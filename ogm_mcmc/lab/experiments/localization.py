"""What a localizer gains by honest maps ([gibbs] section V, [patch] section V).

Maps come from the even scans of a log, all of their beams or a share, and a particle filter with
odometry places the odd ones in them. It reads each map in all ways there are
(`localization_maps.READERS`). Judged are the error of its mean pose, how often it is lost (1 m or
half a radian off: it starts anew at the reference, so each loss counts once and is in no error),
and whether it finds back from a start that is 1.5 m and 0.6 rad wrong, with a belief of 1 m and
0.5 rad.

Runs of a log differ in which beams are mapped, in the chains and in the filter's noise. Standard
errors are over runs: they say nothing of other buildings, for which there are several logs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.config import MapperConfig, TrajectoryConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.config.settings import flatten
from ogm_mcmc.engine.kept_samples import MOST_SAMPLES
from ogm_mcmc.evaluation.scan_fit import NAV2
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import Pose2D, wrap_angle
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.localization_logs import (
    DRIVING,
    INTEL_WHEELS,
    LIDAR,
    LOGS,
    MOST_SCANS,
    RECORDED,
    Log,
    Poses,
    check_data,
    log_of,
    reference_of,
)
from ogm_mcmc.lab.experiments.localization_maps import (
    BURN_IN,
    CHAINS,
    FIT_MODEL,
    MEAN,
    POWER,
    READERS,
    SAMPLES,
    SWEEPS_BETWEEN,
    THREE,
    UNKNOWN,
    maps_of,
    readers_of,
    some_beams,
)
from ogm_mcmc.lab.experiments.localization_table import tables_of
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.plotting import Series, curves_png
from ogm_mcmc.simulation import (
    OdometryNoise,
    ParticleFilter,
    ParticleFilterSettings,
    ScanFit,
    motion_between,
)
from ogm_mcmc.trajectory.points import poses_of

__all__ = ['SHARES', 'recover', 'run', 'score', 'track']

SHARES = (1.0, 0.25, 0.05, 0.01)
RUNS = 5

LOST_M, LOST_RAD = 1.0, 0.5
TRACKING = ParticleFilterSettings(particles=200, beams=30)

# A wrong start, and when the filter is back.
OFF_M, OFF_RAD = 1.5, 0.6
SEARCHING = ParticleFilterSettings(particles=400, beams=30, spread_m=1.0, spread_rad=0.5)
TRIALS, SCANS_TO_RECOVER = 8, 8
FOUND_M, FOUND_RAD = 0.5, 0.3

# Quick: the first scans of a log, and fewer wrong starts.
QUICK_SCANS, QUICK_TRIALS = 100, 4

NOTES = [
    'Errors are mean distances to the reference of scans while not lost; +- are standard errors '
    'over runs. Lost: times a run. Found: shares of wrong starts.',
    'Logs of Intel (Dirk Haehnel) and Freiburg 101 (Cyrill Stachniss): Radish, CC-BY. Their '
    'references are joint poses of all scans, about 2 cm off; buildings have the truth.',
    "likelihood_field and beam weigh by nav2's defaults, 1 + sum of p^3, made for a scan every "
    '0.25 m, where these logs have one every metre or two; all others take the product over beams '
    'to a power. So compare maps within a model first.',
]


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Five runs of five logs, four shares of beams; quick: two of a short one, two shares."""
    logs, shares, runs = (LOGS[2:3], SHARES[1::2], 2) if quick else (LOGS, SHARES, RUNS)
    short = {'scans': QUICK_SCANS, 'trials': QUICK_TRIALS} if quick else {}
    check_data(logs)  # what is missing is said before hours have gone by
    references = _references(folder, [log for log in logs if log in RECORDED], seed)
    results = run_all(
        folder / 'datasets',
        score,
        {
            f'{log}_{share:g}_run{number}': {
                'log': log,
                'share': share,
                'number': number,
                'seed': seed,
                **references.get(log, {}),
                **short,
            }
            for number in range(1, runs + 1)
            for log in logs
            for share in shares
        },
        title='localization',
        depends_on={
            'tracking': asdict(TRACKING),
            'searching': asdict(SEARCHING),
            'lost': [LOST_M, LOST_RAD],
            'wrong': [OFF_M, OFF_RAD, TRIALS, SCANS_TO_RECOVER, FOUND_M, FOUND_RAD],
            'model': asdict(FIT_MODEL),
            'power': POWER,
            'unknown': UNKNOWN,
            'sweeps': [CHAINS, BURN_IN, SWEEPS_BETWEEN, MOST_SAMPLES],
            'shown': 'known_map',
            'amcl': NAV2._asdict(),
            'live': flatten(MapperConfig()),
            'sampler': flatten(RefineSamplerConfig()),
            'poses': flatten(TrajectoryConfig()),
            'wheels': [asdict(INTEL_WHEELS), asdict(OdometryNoise())],
            'drive': [asdict(LIDAR), asdict(DRIVING), MOST_SCANS],
        },
    )
    rows: list[dict[str, Any]] = []
    pictures: dict[str, str] = {}
    found = {
        log: {
            share: [results[f'{log}_{share:g}_run{k}'] for k in range(1, runs + 1)]
            for share in shares
        }
        for log in logs
    }
    with replacing(folder / 'table.md') as file:
        file.write_text(tables_of(found), encoding='utf-8')
    for log, of_log in found.items():
        for share in shares:
            rows += [_row(log, share, reader, of_log[share]) for reader in READERS]
            rows += [_less(log, share, reader, THREE, of_log[share]) for reader in (MEAN, SAMPLES)]
        pictures |= _draw(folder, log, of_log)
    settings = {
        'seed': seed,
        'runs': runs,
        **short,
        'tracking': asdict(TRACKING),
        'searching': asdict(SEARCHING),
        'lost': f'{LOST_M:g} m or {LOST_RAD:g} rad',
        'model': asdict(FIT_MODEL),
        'power': POWER,
        'unknown': UNKNOWN,
    }
    return {'rows': rows, 'pictures': pictures, 'settings': settings, 'notes': NOTES}


def _references(folder: Path, logs: Sequence[str], seed: int) -> dict[str, dict[str, Poses]]:
    """Return the argument `reference` of each recorded log: its joint poses, estimated once."""
    if not logs:
        return {}
    found = run_all(
        folder / 'datasets',
        reference_of,
        {f'reference_{log}': {'log': log, 'seed': seed} for log in logs},
        title='joint poses',
        depends_on={'poses': flatten(TrajectoryConfig())},
    )
    return {log: {'reference': found[f'reference_{log}']['poses']} for log in logs}


def score(
    log: str,
    share: float,
    number: int,
    seed: int,
    reference: Poses | None = None,
    scans: int | None = None,
    trials: int | None = None,
) -> dict[str, Any]:
    """Map half of a log with a share of its beams and localize the other half in every way.

    reference  the joint poses of a recorded log, see `log_of`
    scans      so many of the first ones; None: all
    trials     wrong starts; None: `TRIALS`
    """
    taken = log_of(log, seed, reference).first(scans)
    rng = np.random.default_rng((seed, number, round(1000 * share)))
    placed = some_beams(taken.placed(slice(0, None, 2)), share, rng)
    maps = maps_of(placed, taken.resolution_m, seed + number)
    filter_seed, starts = int(rng.integers(2**32)), trials or TRIALS
    return {
        reader: {
            **track(taken, fit, power, np.random.default_rng(filter_seed)),
            'found': recover(taken, fit, power, np.random.default_rng(filter_seed), starts),
        }
        for reader, (fit, power) in readers_of(maps).items()
    }


def track(
    log: Log, fit: ScanFit, power: float, rng: np.random.Generator
) -> dict[str, float | None]:
    """Follow a log scan by scan: mean errors, m and degrees, while not lost, and times lost.

    Who was lost at every scan has no errors: None.
    """
    poses, told = poses_of(log.reference), poses_of(log.odometry)
    filtering = ParticleFilter(fit, replace(TRACKING, power=power), log.noise, rng)
    filtering.start(poses[1])
    errors, lost = [], 0
    for k in range(2, len(poses)):
        filtering.move(motion_between(told[k - 1], told[k]))
        if k % 2 == 0:
            continue
        filtering.weigh(log.scans[k])
        off = _off(filtering.belief().mean, poses[k])
        if off[0] > LOST_M or off[1] > LOST_RAD:
            lost += 1
            filtering.start(poses[k])
        else:
            errors.append(off)
    if not errors:
        return {'error_m': None, 'error_deg': None, 'lost': lost}
    away, turned = np.mean(errors, axis=0)
    return {'error_m': float(away), 'error_deg': math.degrees(turned), 'lost': lost}


def recover(log: Log, fit: ScanFit, power: float, rng: np.random.Generator, trials: int) -> float:
    """Return the share of wrong starts, all along a log, from which the filter finds back."""
    poses, told = poses_of(log.reference), poses_of(log.odometry)
    starts = np.linspace(1, len(poses) - 1 - 2 * SCANS_TO_RECOVER, trials).astype(int) | 1
    found = 0
    for first in starts:
        filtering = ParticleFilter(fit, replace(SEARCHING, power=power), log.noise, rng)
        filtering.start(_wrong(poses[first], rng))
        filtering.weigh(log.scans[first])
        last = min(first + 2 * SCANS_TO_RECOVER, len(poses) - 1)
        for k in range(first + 1, last + 1):
            filtering.move(motion_between(told[k - 1], told[k]))
            if k % 2 == 1:
                filtering.weigh(log.scans[k])
        away, turned = _off(filtering.belief().mean, poses[last])
        found += away < FOUND_M and turned < FOUND_RAD
    return found / trials


def _wrong(pose: Pose2D, rng: np.random.Generator) -> Pose2D:
    where, side = rng.uniform(-math.pi, math.pi), rng.choice((-1.0, 1.0))
    return Pose2D(
        pose.x_m + OFF_M * math.cos(where),
        pose.y_m + OFF_M * math.sin(where),
        wrap_angle(pose.yaw_rad + side * OFF_RAD),
    )


def _off(found: Pose2D, true: Pose2D) -> tuple[float, float]:
    away = math.hypot(found.x_m - true.x_m, found.y_m - true.y_m)
    return away, abs(wrap_angle(found.yaw_rad - true.yaw_rad))


class Mean(NamedTuple):
    """Mean of runs and its standard error; None where there were no runs, or one."""

    value: float | None
    error: float | None

    def said(self) -> str:
        """Return both as text."""
        return f'{_shown(self.value, 2)} +- {_shown(self.error, 2)}'


def _shown(value: float | None, digits: int) -> str:
    return '-' if value is None else f'{value:.{digits}f}'


def _with_error(values: Sequence[float | None]) -> Mean:
    """Return the mean of runs without those that were lost all the time."""
    known = np.array([value for value in values if value is not None])
    if known.size == 0:
        return Mean(None, None)
    spread = float(known.std(ddof=1)) / math.sqrt(known.size) if known.size > 1 else None
    return Mean(float(known.mean()), spread)


def _row(log: str, share: float, reader: str, runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    of = {
        what: _with_error([one[reader][what] for one in runs])
        for what in ('error_m', 'error_deg', 'lost', 'found')
    }
    remark = (
        f'+- {_shown(of["error_m"].error, 3)}; {of["error_deg"].said()} degrees; '
        f'lost {of["lost"].said()}; found {of["found"].said()}'
    )
    return row(f'{log}, {100 * share:g} %: {reader}, m', of['error_m'].value, None, remark)


def _less(
    log: str, share: float, reader: str, other: str, runs: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the row of a difference, paired by run: the same beams, chains and noise."""
    pairs = [(one[reader]['error_m'], one[other]['error_m']) for one in runs]
    gap = _with_error([a - b for a, b in pairs if a is not None and b is not None])
    return row(
        f'{log}, {100 * share:g} %: {reader} less {other}, m',
        gap.value,
        None,
        f'+- {_shown(gap.error, 3)}, paired by run',
    )


def _draw(
    folder: Path, log: str, of_log: Mapping[float, Sequence[Mapping[str, Any]]]
) -> dict[str, str]:
    """Draw times lost over the share of beams."""
    shares = sorted(of_log)
    curves = [
        Series(
            reader,
            np.log10(100.0 * np.array(shares)),
            np.array([np.mean([one[reader]['lost'] for one in of_log[s]]) for s in shares]),
        )
        for reader in READERS
    ]
    name = f'{log}.png'
    save_picture(folder / name, curves_png(curves, 'log10 of the share of beams, %', 'times lost'))
    return {name: f'{log}: times lost a run'}
