"""The full posterior as one would explain it: slow, in plain Python, from the definitions.

A map is the set of its occupied cells, each a (column, row) of the lattice. Cells on rays come
from exact fractions (`naive.crossed_cells`), likelihoods from the equations of `ForwardModel`'s
description and the standard library's normal distribution. Nothing is cached but the likelihood
of each cell on each ray, and every question about a map looks at every ray from its sensor on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan
from support.naive import Cell, corner_margin, crossed_cells, usable_length

__all__ = [
    'Map',
    'NaivePosterior',
    'NaiveRay',
    'chord',
    'log_likelihood_of_range',
    'log_likelihood_unseen',
    'rays_of',
]

Map = frozenset[Cell]
"""The occupied cells."""

STANDARD = NormalDist()


class NaiveRay(NamedTuple):
    """The `cells` of a beam in order, at which `distances` they reflect, and what was read.

    `end`: how far the ray is followed; all lengths in m; `reading` inf for no return. `margin`:
    how far, in cells, the beam stays from corners and its ends from borders.
    """

    cells: tuple[Cell, ...]
    distances: tuple[float, ...]
    reading: float
    reach: float
    end: float
    margin: float


def chord(x: float, y: float, ux: float, uy: float, cell: Cell) -> tuple[float, float]:
    """Where the half-line from (x, y) enters and leaves the closed square of a cell, in cells."""
    enter, leave = Fraction(0), None
    for start, step, low in ((x, ux, cell[0]), (y, uy, cell[1])):
        if step == 0.0:
            continue
        times = sorted((side - Fraction(start)) / Fraction(step) for side in (low, low + 1))
        enter = max(enter, times[0])
        leave = times[1] if leave is None else min(leave, times[1])
    assert leave is not None
    return float(enter), float(leave)


def rays_of(
    scan: Scan, sensor: Pose2D, window: WindowConfig, model: ForwardModelConfig
) -> list[NaiveRay]:
    """Every beam of a scan that says something."""
    mapper = MapperConfig(
        resolution=window.resolution, max_range=window.max_range, no_return=window.no_return
    )
    x, y = sensor.x_m / window.resolution, sensor.y_m / window.resolution
    rays = []
    for i in range(0, scan.ranges_m.size, window.beam_stride):
        usable = usable_length(float(scan.ranges_m[i]), scan, mapper)
        if usable is None:
            continue
        heading = sensor.yaw_rad + scan.angle_min_rad + i * scan.angle_increment_rad
        ux, uy = math.cos(heading), math.sin(heading)
        reach = end = min(scan.range_max_m, window.max_range or math.inf)
        reading = usable[0] if usable[1] else math.inf
        if usable[1] and window.cut_sigma > 0.0:
            end = min(end, reading + window.cut_sigma * model.sigma)
        segment = x, y, x + end / window.resolution * ux, y + end / window.resolution * uy
        cells = crossed_cells(*segment)
        distances = []
        for cell in cells:
            enter, leave = chord(x, y, ux, uy, cell)
            distances.append((enter + model.depth * (leave - enter)) * window.resolution)
        margin = min(corner_margin(*segment), *(abs(v - round(v)) for v in segment))
        rays.append(NaiveRay(tuple(cells), tuple(distances), reading, reach, end, margin))
    return rays


def _clutter_and_short(
    model: ForwardModelConfig, reading: float, reach: float, distance: float
) -> float:
    density = model.clutter / reach
    if reading <= distance:
        decay, near = model.short_decay, min(distance, reach)
        if near > 0.0:
            density += (
                model.short * decay * math.exp(-decay * reading) / (1.0 - math.exp(-decay * near))
            )
    return density


def log_likelihood_of_range(
    model: ForwardModelConfig, reading: float, reach: float, distance: float
) -> float:
    """Log p(z | first occupied cell at `distance`), inf for nothing on the ray; nats."""
    if model.kind == 'gaussian':
        off = (min(reading, reach) - min(distance, reach)) / model.sigma
        return -0.5 * off * off - math.log(model.sigma * math.sqrt(2.0 * math.pi))
    hit = 1.0 - model.clutter - model.missing - model.short
    if reading > reach:
        beyond = 1.0
        if distance < math.inf:
            # 1 - Phi(x) is Phi(-x), which keeps its digits.
            beyond = STANDARD.cdf((distance - reach) / model.sigma)
            beyond /= STANDARD.cdf(distance / model.sigma)
        return math.log(model.missing + hit * beyond)
    density = _clutter_and_short(model, reading, reach, distance)
    if distance < math.inf:
        peak = NormalDist(distance, model.sigma).pdf(reading)
        density += hit * peak / STANDARD.cdf(distance / model.sigma)
    return math.log(density)


def log_likelihood_unseen(
    model: ForwardModelConfig, reading: float, reach: float, end: float
) -> float:
    """Log-likelihood of a ray that is free as far as it is followed; nats."""
    if end >= reach:
        return log_likelihood_of_range(model, reading, reach, math.inf)
    if model.kind == 'gaussian':
        return log_likelihood_of_range(model, reading, reach, end)
    return math.log(_clutter_and_short(model, reading, reach, end))


class NaivePosterior:
    """p(m | z, x) of placed scans; `touched`: the cells of all rays, row by row."""

    def __init__(
        self,
        model: ForwardModelConfig,
        window: WindowConfig,
        prior: float,
        placed: Iterable[PlacedScan],
    ) -> None:
        self.rays = [ray for one in placed for ray in rays_of(one.scan, one.pose, window, model)]
        self.log_odds_before = math.log(prior / (1.0 - prior))
        self.log_free = math.log(1.0 - prior)
        cells = {cell for ray in self.rays for cell in ray.cells}
        self.touched = sorted(cells, key=lambda cell: (cell[1], cell[0]))
        self.margin = min((ray.margin for ray in self.rays), default=1.0)
        self._values = [
            [log_likelihood_of_range(model, ray.reading, ray.reach, d) for d in ray.distances]
            for ray in self.rays
        ]
        self._nothing = [
            log_likelihood_unseen(model, ray.reading, ray.reach, ray.end) for ray in self.rays
        ]

    def log_likelihood(self, occupied: Map | set[Cell]) -> float:
        """Log p(z | m): each ray ends in its first occupied cell."""
        total = 0.0
        for ray, values, nothing in zip(self.rays, self._values, self._nothing, strict=True):
            hits = (v for cell, v in zip(ray.cells, values, strict=True) if cell in occupied)
            total += next(hits, nothing)
        return total

    def log_joint(self, occupied: Map | set[Cell]) -> float:
        """Log p(z | m) + log p(m) over the touched cells."""
        log_prior = len(occupied) * self.log_odds_before + len(self.touched) * self.log_free
        return self.log_likelihood(occupied) + log_prior

    def map_of(self, number: int) -> Map:
        """Return map `number`: bit b is cell touched[b]."""
        return frozenset(cell for b, cell in enumerate(self.touched) if number >> b & 1)

    def enumerate_log_joint(self) -> Float64Array:
        """Log joint (2^C,) of every map."""
        return np.array([self.log_joint(self.map_of(i)) for i in range(2 ** len(self.touched))])

    def probabilities(self) -> Float64Array:
        """Posterior probability (2^C,) of every map ([gibbs] section II)."""
        log_joint = self.enumerate_log_joint()
        weight = np.exp(log_joint - log_joint.max())
        posterior: Float64Array = weight / weight.sum()
        return posterior

    def marginals(self) -> Float64Array:
        """p(m_k = 1 | z, x) (C,), [gibbs] Eq. 1."""
        p = self.probabilities()
        numbers = np.arange(p.size)
        return np.array([p[numbers >> b & 1 == 1].sum() for b in range(len(self.touched))])

    def log_odds(self, cell: Cell, occupied: Map | set[Cell]) -> float:
        """Log-odds of a cell given all others, [gibbs] Eq. 2: two whole maps, compared."""
        others = set(occupied) - {cell}
        return self.log_joint(others | {cell}) - self.log_joint(others)

    def sweep(self, rng: Generator, occupied: set[Cell], order: Sequence[Cell]) -> None:
        """[gibbs] Algorithm 1, inner loop: one uniform number for each cell, in order."""
        for cell in order:
            u = rng.random()
            if u < 1.0 / (1.0 + math.exp(-self.log_odds(cell, occupied))):
                occupied.add(cell)
            else:
                occupied.discard(cell)
