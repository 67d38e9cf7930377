"""The traditional map: independent cells, independent measurements ([gibbs] section II)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array, UInt8Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import (
    CellBox,
    HeldRays,
    PlacedScan,
    Pose2D,
    PoseSamples,
    Rays,
    Scan,
    cast_rays,
)
from ogm_mcmc.mapping.batch_fusion_kernels import PLANES, add_counted, count_scan
from ogm_mcmc.mapping.evidence import EvidenceWindow
from ogm_mcmc.mapping.log_odds_mapper import NOTHING, LogOddsMapper
from ogm_mcmc.mapping.two_assumption_kernels import fuse_per_beam, fuse_per_scan
from ogm_mcmc.sensors import beam_model

__all__ = ['Batch', 'TwoAssumptionMapper']


class Batch(NamedTuple):
    """The cells that scans taken together may have changed, and how many scans were added."""

    changed: CellBox
    added: int


class TwoAssumptionMapper(LogOddsMapper):
    """Log-odds of every cell, updated at the mean of the believed pose.

    l(m | z_1:n) = l(m | z_1:n-1) + l(m | z_n) - l(m), with the step inverse model: `l_free` for
    the cells a beam crossed, `l_occ` for the one it ended in; or with the Gaussian one. `fusion`
    says whether a scan counts once per cell or once per beam.
    """

    _at_the_mean = True

    def __init__(self, config: MapperConfig) -> None:
        self._window = EvidenceWindow()
        super().__init__(config)

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; see `LogOddsMapper.configure`."""
        super().configure(config)
        self._beams = beam_model(config)
        self._model = (self._beams.l_free, self._beams.l_occ, self._prior, self._limit)

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        return self.update_at(placed.scan, placed.pose)

    def update_at(self, scan: Scan, sensor: Pose2D) -> CellBox:
        """Add one scan taken at a known pose of the sensor."""
        if self._beams.gaussian:
            pose = np.array([[sensor.x_m, sensor.y_m, sensor.yaw_rad]])
            return self.update_over(scan, PoseSamples(pose, np.ones(1)))
        grid = self.grid
        rays = self._cast(scan, sensor)
        if rays.n_rays == 0:
            return NOTHING
        grid.cover(rays.box)
        geometry = self._geometry(rays)
        if self.config.fusion == 'per_scan':
            fuse_per_scan(grid.log_odds, grid.free_bits, grid.hit_bits, *geometry, *self._model)
        else:
            box = rays.box
            longest = (box.column1 - box.column0) + (box.row1 - box.row0) + 3
            columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
            fuse_per_beam(grid.log_odds, columns, rows, *geometry, *self._model)
        return rays.box

    def _cast(self, scan: Scan, sensor: Pose2D) -> Rays:
        return cast_rays(
            scan,
            sensor,
            self.grid.spec,
            max_range_m=self.config.max_range,
            no_return_clears=self.config.no_return == 'clear',
        )

    def _geometry(
        self, rays: Rays
    ) -> tuple[int, int, float, float, Float64Array, UInt8Array, int]:
        """Return what kernels take of rays, in cells of the grid."""
        column, row = rays.column - self.spec.column0, rays.row - self.spec.row0
        return (column, row, rays.x, rays.y, rays.ends, rays.hit, rays.n_rays)

    def batch_update(self) -> Callable[..., Batch] | None:
        """Return `update_all` where misses can be counted, None elsewhere."""
        counts = self._at_the_mean and not self._beams.gaussian
        return self.update_all if counts and self.config.fusion == 'per_scan' else None

    def update_all(
        self, scans: Sequence[PlacedScan], cancelled: Callable[[], bool] = lambda: False
    ) -> Batch:
        """Add scans in their order; return the changed cells and how many scans it were.

        The same numbers as of scan after scan, bit for bit, in less than half of the time, with
        a quarter of the map's memory more while it lasts. Ends early when `cancelled`. Raises
        GridError, with nothing changed, when one of the scans leads too far away.
        """
        grid, box, added = self.grid, NOTHING, 0
        cast = HeldRays(scans, self._cast)
        for rays in cast:
            box = box.union(rays.box) if rays.n_rays else box
        if box.empty:
            return Batch(NOTHING, len(scans))
        grid.cover(box)
        counters = np.zeros((grid.free_bits.size, PLANES), np.uint64)
        for rays in cast:
            if cancelled():
                break
            added += 1
            if rays.n_rays:
                bits = (grid.free_bits, grid.hit_bits, counters)
                count_scan(grid.log_odds, *bits, *self._geometry(rays), *self._model)
        l_free, _, prior, limit = self._model
        add_counted(grid.log_odds, counters, l_free, prior, limit)
        return Batch(box, added)

    def update_over(self, scan: Scan, samples: PoseSamples) -> CellBox:
        """Add the evidence of one scan averaged over samples of the sensor's pose."""
        return self._window.add(
            self.grid, scan, samples, self._beams, self.config, self._prior, self._limit
        )

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        super().reset()
        self._window.clear()
