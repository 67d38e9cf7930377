"""Worlds made of occupied cells.

Design note: what a lidar measures in a grid
--------------------------------------------
Context. In [gibbs] a reading z comes from N(f, sigma^2), f being the number of the first occupied
cell along the ray, and the step inverse model puts the wall into the cell in which the reading
ends. A ray really meets a wall where it enters that cell. A reading of exactly this length ends
on the border of two cells, and rounding decides which of them the wall is put into.

Decision. `depth` says where the first occupied cell reflects a beam, as a share of the beam's way
through it: 0.5, half way, so that a reading without noise ends inside the cell ([gibbs], and the
default), or 0, where it enters, the distance to the wall itself as Stage and a real lidar have it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, UInt8Array
from ogm_mcmc.errors import ConfigError, GridError, require
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.simulation.raster_kernels import first_occupied

__all__ = ['GridWorld']


class GridWorld(NamedTuple):
    """Where the cells lie and which are `occupied` (height, width) uint8, 1 or 0."""

    spec: GridSpec
    occupied: UInt8Array

    @classmethod
    def checked(cls, spec: GridSpec, occupied: AnyArray) -> GridWorld:
        """Make a world of any array of truth values. Raises GridError for another shape."""
        cells = np.array(np.asarray(occupied) != 0, np.uint8, order='C')
        if cells.shape != (spec.height, spec.width):
            raise GridError(f'cells {cells.shape}: expected {(spec.height, spec.width)}')
        return cls(spec, cells)

    @classmethod
    def from_map(cls, grid_map: GridMap, *, unknown_occupied: bool = True) -> GridWorld:
        """Make a world of a map: occupied from 0.5 on; unknown cells are walls or free."""
        filling = 1.0 if unknown_occupied else 0.0
        return cls.checked(grid_map.spec, np.nan_to_num(grid_map.probability, nan=filling) >= 0.5)

    def truth(self) -> GridMap:
        """Return the true map: 1 and 0, no cell unknown."""
        return GridMap(self.spec, self.occupied.astype(np.float32))

    def observable(self) -> BoolArray:
        """Free cells, and occupied ones with a free cell around: what a beam could ever meet.

        The inside of walls cannot be measured; "it is typical to refer to these cells as
        unknown" ([gibbs] section II).
        """
        free = np.pad(self.occupied == 0, 1)
        height, width = self.occupied.shape
        seen = np.zeros(self.occupied.shape, np.bool_)
        for row in range(3):
            for column in range(3):
                seen |= free[row : row + height, column : column + width]
        return seen

    def ranges(
        self,
        pose: Pose2D,
        bearings_rad: Float64Array,
        reach_m: float,
        depth: float = 0.5,
    ) -> Float64Array:
        """Exact ranges (B,), m; inf where no occupied cell begins within `reach_m`.

        Outside of the grid there is nothing. Raises ConfigError for a pose outside.
        """
        require(0.0 <= depth <= 1.0, 'depth', depth, 'expected 0 to 1')
        x, y = self.cell_position(pose)
        heading = pose.yaw_rad + bearings_rad
        entered, left = np.empty(heading.size), np.empty(heading.size)
        first_occupied(
            self.occupied,
            x,
            y,
            np.stack((np.cos(heading), np.sin(heading))),
            reach_m / self.spec.resolution_m,
            entered,
            left,
        )
        hit = np.isfinite(entered)
        entered[hit] += depth * (left[hit] - entered[hit])
        return np.asarray(entered * self.spec.resolution_m, np.float64)

    def cell_position(self, pose: Pose2D) -> tuple[float, float]:
        """Return (x, y) in cells from the lower left corner. Raises ConfigError if outside."""
        x = (pose.x_m - self.spec.origin_x_m) / self.spec.resolution_m
        y = (pose.y_m - self.spec.origin_y_m) / self.spec.resolution_m
        if not (0.0 <= x < self.spec.width and 0.0 <= y < self.spec.height):
            raise ConfigError(f'pose ({pose.x_m:g}, {pose.y_m:g}): expected inside of the world')
        return x, y
