"""Refined maps beside live ones against the truth: buildings, an office, images of real maps.

Every world is driven through once and mapped twice, of all beams and of one of 20, by the live map
and as `~/refine` does, with its defaults, until the chains agree. Judged are the cells that the
live map measured. Images are mapped with a prior that was learned from the others.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.config import StopConfig
from ogm_mcmc.config.nodes import NodeWindowConfig, RefineSamplerConfig
from ogm_mcmc.config.settings import flatten
from ogm_mcmc.engine.prior_files import default_prior_file
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.warm_up import warm_up_sampling
from ogm_mcmc.evaluation import ForwardModel, aligned, beam_log_likelihood
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.lab.experiments.datasets import digest_of, run_all
from ogm_mcmc.lab.experiments.leaderboard import JUDGE, UNKNOWN
from ogm_mcmc.lab.experiments.results import row
from ogm_mcmc.lab.experiments.scoring import against_cells
from ogm_mcmc.lab.experiments.true_worlds import (
    BUILDING_SEED,
    BUILDINGS,
    CELL_M,
    LIDAR,
    OFFICE,
    ROBOT_RADIUS_M,
    drive_through,
    image_of,
    images,
    prior_without,
)

__all__ = ['FIGURES', 'STRIDES', 'ahead', 'run', 'score', 'table_of']

# One of so many beams of every scan.
STRIDES: tuple[int, ...] = (20, 1)

# Chains that do not agree by then are stopped.
MOST_SWEEPS = 400

# By beams half way between those that are mapped, of every so many-th scan.
JUDGING_STEP = 3

# Name, what it is called, digits, whether more is better.
FIGURES = (
    ('best_f1', 'best F1', 3, True),
    ('f1', 'F1 at 0.5', 3, True),
    ('roc_area', 'ROC area', 4, True),
    ('brier', 'Brier', 4, False),
    ('calibration_error', 'calibration error', 4, False),
)

NOTES = [
    'Both maps are of the same beams and judged in the cells that the live map measured; sampling '
    f'ends when the chains agree, or after {MOST_SWEEPS} sweeps. Time is of processors until '
    'then, index included, kernels loaded.',
    'Nats are of beams half way between those that are mapped, of every third scan, where one of '
    '20 is.',
]


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Map all worlds with all and with few beams; quick: the smallest building, few beams."""
    names, strides = [*BUILDINGS, OFFICE, *images()], STRIDES
    if quick:
        names, strides = [BUILDINGS[-1]], (STRIDES[0],)
    # What is missing is said before the work.
    shown = {
        name: digest_of(image_of(name).states.tobytes()) for name in images() if name in names
    }
    parts = run_all(
        folder / 'datasets',
        score,
        {
            f'{name}_{stride}': {'name': name, 'stride': stride, 'seed': seed}
            for stride in strides
            for name in names
        },
        title='refined-truth',
        depends_on={
            'sampler': flatten(RefineSamplerConfig()),
            'stop': [MOST_SWEEPS, asdict(StopConfig())],
            'prior': digest_of(default_prior_file().read_bytes()),
            'images': shown,
            'worlds': [BUILDING_SEED, CELL_M, ROBOT_RADIUS_M, asdict(LIDAR)],
            'judge': [str(JUDGE), JUDGING_STEP, UNKNOWN],
        },
    )
    entries = list(parts.values())
    with replacing(folder / 'table.md') as file:
        file.write_text(table_of(entries), encoding='utf-8')
    better, of = ahead(entries)
    rows = [row('figures in which refined is ahead of live', better, None, f'of {of}')]
    rows += [
        row(
            f'{_called(entry)}: {called}',
            round(entry['refined'][figure], digits),
            None,
            f'live {entry["live"][figure]:.{digits}f}',
        )
        for entry in entries
        for figure, called, digits, _ in FIGURES
    ]
    settings = {'seed': seed, 'most sweeps': MOST_SWEEPS, 'judge': str(JUDGE)}
    return {'rows': rows, 'entries': entries, 'settings': settings, 'notes': NOTES}


