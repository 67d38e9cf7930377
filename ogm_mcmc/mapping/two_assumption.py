"""The traditional map: independent cells, independent measurements ([gibbs] section II)."""

from __future__ import annotations

import math

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, GridSpec, PoseBelief, Scan, cast_rays
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid
from ogm_mcmc.mapping.two_assumption_kernels import fuse_per_beam, fuse_per_scan

__all__ = ['TwoAssumptionMapper']


class TwoAssumptionMapper:
    """Log-odds of every cell, updated at the mean of the believed pose.

    l(m | z_1:n) = l(m | z_1:n-1) + l(m | z_n) - l(m), with the step inverse model: `l_free` for
    the cells a beam crossed, `l_occ` for the one it ended in. `fusion` says whether a scan
    counts once per cell or once per beam.
    """

    def __init__(self, config: MapperConfig) -> None:
        self.config = config
        self.grid = LogOddsGrid(config.resolution, config.max_cells)
        # Kernels see float32 only, so that each has one signature.
        self._model = (
            np.float32(config.step.l_free),
            np.float32(config.step.l_occ),
            np.float32(math.log(config.prior) - math.log1p(-config.prior)),
            np.float32(config.log_odds_limit),
        )

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie."""
        return self.grid.spec

    def update(self, scan: Scan, belief: PoseBelief) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        grid = self.grid
        rays = cast_rays(
            scan,
            belief.mean,
            grid.spec,
            max_range_m=self.config.max_range,
            no_return_clears=self.config.no_return == 'clear',
        )
        if rays.n_rays == 0:
            return CellBox(0, 0, 0, 0)
        grid.cover(rays.box)
        column, row = rays.column - grid.spec.column0, rays.row - grid.spec.row0
        geometry = (column, row, rays.x, rays.y, rays.ends, rays.hit, rays.n_rays)
        if self.config.fusion == 'per_scan':
            fuse_per_scan(grid.log_odds, grid.free_bits, grid.hit_bits, *geometry, *self._model)
        else:
            box = rays.box
            longest = (box.column1 - box.column0) + (box.row1 - box.row0) + 3
            columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
            fuse_per_beam(grid.log_odds, columns, rows, *geometry, *self._model)
        return rays.box

    def log_odds(self, box: CellBox) -> Float32Array:
        """Log-odds in nats for each cell of a box, nan where never measured; a view."""
        return self.grid.log_odds[self.grid.spec.slices(box)]

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied; see `MappingMethod.probabilities`."""
        with np.errstate(over='ignore'):
            odds_against = np.exp(-self.log_odds(box))
        probability: Float32Array = np.float32(1.0) / (np.float32(1.0) + odds_against)
        return probability

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        self.grid.clear()

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        self.grid.log_odds.fill(np.nan)
