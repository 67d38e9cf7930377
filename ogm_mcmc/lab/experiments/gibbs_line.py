"""Cells in one line, seen from one end: the toy world of [gibbs] Fig. 2 and [patch] Fig. 2.

Cells of 1 m along x; the robot stands in the middle of cell 0 and looks along +x, so cell k lies
k m away. Readings are N(f, sigma^2), f the first occupied cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array, UInt8Array
from ogm_mcmc.config import ChainConfig, ForwardModelConfig, MapperConfig, WindowConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.sampling import CellModel, RayWindow

__all__ = [
    'Line',
    'cell_model',
    'draw_chain',
    'draw_readings',
    'log_likelihoods',
    'measured_line',
    'traditional_map',
]

CELL_M = 1.0


class Line(NamedTuple):
    """Readings (N,) in cells, the scans that hold them, and the rays of a window."""

    readings: Float64Array
    scans: list[PlacedScan]
    window: RayWindow

    @property
    def n_cells(self) -> int:
        """Cells of the line, the robot's own included."""
        return self.window.index.n_cells


def measured_line(readings: Float64Array, reach: int, sigma: float, robot: int = 0) -> Line:
    """Place readings (cells) of a robot in cell `robot` of the line; `reach` is F, cells.

    The last cell is the one the ray ends in, F cells behind the robot's.
    """
    here = PoseBelief(Pose2D(robot + 0.5, 0.5))
    scans = [
        PlacedScan(
            Scan.checked(
                np.array([reading]),
                angle_min_rad=0.0,
                angle_increment_rad=0.0,
                range_min_m=0.0,
                range_max_m=float(reach),
            ),
            here,
        )
        for reading in readings
    ]
    window = RayWindow(
        WindowConfig(resolution=CELL_M, cut_sigma=0.0),
        ForwardModelConfig(kind='gaussian', sigma=sigma * CELL_M),
    )
    window.add(scans)
    return Line(np.asarray(readings, np.float64), scans, window)


def log_likelihoods(line: Line) -> Float64Array:
    """Return log p(z_n | first occupied cell) (N, F + 2), the last column for none, nats."""
    index = line.window.index
    rows = [[*values, unseen] for _, values, unseen in map(index.ray, range(index.n_rays))]
    return np.array(rows, np.float64)


def traditional_map(line: Line) -> Float64Array:
    """Return the two-assumption map (K,): every beam counts; 0.5 where none came."""
    config = MapperConfig(fusion='per_beam', resolution=CELL_M)
    probability = map_of(line.scans, config, line.window.spec.box).probability[0]
    return np.asarray(np.nan_to_num(probability, nan=0.5), np.float64)


def draw_readings(
    rng: np.random.Generator, count: int, first: float, sigma: float, reach: int
) -> Float64Array:
    """Draw readings N(first, sigma^2), cells, none of them beyond the sensor's reach."""
    while True:
        readings: Float64Array = rng.normal(first, sigma, count)
        if ((readings > 0.0) & (readings < reach)).all():
            return readings


def cell_model(line: Line, prior: float) -> CellModel:
    """Return the posterior of a line for Gibbs sampling."""
    log_odds = ChainConfig(prior=prior).prior_log_odds
    return CellModel(line.window.index, log_odds, line.window.spec.width)


def draw_chain(
    rng: np.random.Generator, model: CellModel, prior: float, sweeps: int
) -> UInt8Array:
    """Return the maps (S, K) of a chain from a map drawn from the prior; no burn-in."""
    maps = np.empty((sweeps, model.n_cells), np.uint8)
    state = model.start((rng.random(model.n_cells) < prior).astype(np.uint8))
    for drawn in maps:
        model.advance(rng, state)
        drawn[:] = state.cells
    return maps
