"""Hypothesis strategy for windows so small that every one of their maps can be looked at."""

from __future__ import annotations

import math
from typing import NamedTuple

from hypothesis import strategies as st

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow
from support.naive import Cell
from support.naive_posterior import NaivePosterior
from support.strategies import fan

__all__ = ['TinyProblem', 'cell_numbers', 'forward_models', 'tiny_problems']

# Nearer to a corner or a border than this, the traversal may round to either side.
ROUNDING = 1e-9


def cell_numbers(spec: GridSpec, cells: list[Cell]) -> list[int]:
    """Return the places of lattice cells in a window's flat arrays."""
    return [(row - spec.row0) * spec.width + column - spec.column0 for column, row in cells]


class TinyProblem(NamedTuple):
    """Scans with the poses of their sensors, and everything that makes a posterior of them."""

    model: ForwardModelConfig
    window: WindowConfig
    prior: float
    placed: tuple[PlacedScan, ...]

    @property
    def prior_log_odds(self) -> float:
        """Nats."""
        return math.log(self.prior / (1.0 - self.prior))

    def naive(self) -> NaivePosterior:
        """Return the slow twin."""
        return NaivePosterior(self.model, self.window, self.prior, self.placed)

    def indexed(self) -> RayWindow:
        """Return the window of rays that is sampled."""
        window = RayWindow(self.window, self.model)
        window.add(self.placed)
        return window


gaussians = st.builds(
    ForwardModelConfig,
    kind=st.just('gaussian'),
    sigma=st.sampled_from([0.5, 1.5]),
    depth=st.sampled_from([0.0, 0.5, 1.0]),
)
beams = st.builds(
    ForwardModelConfig,
    kind=st.just('beam'),
    sigma=st.sampled_from([0.15, 0.6, 2.0]),
    clutter=st.sampled_from([0.01, 0.2]),
    missing=st.sampled_from([0.02, 0.3]),
    short=st.sampled_from([0.0, 0.1]),
    depth=st.sampled_from([0.0, 0.5, 1.0]),
)
forward_models = st.one_of(beams, gaussians)


@st.composite
def tiny_problems(draw: st.DrawFn, max_cells: int = 9, max_scans: int = 3) -> TinyProblem:
    """Up to three scans of up to two beams each in cells of 1 m, some of them without return."""
    model = draw(forward_models)
    window = WindowConfig(
        resolution=1.0,
        max_range=draw(st.sampled_from([0.0, 2.25])),
        cut_sigma=draw(st.sampled_from([0.0, 0.0, 1.0, 6.0])),
    )
    prior = draw(st.sampled_from([0.5, 0.2, 0.03, 0.8]))
    place = st.floats(0.01, 1.99)
    reading = st.one_of(
        st.floats(0.25, 3.375, width=32), st.sampled_from([math.inf, math.inf, 3.5])
    )
    placed: list[PlacedScan] = []
    for _ in range(draw(st.integers(1, max_scans))):
        scan = fan(
            *draw(st.lists(reading, min_size=1, max_size=2)),
            bearing=draw(st.floats(-math.pi, math.pi)),
            increment=draw(st.sampled_from([0.4, 2.0])),
            range_max_m=3.5,
        )
        more = [
            *placed,
            PlacedScan.at(scan, Pose2D(draw(place), draw(place), draw(st.floats(-3.0, 3.0)))),
        ]
        naive = NaivePosterior(model, window, prior, more)
        if len(naive.touched) <= max_cells and naive.margin > ROUNDING:
            placed = more
    if not placed:
        placed = [PlacedScan.at(fan(1.6, range_max_m=3.5), Pose2D(0.3, 0.4, 0.2))]
    return TinyProblem(model, window, prior, tuple(placed))
