"""Maps with and without pose uncertainty from real particles ([pose] section VII).

MIT CSAIL, the full output of GMapping: for every scan the thirty particles it believed in at the
time. The traditional map takes the likeliest particle of each scan, as in [pose] Fig. 5 (a);
`pose_uncertain` takes all of them with their weights. Both are judged by what neither knew at the
time: the trajectory of the best particle at the end, loops closed. From it come a benchmark map
(for ROC curves as in Fig. 4 (a)) and the poses of held-out scans (for the log-likelihood of
their beams, which needs no benchmark).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import MapperConfig, flatten
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.evaluation import (
    aligned,
    beam_log_likelihood,
    brier_score,
    confusion_counts,
)
from ogm_mcmc.geometry import CellBox, GridMap, PlacedScan, Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.io.gmapping import best_trajectory
from ogm_mcmc.lab.experiments.recordings import RANGE_MAX_M, as_scan, data_folder
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.plotting import Grid, Series, curves_png, grids_png

__all__ = ['run']

LOG = Path('csail') / 'csail.corrected.gfs'

# Every so many scans one is held out, and left out of all maps.
HELD_OUT_EVERY = 5

# The judge of held-out beams: a hit with one of these noises, or anything in one beam of ten.
HIT_SIGMAS_M, CLUTTER = (0.05, 0.1, 0.2), 0.1

STYLES = {'step': '-', 'gaussian': '--'}

CLOSE_UP_M, CLOSE_UP_PIXELS = 8.0, 320


NOTES = [
    '[pose] uses the Bicocca log of Rawseeds with a stereo FastSLAM and gives curves but no '
    'numbers, so nothing stands in the column of published values.',
    'Every fifth scan is left out of all maps and judged where the final trajectory puts it. '
    'Beams of one scan share cells; standard errors treat scans as independent.',
    'The benchmark is the traditional map of the final trajectory with the same inverse model.',
    'Log recorded at MIT CSAIL by Cyrill Stachniss (Radish, CC-BY).',
]


class Believed(NamedTuple):
    """A scan placed by the particles of its time, and where it was in the end."""

    placed: PlacedScan
    known: Pose2D

    @property
    def particles(self) -> PoseSamples:
        """What was believed at the time."""
        assert self.placed.belief.particles is not None
        return self.placed.belief.particles

    @property
    def likeliest(self) -> Pose2D:
        """The particle of the greatest weight."""
        return Pose2D(*map(float, self.particles.poses[int(np.argmax(self.particles.weights))]))


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Map CSAIL in every way and compare; `seed` has no effect, nothing is drawn."""
    folder_of_logs = data_folder(LOG, f'OGM_MCMC_DATA to name a folder with {LOG}')
    believed = read_log(folder_of_logs / LOG)
    held_out = believed[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY]
    mapped = [one for k, one in enumerate(believed) if (k + 1) % HELD_OUT_EVERY]
    rows, curves, config = [], [], MapperConfig()
    for model in ('step', 'gaussian'):
        config = MapperConfig(
            resolution=0.1 if quick else 0.05, no_return='ignore', inverse_model=model
        )
        maps = maps_of(config, mapped)
        benchmark = maps.pop('final map')
        found, roc = compare_maps(maps, benchmark, held_out)
        rows += [{**line, 'what': f'{model}: {line["what"]}'} for line in found]
        for k, (name, curve) in enumerate(roc):
            curves.append(Series(f'{name}, {model}', *curve, f'C{k}{STYLES[model]}'))
        if model == 'step':
            draw(folder, maps, benchmark, mapped)
    save_picture(
        folder / 'roc.png',
        curves_png(curves, 'false positive rate', 'true positive rate', x_limits=(0.0, 0.3)),
    )
    spread = [math.sqrt(np.trace(one.particles.covariance()[:2, :2])) for one in believed]
    return {
        'rows': rows,
        'pictures': {
            'roc.png': 'ROC curves against the map of the final trajectory ([pose] Fig. 4 a)',
            'close-up.png': 'Without (a) and with pose uncertainty (b), and the final map, where '
            'the particles are furthest apart ([pose] Fig. 5)',
            'maps.png': 'The whole floor, in the same order',
        },
        'settings': {
            **flatten(config),
            'inverse_model': 'step and gaussian',
            'scans': len(believed),
            'held_out': len(held_out),
            'particles': believed[0].particles.weights.size,
            'clutter': CLUTTER,
            'median_particle_spread_m': float(np.median(spread)),
            'largest_particle_spread_m': float(np.max(spread)),
        },
        'notes': NOTES,
    }


def maps_of(config: MapperConfig, scans: Sequence[Believed]) -> dict[str, GridMap]:
    """Map the scans at the likeliest particle, at the mean, at all, and at the final poses."""
    averaging = replace(config, method='pose_uncertain')
    placed = {
        'likeliest particle': [PlacedScan.at(one.placed.scan, one.likeliest) for one in scans],
        'mean pose': [PlacedScan.at(one.placed.scan, one.placed.pose) for one in scans],
        'all particles': [one.placed for one in scans],
        'final map': [PlacedScan.at(one.placed.scan, one.known) for one in scans],
    }
    return {
        name: map_of(of, averaging if name == 'all particles' else config).cropped()
        for name, of in placed.items()
    }


