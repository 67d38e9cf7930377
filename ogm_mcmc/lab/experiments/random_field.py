"""[field] Fig. 2 to 5: a corridor with an open door, seen by five beams of up to nine cells.

The paper gives pictures and no numbers, so the rows say what its text says of the pictures: a
short length scale follows the observations and is noisy, a large variance is smoother; and that
the recursion gives what the linear system gives.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.config import MapperConfig, RandomFieldConfig, StepModelConfig, flatten
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, Scan
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.mapping.gaussian_field import GaussianField, Prediction, solve_field
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper
from ogm_mcmc.plotting import Grid, Scale, Series, grids_png
from ogm_mcmc.simulation import Building, rasterised, true_ranges

__all__ = ['corridor', 'observations', 'run']

# All lengths are in cells, as in the paper: the map has cells of 1 m.
WIDTH, HEIGHT = 30, 18
WINDOW = CellBox(0, 0, WIDTH, HEIGHT)
BEAMS, RANGE, NOISE = 5, 9.0, 0.3
LENGTH_SCALES, VARIANCES = (0.5, 1.0, 1.5, 2.0), (0.03, 0.3)
EXTENT = (0.0, float(WIDTH), 0.0, float(HEIGHT))

# One wall is 9; where beams cross each other, cells come to sixty.
LOG_ODDS = Scale('log-odds, nats', -20.0, 20.0, 'BrBG_r')
VARIANCE, WALL = Scale('variance, nats^2'), Scale('occupied')
CONFIG = MapperConfig(
    resolution=1.0,
    fusion='per_beam',
    log_odds_limit=1000.0,
    step=StepModelConfig(l_free=-7.0, l_occ=9.0),
)


class Observed(NamedTuple):
    """Log-odds of measured cells, the true map, the way of the robot; nan: not known."""

    log_odds: Float64Array
    truth: Float64Array
    way: Float64Array


def corridor() -> Building:
    """Return a corridor five cells wide; a door of four cells in its upper wall stands open."""
    walls = [
        (0.5, 2.5, WIDTH - 0.5, 2.5),
        (0.5, 8.5, 13.5, 8.5),
        (18.5, 8.5, WIDTH - 0.5, 8.5),
        (0.5, 2.5, 0.5, 8.5),
        (WIDTH - 0.5, 2.5, WIDTH - 0.5, 8.5),
        # The leaf of the door, turned into the room behind it.
        (13.5, 8.5, 13.5, 12.5),
        # The room.
        (8.5, 8.5, 8.5, 16.5),
        (8.5, 16.5, 23.5, 16.5),
        (23.5, 8.5, 23.5, 16.5),
    ]
    return Building(np.array(walls), np.array([(2.5, 5.5), (WIDTH - 3.5, 5.5)]))


def observations(seed: int, step: float = 1.0) -> Observed:
    """Drive from one end to the other and look at 0, +-45 and +-90 degrees ([field] IV)."""
    building, rng = corridor(), np.random.default_rng(seed)
    (start, y), (end, _) = building.waypoints
    way = np.array([(x, y) for x in np.arange(start, end + 0.5 * step, step)])
    bearings = np.linspace(-0.5 * math.pi, 0.5 * math.pi, BEAMS)
    method = TwoAssumptionMapper(CONFIG)
    for x, _ in way:
        pose = Pose2D(float(x), float(y))
        ranges = true_ranges(building.walls, pose, bearings) + rng.normal(0.0, NOISE, BEAMS)
        scan = Scan.checked(
            np.where(ranges > RANGE, np.inf, ranges),
            angle_min_rad=float(bearings[0]),
            angle_increment_rad=float(bearings[1] - bearings[0]),
            range_min_m=0.0,
            range_max_m=RANGE,
        )
        method.update(PlacedScan.at(scan, pose))
    method.grid.cover(WINDOW)
    truth = rasterised(building, 1.0).windowed(WINDOW).probability.astype(np.float64)
    return Observed(method.log_odds(WINDOW).astype(np.float64), truth, way)


def predicted(observed: Float64Array, config: RandomFieldConfig) -> Prediction:
    """The field by the recursion, with nothing dropped."""
    field = GaussianField(observed.shape[0], observed.shape[1], config, radius=max(observed.shape))
    field.observe(observed)
    return Prediction(field.mean, field.variance())


def roughness(mean: Float64Array) -> float:
    """Root mean square difference of neighbouring cells, nats."""
    steps = np.concatenate((np.diff(mean, axis=0).ravel(), np.diff(mean, axis=1).ravel()))
    return float(np.sqrt(np.mean(steps**2)))


def probability(log_odds: AnyArray) -> Float64Array:
    """Occupancy probability of log-odds; nan stays nan."""
    values: Float64Array = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -700.0, 700.0)))
    return values


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Observe, predict with every parameter of the paper, compare, draw."""
    seen = observations(seed, 2.0 if quick else 1.0)
    settings = {
        (scale, variance): replace(CONFIG.random_field, length_scale=scale, variance=variance)
        for scale, variance in [*((s, 0.1) for s in LENGTH_SCALES), *((2.0, v) for v in VARIANCES)]
    }
    fields = {key: predicted(seen.log_odds, config) for key, config in settings.items()}
    rows = [
        row('measured cells', int(np.isfinite(seen.log_odds).sum()), None, f'of {WIDTH * HEIGHT}')
    ]
    for (scale, variance), field in fields.items():
        rows += _rows(seen, field, settings[scale, variance])
    _draw_world(folder / 'fig2.png', seen)
    by_scale = {f'l = {s:g}': fields[s, 0.1] for s in LENGTH_SCALES}
    by_variance = {f'sigma^2 = {v:g}': fields[2.0, v] for v in VARIANCES}
    _draw(
        folder / 'fig3.png',
        [
            Grid(seen.log_odds, EXTENT, LOG_ODDS, '(a) log-odds'),
            Grid(probability(seen.log_odds), EXTENT, title='(b) probability'),
        ],
    )
    for name, predictions in (('fig4.png', by_scale), ('fig5.png', by_variance)):
        _draw(
            folder / name,
            (Grid(probability(one.mean), EXTENT, title=of) for of, one in predictions.items()),
        )
    _draw(
        folder / 'variance.png',
        (Grid(one.variance, EXTENT, VARIANCE, of) for of, one in by_scale.items()),
    )
    return {
        'rows': rows,
        'pictures': {
            'fig2.png': '[field] Fig. 2: the map, and where the robot scans',
            'fig3.png': '[field] Fig. 3: observed log-odds, probabilities; bluish: not measured',
            'fig4.png': '[field] Fig. 4: predictions with sigma^2 = 0.1 and four length scales',
            'fig5.png': '[field] Fig. 5: predictions with l = 2 and two variances',
            'variance.png': 'Variance of the predictions of Fig. 4 (ours)',
        },
        'settings': {**flatten(CONFIG), 'beams': BEAMS, 'range': RANGE, 'noise': NOISE},
        'notes': [
            'The paper shows pictures only. Size of the map and noise are not given: ours are '
            f'{WIDTH} x {HEIGHT} cells and {NOISE:g} cells.',
            'Roughness is the root mean square difference of neighbouring cells: it falls with '
            'the length scale and with the variance, as the paper says of Fig. 4 and 5.',
            'Not measured, right: of the cells inside the walls that no beam crossed and whose '
            'variance is below 0.9, those on the right side of probability 0.5.',
        ],
    }


