"""The counting model: how often a cell reflects a beam that reaches it ([slides])."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float32Array, UInt32Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan, Rays, cast_rays
from ogm_mcmc.mapping.counting_kernels import count_per_beam, count_per_scan
from ogm_mcmc.mapping.log_odds_grid import CountGrid

__all__ = ['CountingMapper']


class CountingMapper:
    """Hits and misses of every cell, at the mean of the believed pose.

    hits / (hits + misses) maximises the likelihood of all readings if every cell reflects a beam
    that reaches it with a probability of its own ([slides], "Computing the most likely map"). No
    prior enters. A pane of glass that returns one beam in ten keeps 0.1 for ever, where
    log-odds go to "free".
    """

    def __init__(self, config: MapperConfig) -> None:
        self.grid = CountGrid(config.resolution, config.max_cells)
        self.configure(config)

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; the ones that are fixed at start are as before."""
        self.config = config

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie."""
        return self.grid.spec

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        rays = cast_rays(
            placed.scan,
            placed.pose,
            self.spec,
            max_range_m=self.config.max_range,
            no_return_clears=self.config.no_return == 'clear',
        )
        return self.update_by(rays)

    def update_by(self, rays: Rays) -> CellBox:
        """Add the rays of one scan; see `MappingMethod.update`."""
        grid = self.grid
        if rays.n_rays == 0:
            return CellBox(0, 0, 0, 0)
        grid.cover(rays.box)
        column, row = rays.column - grid.spec.column0, rays.row - grid.spec.row0
        geometry = (column, row, rays.x, rays.y, rays.ends, rays.hit, rays.n_rays)
        if self.config.fusion == 'per_scan':
            count_per_scan(grid.hits, grid.misses, grid.free_bits, grid.hit_bits, *geometry)
        else:
            box = rays.box
            longest = (box.column1 - box.column0) + (box.row1 - box.row0) + 3
            columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
            count_per_beam(grid.hits, grid.misses, columns, rows, *geometry)
        return rays.box

    def counts(self, box: CellBox) -> tuple[UInt32Array, UInt32Array]:
        """Hits and misses of each cell of a box; views."""
        slices = self.grid.spec.slices(box)
        return self.grid.hits[slices], self.grid.misses[slices]

    def reflection(self, box: CellBox) -> Float32Array:
        """Share of the beams reaching a cell that it reflected, nan where none did."""
        hits, misses = (count.astype(np.float64) for count in self.counts(box))
        reached = hits + misses
        share = np.divide(hits, reached, out=np.full(hits.shape, np.nan), where=reached > 0.0)
        reflection: Float32Array = share.astype(np.float32)
        return reflection

    def probabilities(self, box: CellBox) -> Float32Array:
        """Reflection probability, or with `counting.show: ml` the likelier of 0 and 1."""
        reflection = self.reflection(box)
        if self.config.counting.show == 'ml':
            # A tie counts as occupied: the side that a robot had better take.
            measured = np.isfinite(reflection)
            reflection[measured] = reflection[measured] >= 0.5
        return reflection

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        self.grid.clear()

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        self.grid.hits.fill(0)
        self.grid.misses.fill(0)
