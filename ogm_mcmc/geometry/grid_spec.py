"""Where the cells lie."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import require

__all__ = ['CellBox', 'GridSpec']


class CellBox(NamedTuple):
    """A rectangle of cells in lattice coordinates, upper ends excluded; empty when nothing in it.

    Lattice coordinates do not move when a map grows, so boxes stay valid.
    """

    column0: int
    row0: int
    column1: int
    row1: int

    @property
    def empty(self) -> bool:
        """Whether no cell lies inside."""
        return self.column1 <= self.column0 or self.row1 <= self.row0

    @property
    def n_cells(self) -> int:
        """How many cells lie inside."""
        return 0 if self.empty else (self.column1 - self.column0) * (self.row1 - self.row0)

    def union(self, other: CellBox) -> CellBox:
        """Return the smallest box around both."""
        if self.empty or other.empty:
            return other if self.empty else self
        return CellBox(
            min(self.column0, other.column0),
            min(self.row0, other.row0),
            max(self.column1, other.column1),
            max(self.row1, other.row1),
        )

    def intersection(self, other: CellBox) -> CellBox:
        """Return the cells that lie in both; empty when there are none."""
        return CellBox(
            max(self.column0, other.column0),
            max(self.row0, other.row0),
            min(self.column1, other.column1),
            min(self.row1, other.row1),
        )

    def covers(self, other: CellBox) -> bool:
        """Whether every cell of the other box lies inside this one."""
        return other.empty or (
            self.column0 <= other.column0
            and self.row0 <= other.row0
            and other.column1 <= self.column1
            and other.row1 <= self.row1
        )


@dataclass(frozen=True, slots=True)
class GridSpec:
    """A window of `width` x `height` cells on an endless lattice.

    Row-major, cell (0, 0) at the lower left, rows follow +y: as in nav_msgs/OccupancyGrid.
    The lattice is fixed by `resolution_m` and the anchor; the window by its first column and
    row. A map that grows changes only integers, so no cell ever moves by a rounding error, and
    maps of the same lattice can be compared cell for cell.
    """

    resolution_m: float
    width: int
    height: int
    column0: int = 0
    row0: int = 0
    anchor_x_m: float = 0.0
    anchor_y_m: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a grid."""
        positive = math.isfinite(self.resolution_m) and self.resolution_m > 0.0
        require(positive, 'resolution_m', self.resolution_m, 'must be positive')
        require(self.width > 0, 'width', self.width, 'needs at least one column')
        require(self.height > 0, 'height', self.height, 'needs at least one row')
        finite = math.isfinite(self.anchor_x_m) and math.isfinite(self.anchor_y_m)
        require(finite, 'origin', (self.anchor_x_m, self.anchor_y_m), 'must be finite')

    @property
    def origin_x_m(self) -> float:
        """The x of the lower left corner of cell (0, 0), m."""
        return self.anchor_x_m + self.column0 * self.resolution_m

    @property
    def origin_y_m(self) -> float:
        """The y of the lower left corner of cell (0, 0), m."""
        return self.anchor_y_m + self.row0 * self.resolution_m

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """The lowest and highest x, the lowest and highest y: as matplotlib has it, m."""
        left, bottom, size = self.origin_x_m, self.origin_y_m, self.resolution_m
        return (left, left + size * self.width, bottom, bottom + size * self.height)

    @property
    def box(self) -> CellBox:
        """All cells of the window, in lattice coordinates."""
        return CellBox(self.column0, self.row0, self.column0 + self.width, self.row0 + self.height)

    def windowed(self, box: CellBox) -> GridSpec:
        """Return the spec of another window on the same lattice."""
        return replace(
            self,
            width=box.column1 - box.column0,
            height=box.row1 - box.row0,
            column0=box.column0,
            row0=box.row0,
        )

    def slices(self, box: CellBox) -> tuple[slice, slice]:
        """Return (rows, columns) of a covered box, to index an array of this window."""
        return (
            slice(box.row0 - self.row0, box.row1 - self.row0),
            slice(box.column0 - self.column0, box.column1 - self.column0),
        )

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return (column, row) inside the window of the cell that holds a point; may lie outside.

        A point on the border of two cells belongs to the upper or right one.
        """
        column = math.floor((x_m - self.anchor_x_m) / self.resolution_m) - self.column0
        row = math.floor((y_m - self.anchor_y_m) / self.resolution_m) - self.row0
        return column, row

    def center_of(self, column: int, row: int) -> tuple[float, float]:
        """Return the point in the middle of a cell, m."""
        return (
            self.anchor_x_m + (self.column0 + column + 0.5) * self.resolution_m,
            self.anchor_y_m + (self.row0 + row + 0.5) * self.resolution_m,
        )

    def in_cells(self, places: AnyArray) -> Float64Array:
        """Return places or poses (N, 2 or more) with x, y as cells from the corner of (0, 0).

        What comes after x and y, m, stays: a heading is the same in cells.
        """
        found = np.array(places, np.float64, order='C')
        found[:, :2] = (found[:, :2] - (self.origin_x_m, self.origin_y_m)) / self.resolution_m
        return found

    def scan_in_cells(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> tuple[Float64Array, Float64Array, Float64Array, float]:
        """Return a scan at poses (M, 3) as kernels take it: all lengths in cells.

        bearings, ranges  (B,) rad and m; reach  range_max, m
        """
        cells = 1.0 / self.resolution_m
        return self.in_cells(poses), bearings, ranges * cells, reach * cells