def _rows(seen: Observed, field: Prediction, config: RandomFieldConfig) -> list[dict[str, Any]]:
    name = f'l = {config.length_scale:g}, sigma^2 = {config.variance:g}'
    solved = solve_field(seen.log_odds, config)
    error = max(
        float(np.abs(field.mean - solved.mean).max()),
        float(np.abs(field.variance - solved.variance).max()),
    )
    believed = np.isnan(seen.log_odds) & np.isfinite(seen.truth) & (field.variance < 0.9)
    right = (field.mean > 0.0) == (seen.truth == 1.0)
    share = float(right[believed].mean()) if believed.any() else math.nan
    return [
        row(f'{name}: recursion against Eq. 21', f'{error:.1e}', None, 'largest difference, nats'),
        row(f'{name}: roughness', round(roughness(field.mean), 3), None, 'nats'),
        row(
            f'{name}: not measured, right',
            round(share, 3) if believed.any() else None,
            None,
            f'of {int(believed.sum())} cells',
        ),
    ]


def _draw(path: Path, grids: Iterable[Grid]) -> None:
    save_picture(path, grids_png(list(grids), 'x, m', 'y, m', columns=2, side=300))


def _draw_world(path: Path, seen: Observed) -> None:
    x, y = seen.way.T
    marks = (
        Series('the robot scans', x, y, 'C3.-'),
        Series('1, start', x[:1], y[:1], 'C3o'),
        Series('2, end', x[-1:], y[-1:], 'C3s'),
    )
    walls = np.nan_to_num(seen.truth)
    world = Grid(walls, EXTENT, WALL, marks=marks)
    save_picture(path, grids_png([world], 'x, m', 'y, m'))
