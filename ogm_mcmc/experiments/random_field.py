"""[field] Fig. 2 to 5: a corridor with an open door, seen by five beams of up to nine cells.

The paper gives pictures and no numbers, so the rows say what its text says of the pictures: a
short length scale follows the observations and is noisy, a large variance is smoother; and that
the recursion gives what the linear system gives.
"""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.config import MapperConfig, RandomFieldConfig, StepModelConfig, flatten
from ogm_mcmc.experiments.results import row, save_picture
from ogm_mcmc.experiments.windows import map_in
from ogm_mcmc.geometry import CellBox, Pose2D, PoseBelief, Scan
from ogm_mcmc.mapping.gaussian_field import GaussianField, Prediction, solve_field
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper
from ogm_mcmc.plotting import require_matplotlib
from ogm_mcmc.simulation import Building, rasterised, true_ranges

__all__ = ['corridor', 'observations', 'run']

# All lengths are in cells, as in the paper: the map has cells of 1 m.
WIDTH, HEIGHT = 30, 18
WINDOW = CellBox(0, 0, WIDTH, HEIGHT)
BEAMS, RANGE, NOISE = 5, 9.0, 0.3
LENGTH_SCALES, VARIANCES = (0.5, 1.0, 1.5, 2.0), (0.03, 0.3)
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
        method.update(scan, PoseBelief(pose))
    method.grid.cover(WINDOW)
    truth = map_in(rasterised(building, 1.0), WINDOW).astype(np.float64)
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
    require_matplotlib()
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
    _draw_world(seen, folder / 'fig2.png')
    _draw(
        {'log-odds': seen.log_odds, 'probability': probability(seen.log_odds)},
        folder / 'fig3.png',
    )
    _draw({f'l = {s:g}': probability(fields[s, 0.1].mean) for s in LENGTH_SCALES},
          folder / 'fig4.png')  # fmt: skip
    _draw({f'sigma^2 = {v:g}': probability(fields[2.0, v].mean) for v in VARIANCES},
          folder / 'fig5.png')  # fmt: skip
    _draw({f'l = {s:g}': fields[s, 0.1].variance for s in LENGTH_SCALES},
          folder / 'variance.png')  # fmt: skip
    return {
        'rows': rows,
        'pictures': {
            'fig2.png': '[field] Fig. 2: the map, and where the robot scans',
            'fig3.png': '[field] Fig. 3: observed log-odds and probabilities; grey: not measured',
            'fig4.png': '[field] Fig. 4: predictions with sigma^2 = 0.1 and four length scales',
            'fig5.png': '[field] Fig. 5: predictions with l = 2 and two variances',
            'variance.png': 'Variance of the predictions of Fig. 4, white 0, black 1 (ours)',
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


def _draw_world(seen: Observed, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.8), dpi=100, layout='tight')
    axes = figure.add_subplot()
    extent = (0, WIDTH, 0, HEIGHT)
    axes.imshow(seen.truth == 1.0, origin='lower', cmap='Greys', extent=extent)
    axes.plot(*seen.way.T, 'r.-', linewidth=1.0)
    for (x, y), label in ((seen.way[0], '1'), (seen.way[-1], '2')):
        axes.text(x, y + 0.6, label, color='red')
    stream = io.BytesIO()
    figure.savefig(stream, format='png')
    save_picture(path, stream.getvalue())


def _draw(grids: dict[str, AnyArray], path: Path) -> None:
    """Grids side by side: probabilities and variances from white 0 to black 1."""
    from matplotlib.figure import Figure

    rows = (len(grids) + 1) // 2
    figure = Figure(figsize=(8.0, 2.8 * rows), dpi=100, layout='tight')
    for place, (title, values) in enumerate(grids.items()):
        axes = figure.add_subplot(rows, 2, place + 1, facecolor='#bec6d0')
        top = 1.0 if title != 'log-odds' else float(np.nanmax(np.abs(values)))
        low = 0.0 if title != 'log-odds' else -top
        image = axes.imshow(values, origin='lower', cmap='Greys', vmin=low, vmax=top)
        axes.set_title(title)
        figure.colorbar(image, ax=axes, shrink=0.8)
    stream = io.BytesIO()
    figure.savefig(stream, format='png')
    save_picture(path, stream.getvalue())
