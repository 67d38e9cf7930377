"""Fig. 4 and 5 of [gibbs], and how the chains converge, as pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, Float64Array
from ogm_mcmc.config import StepModelConfig
from ogm_mcmc.evaluation import divergence
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.lab.experiments.hundred_sets import SimulatedSet
from ogm_mcmc.plotting import (
    PROBABILITY,
    Closeup,
    Grid,
    Scale,
    Series,
    curves_png,
    grids_png,
)

__all__ = ['Maps', 'closeups_of', 'convergence_png', 'figure_5', 'reflections', 'sample_png']

# The bars are those of the paper.
COUNT = Scale('count', 0.0, 8.0, 'magma_r')
DIVERGENCE = Scale('divergence, nats', 0.0, 1.0, 'magma_r')
SAMPLE = Scale('occupied')

CLOSEUP_CELLS = 15
FEW_BEAMS = 3
# Chains come and go by some hundred nats; how near they come to their mean says nothing.
NEAR_NATS = 10.0


class Maps(NamedTuple):
    """Probabilities (height, width): the truth, the live map with nan where no beam was, MCMC."""

    truth: Float32Array
    live: Float32Array
    sampled: Float32Array


def sample_png(sample: AnyArray, spec: GridSpec) -> bytes:
    """Draw one map of a chain (Fig. 4), nan where no ray came."""
    return grids_png([Grid(sample, spec.extent_m, SAMPLE)], 'x, m', 'y, m')


def convergence_png(traces: Mapping[float, Float64Array], burn_ins: Mapping[float, int]) -> bytes:
    """Draw how far log posteriors, by prior, are from their later mean.

    Their constants differ from prior to prior, so their values cannot be compared.
    """
    curves, top = [], 0.0
    for colour, (prior, trace) in enumerate(traces.items()):
        away = np.abs(trace - trace[trace.size // 2 :].mean())
        over, top = burn_ins[prior], max(top, float(away.max()))
        ends = np.array([NEAR_NATS, away.max()])
        curves += [
            Series(f'prior {prior:g}', np.arange(1, trace.size + 1), away, f'C{colour}-'),
            Series(f'burn-in: {over} sweeps', np.full(2, over), ends, f'C{colour}:'),
        ]
    label = 'distance of the log posterior from its later mean, nats'
    limits = (NEAR_NATS, 2.0 * top)
    return curves_png(curves, 'sweep', label, y_limits=limits, log_x=True, log_y=True)


def figure_5(
    data: SimulatedSet, maps: Maps, prior: float, floor: float
) -> dict[str, tuple[bytes, str]]:
    """Draw the six panels; return pictures and captions by file name."""
    counts, spec = reflections(data), data.world.spec
    live = np.nan_to_num(maps.live, nan=prior)
    closeups = closeups_of(counts, maps.live, data.world.observable(), data.world.occupied == 0,
                           spec, prior)  # fmt: skip
    grids = {
        'reflections': (counts, COUNT, '(a) beams that ended in a cell'),
        'truth': (maps.truth, PROBABILITY, '(b) ground truth'),
        'two_assumption': (live, PROBABILITY, '(c) two-assumption'),
        'mcmc': (maps.sampled, PROBABILITY, '(d) MCMC Gibbs sampling'),
        'truth_divergence': (
            divergence(maps.truth, maps.sampled, floor), DIVERGENCE, '(e) D(truth, MCMC)'
        ),
        'live_divergence': (
            divergence(maps.sampled, live, floor), DIVERGENCE, '(f) D(MCMC, two-assumption)'
        ),
    }  # fmt: skip
    circles = (
        f'1: a wall with many measurements, 2: cells with none, 3: free cells with one to '
        f'{FEW_BEAMS}'
    )
    panels = {}
    for name, (values, scale, title) in grids.items():
        grid = Grid(np.asarray(values), spec.extent_m, scale, title, closeups=closeups)
        panels[f'{name}.png'] = (
            grids_png([grid], 'x, m', 'y, m'),
            f'Fig. 5 {title}; {circles}',
        )
    return panels


def reflections(data: SimulatedSet) -> Float64Array:
    """Return how often beams ended in each cell (height, width), Fig. 5 (a)."""
    spec = data.world.spec
    counts = np.zeros((spec.height, spec.width))
    for scan, belief in data.scans:
        pose = belief.mean
        ranges = scan.ranges_m.astype(np.float64)
        hit = np.isfinite(ranges)
        angle = pose.yaw_rad + scan.angle_min_rad + scan.angle_increment_rad * np.flatnonzero(hit)
        x = (pose.x_m + ranges[hit] * np.cos(angle) - spec.origin_x_m) / spec.resolution_m
        y = (pose.y_m + ranges[hit] * np.sin(angle) - spec.origin_y_m) / spec.resolution_m
        column, row_ = np.floor(x).astype(int), np.floor(y).astype(int)
        inside = (column >= 0) & (column < spec.width) & (row_ >= 0) & (row_ < spec.height)
        np.add.at(counts, (row_[inside], column[inside]), 1.0)
    return counts


def closeups_of(
    counts: AnyArray,
    live: AnyArray,
    observable: BoolArray,
    free: BoolArray,
    spec: GridSpec,
    prior: float,
) -> tuple[Closeup, ...]:
    """Return the places that Fig. 5 enlarges, by what the paper says of them.

    A wall in which most beams ended; cells that could have been seen and were not, `live` being
    nan there; free cells that few beams crossed, so that the live map doubts them still.
    """
    certain = math.log(prior / (1.0 - prior)) + (FEW_BEAMS + 0.5) * StepModelConfig().l_free
    doubted = free & (live < prior) & (live > 1.0 / (1.0 + math.exp(-certain)))
    wanted = (counts, np.isnan(live) & observable, np.where(doubted, live, 0.0))
    places: list[tuple[int, int]] = []
    for what in wanted:
        places.append(densest(what, CLOSEUP_CELLS, places))
    radius = CLOSEUP_CELLS * spec.resolution_m
    return tuple(Closeup(*spec.center_of(*place), radius) for place in places)


def densest(
    values: AnyArray, half: int, others: Sequence[tuple[int, int]] = ()
) -> tuple[int, int]:
    """Return (column, row) around which a square of side 2 half + 1 holds most.

    It does not meet the squares around others.
    """
    sums = np.pad(values.astype(np.float64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    side = 2 * half + 1
    inside = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    rows, columns = np.ogrid[half : half + inside.shape[0], half : half + inside.shape[1]]
    for column, row in others:
        inside[(np.abs(rows - row) < side) & (np.abs(columns - column) < side)] = -math.inf
    first, second = np.unravel_index(int(inside.argmax()), inside.shape)
    return int(second) + half, int(first) + half