def compare_maps(
    maps: dict[str, GridMap], benchmark: GridMap, held_out: Sequence[Believed]
) -> tuple[list[dict[str, Any]], list[tuple[str, tuple[Float64Array, Float64Array]]]]:
    """Return the rows of the table and the ROC curves (false, true positive rate) by name."""
    rows, curves = [], []
    counted = np.isfinite(benchmark.probability)
    occupied = benchmark.probability[counted] >= 0.5
    for name, found in maps.items():
        probability = np.nan_to_num(aligned(found, benchmark)[counted], nan=0.5)
        counts = confusion_counts(probability, occupied)
        curves.append((name, (counts.false_positive_rate(), counts.recall())))
        rows += [
            row(f'{name}, ROC area', counts.roc_area()),
            row(f'{name}, best F1', counts.best().f1),
            row(f'{name}, Brier score', float(brier_score(probability, occupied))),
        ]
    for sigma_m in HIT_SIGMAS_M:
        by_scan = {
            name: held_out_likelihood(found, held_out, sigma_m)
            for name, found in {**maps, 'final map': benchmark}.items()
        }
        judge = f'nats per held-out beam, sigma {sigma_m:g} m'
        rows += [
            row(f'{name}, {judge}', float(by_scan[name].mean()), None, error_of(by_scan[name]))
            for name in by_scan
        ]
        gain = by_scan['all particles'] - by_scan['likeliest particle']
        rows.append(row(f'all - likeliest, {judge}', float(gain.mean()), None, error_of(gain)))
    return rows, curves


def read_log(path: Path) -> list[Believed]:
    """Read the scans with their particles and where they were in the end."""
    scans = read_carmen(path).scans
    return [
        Believed(
            PlacedScan(as_scan(scan), PoseBelief(scan.particles.mean(), None, scan.particles)),
            known,
        )
        for scan, known in zip(scans, best_trajectory(scans), strict=True)
        if scan.particles is not None
    ]


def held_out_likelihood(
    grid_map: GridMap, held_out: Sequence[Believed], sigma_m: float
) -> Float64Array:
    """Mean log-likelihood per beam, nats, of each held-out scan at where it was in the end."""

    def log_density(z_m: Float64Array, f_m: Float64Array) -> Float64Array:
        """Log p(z | f), nats per metre: a noisy hit, or clutter anywhere in the range."""
        offset = np.where(np.isfinite(f_m), z_m - f_m, np.inf) / sigma_m
        hit = np.exp(-0.5 * offset**2) / (sigma_m * math.sqrt(2.0 * math.pi))
        return np.asarray(np.log((1.0 - CLUTTER) * hit + CLUTTER / RANGE_MAX_M), np.float64)

    means = []
    for one in held_out:
        placed = PlacedScan.at(one.placed.scan, one.known)
        beams = beam_log_likelihood(grid_map, [placed], log_density, no_return='ignore')
        if beams.size:
            means.append(float(beams.mean()))
    return np.array(means)


def error_of(values: Float64Array) -> str:
    """Return the standard error of a mean of independent values, as a remark."""
    return f'standard error {float(values.std(ddof=1) / math.sqrt(values.size)):.4f}'


def draw(
    folder: Path, maps: dict[str, GridMap], benchmark: GridMap, scans: Sequence[Believed]
) -> None:
    """Write pictures of the maps with and without the particles, and of the final one."""
    shown = {
        '(a) likeliest particle': maps['likeliest particle'],
        '(b) all particles': maps['all particles'],
        'final map': benchmark,
    }
    spec = benchmark.spec
    whole = [window_of(one, spec.box, title) for title, one in shown.items()]
    save_picture(folder / 'maps.png', grids_png(whole, 'x, m', 'y, m', columns=2))
    doubtful = max(scans, key=lambda one: float(np.trace(one.particles.covariance()[:2, :2])))
    half = round(0.5 * CLOSE_UP_M / spec.resolution_m)
    column, row_ = spec.cell_of(doubtful.known.x_m, doubtful.known.y_m)
    column, row_ = column + spec.column0, row_ + spec.row0
    box = CellBox(column - half, row_ - half, column + half, row_ + half)
    x, y = np.concatenate([one.particles.poses[:, :2] for one in scans]).T
    believed = (Series('particles', x, y, 'C0.'),)
    x, y = np.array([(one.known.x_m, one.known.y_m) for one in scans]).T
    known = (Series('final trajectory', x, y, 'C3.'),)
    tiles = [
        window_of(one, box, title, known if one is benchmark else believed)
        for title, one in shown.items()
    ]
    save_picture(
        folder / 'close-up.png', grids_png(tiles, 'x, m', 'y, m', columns=2, side=CLOSE_UP_PIXELS)
    )


def window_of(grid_map: GridMap, box: CellBox, title: str, marks: Sequence[Series] = ()) -> Grid:
    """Return a box of cells of a map, to be drawn."""
    extent = grid_map.spec.windowed(box).extent_m
    return Grid(grid_map.windowed(box).probability, extent, title=title, marks=marks)