def score(name: str, stride: int, seed: int) -> dict[str, Any]:
    """Drive through one world, map one of so many beams both ways, judge both maps."""
    drive = drive_through(name, seed)
    with tempfile.TemporaryDirectory() as folder:
        prior = str(prior_without(name, Path(folder) / f'{name}.npz')) if name in images() else ''
        config = _config(drive.cell_m, prior, seed)
        warm_up_sampling(config)  # reads the prior, too
        mapped = [scan.thinned(stride) for scan in drive.scans]
        began = time.process_time()
        refinement = Refinement(config)
        refinement.take(mapped)
        stop = StopConfig(max_sweeps=MOST_SWEEPS, max_time=1e6)
        *_, progress = refinement.run(stop)
        seconds = time.process_time() - began
    live, refined = refinement.guess, refinement.map()
    measured = np.isfinite(aligned(live, drive.truth))
    solid = drive.truth.probability[measured] >= 0.5

    def judged(grid_map: GridMap) -> dict[str, float]:
        of = np.nan_to_num(aligned(grid_map, drive.truth)[measured], nan=refinement.prior)
        return against_cells(of.astype(np.float64), solid)

    return {
        'world': name,
        'stride': stride,
        'scans': len(mapped),
        'rays': refinement.size.n_rays,
        'chains': progress.chains,
        'sweeps': progress.sweeps,
        'counted': progress.counted,
        'agreed': progress.reason == 'converged',
        'sigma_m': refinement.beams.model.sigma_m,
        'seconds': round(seconds, 2),
        'cells': int(measured.sum()),
        'live': judged(live),
        'refined': judged(refined),
        'nats': _nats(drive.scans, stride, (live, refined)),
    }


def _config(cell_m: float, prior_file: str, seed: int) -> RefineSamplerConfig:
    """Return the defaults of `~/refine`, for cells of this size."""
    defaults = RefineSamplerConfig()
    return replace(
        defaults,
        window=NodeWindowConfig(resolution=cell_m, no_return='clear'),
        chain=replace(defaults.chain, seed=seed),
        patch=replace(defaults.patch, prior_file=prior_file),
    )


def _nats(
    scans: Sequence[PlacedScan], stride: int, maps: Iterable[GridMap]
) -> dict[str, float] | None:
    """Return what beams between those that are mapped say of the live and the refined map.

    Nats a beam, and the standard error of the difference, beam by beam; None where all are mapped.
    """
    if stride == 1:
        return None
    between = [_from(scan, stride // 2).thinned(stride) for scan in scans[::JUDGING_STEP]]
    judge = ForwardModel.from_config(JUDGE)
    live, refined = (beam_log_likelihood(one, between, judge, prior=UNKNOWN) for one in maps)
    return {
        'live': float(live.mean()),
        'refined': float(refined.mean()),
        'error_of_difference': float((refined - live).std(ddof=1) / np.sqrt(live.size)),
        'beams': live.size,
    }


def _from(placed: PlacedScan, first: int) -> PlacedScan:
    """Return a scan without its first beams."""
    scan = placed.scan
    ahead_rad = scan.angle_min_rad + first * scan.angle_increment_rad
    return placed._replace(
        scan=replace(scan, ranges_m=scan.ranges_m[first:], angle_min_rad=ahead_rad)
    )


def ahead(entries: Iterable[Mapping[str, Any]]) -> tuple[int, int]:
    """Return in how many figures the refined map is at least as good as the live one, of how many.

    As they are, not as they are rounded in the table.
    """
    better = [
        (entry['refined'][figure] >= entry['live'][figure])
        if more
        else (entry['refined'][figure] <= entry['live'][figure])
        for entry in entries
        for figure, _, _, more in FIGURES
    ]
    return sum(better), len(better)


def table_of(entries: Iterable[Mapping[str, Any]]) -> str:
    """Return the table, live / refined, as Markdown."""
    head = ['', 'rays', 'chains', 'sigma found, m', 'processor time, s']
    head += [called for _, called, _, _ in FIGURES] + ['nats a beam between']
    lines = [_line(head), _line(['---'] * len(head))]
    for entry in entries:
        live, refined, nats = entry['live'], entry['refined'], entry['nats']
        seconds = f'{entry["seconds"]:.1f}' + ('' if entry['agreed'] else ', not agreed')
        cells = [_called(entry), entry['rays'], entry['chains'], f'{entry["sigma_m"]:.3f}']
        cells += [seconds]
        cells += [f'{live[name]:.{d}f} / {refined[name]:.{d}f}' for name, _, d, _ in FIGURES]
        cells += ['' if nats is None else f'{nats["live"]:.2f} / {nats["refined"]:.2f}']
        lines.append(_line(cells))
    return '\n'.join(lines) + '\n'


def _line(cells: Iterable[Any]) -> str:
    return f'| {" | ".join(map(str, cells))} |'.replace('|  |', '| |')


def _called(entry: Mapping[str, Any]) -> str:
    name = entry['world']
    name = f'`{name}`' if name in images() else name.replace('-', ' ')
    share = 'all' if entry['stride'] == 1 else f'one of {entry["stride"]}'
    return f'{name}, {share} beams'
