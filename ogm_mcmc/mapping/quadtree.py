"""A quadtree over flat arrays: one row per node, one small table for the roots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, Int64Array
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox
from ogm_mcmc.mapping.quadtree_arrays import (
    Int32Array,
    Leaves,
    active_arrays,
    tree_arrays,
)
from ogm_mcmc.mapping.quadtree_kernels import FREED, NONE, ROWS, plant
from ogm_mcmc.mapping.quadtree_view_kernels import fill_log_odds

__all__ = ['Quadtree', 'TreeStatistics']


# As for dense grids: the fixed-point traversal keeps 23 bits for whole columns.
MAX_SIDE = 32_767  # Nav2 reads no larger maps
MAX_ROWS = 2**31 - 1


class TreeStatistics(NamedTuple):
    """What a tree takes, beside a regular grid of float32 over the same extent.

    `leaves_by_level`: how many leaves have 2**0, 2**1, ... cells a side; `measured_cells`: cells
    of the finest lattice under measured leaves; `n_bytes` counts rows in use and the table.
    """

    leaves: int
    nodes: int
    leaves_by_level: tuple[int, ...]
    measured_cells: int
    n_bytes: int
    allocated_bytes: int
    regular_cells: int
    regular_bytes: int


def _copy_rows(new: Sequence[AnyArray], old: Sequence[AnyArray], count: int) -> None:
    for target, source in zip(new, old, strict=True):
        target[:count] = source[:count]


class Quadtree:
    """Storage of an adaptive map: roots of 2**coarsest cells on the lattice, added as needed.

    Cells given to kernels are relative to (`column0`, `row0`), which is the corner of a tile.
    """

    def __init__(self, coarsest_level: int, max_cells: int) -> None:
        self.coarsest = coarsest_level
        self.max_cells = max_cells
        self.clear()

    def clear(self) -> None:
        """Forget everything, and give the memory back."""
        self.tree = tree_arrays(64)
        self.active = active_arrays(64)
        self.counters: Int64Array = np.array([0, NONE, 0])
        self.table: Int32Array = np.full((1, 1), NONE, np.int32)
        self.tile_column0 = self.tile_row0 = 0
        self.placed = False

    def forget_cells(self) -> None:
        """Forget every leaf, but keep the extent and the memory."""
        self.counters[:] = 0, NONE, 0
        self.table.fill(NONE)

    @property
    def column0(self) -> int:
        """Lattice column of the lower left cell."""
        return self.tile_column0 << self.coarsest

    @property
    def row0(self) -> int:
        """Lattice row of the lower left cell."""
        return self.tile_row0 << self.coarsest

    @property
    def box(self) -> CellBox:
        """The extent, in cells of the finest lattice."""
        rows, columns = self.table.shape
        side = 1 << self.coarsest
        left, bottom = self.column0, self.row0
        return CellBox(left, bottom, left + columns * side, bottom + rows * side)

    def tiles_around(self, box: CellBox) -> CellBox:
        """Return the cells of all tiles that a lattice box touches."""
        side = 1 << self.coarsest
        return CellBox(
            box.column0 // side * side,
            box.row0 // side * side,
            -(-box.column1 // side) * side,
            -(-box.row1 // side) * side,
        )

    def cover(self, box: CellBox) -> None:
        """Grow until every cell of a lattice box lies inside, with an eighth to spare.

        Raises GridError, with nothing changed, when the extent would exceed `max_cells`.
        """
        if self.placed and self.box.covers(box):
            return
        tiles = CellBox(
            box.column0 >> self.coarsest,
            box.row0 >> self.coarsest,
            ((box.column1 - 1) >> self.coarsest) + 1,
            ((box.row1 - 1) >> self.coarsest) + 1,
        )
        roomy = tiles
        if self.placed:
            rows, columns = self.table.shape
            old = CellBox(
                self.tile_column0,
                self.tile_row0,
                self.tile_column0 + columns,
                self.tile_row0 + rows,
            )
            tiles = old.union(tiles)
            columns, rows = tiles.column1 - tiles.column0, tiles.row1 - tiles.row0
            roomy = CellBox(
                tiles.column0 - (columns // 8 if tiles.column0 < old.column0 else 0),
                tiles.row0 - (rows // 8 if tiles.row0 < old.row0 else 0),
                tiles.column1 + (columns // 8 if tiles.column1 > old.column1 else 0),
                tiles.row1 + (rows // 8 if tiles.row1 > old.row1 else 0),
            )
        target = roomy if self._allowed(roomy) else tiles
        if not self._allowed(target):
            side = 1 << self.coarsest
            width, height = (
                side * (tiles.column1 - tiles.column0),
                side * (tiles.row1 - tiles.row0),
            )
            raise GridError(
                f'map would grow to {width} x {height} cells: expected at most '
                f'max_cells = {self.max_cells}, and {MAX_SIDE} along a side'
            )
        self._move_to(target)

    def _allowed(self, tiles: CellBox) -> bool:
        longest = max(tiles.column1 - tiles.column0, tiles.row1 - tiles.row0) << self.coarsest
        return tiles.n_cells << 2 * self.coarsest <= self.max_cells and longest <= MAX_SIDE

    def _move_to(self, tiles: CellBox) -> None:
        before, column0, row0 = self.table, self.tile_column0, self.tile_row0
        shape = (tiles.row1 - tiles.row0, tiles.column1 - tiles.column0)
        self.table = np.full(shape, NONE, np.int32)
        self.tile_column0, self.tile_row0 = tiles.column0, tiles.row0
        if self.placed:
            top, left = row0 - tiles.row0, column0 - tiles.column0
            self.table[top : top + before.shape[0], left : left + before.shape[1]] = before
        self.placed = True

    def make_room(self, *, rows: int, slots: int) -> None:
        """Have at least so many rows of the tree, and slots for active leaves, beyond those used.

        Raises GridError when the tree would exceed 2**31 - 1 nodes.
        """
        used = int(self.counters[ROWS])
        if used + rows > MAX_ROWS:
            raise GridError(f'the quadtree would exceed {MAX_ROWS} nodes')
        if used + rows > self.tree.level.size:
            size = min(max(used + rows, used + used // 2), MAX_ROWS)
            grown = tree_arrays(size)
            _copy_rows(grown, self.tree, used)
            self.tree = grown
        taken = self.active.node.size
        if taken < slots:
            bigger = active_arrays(max(slots, 2 * taken))
            _copy_rows(bigger, self.active, taken)
            self.active = bigger

    def log_odds(self, box: CellBox, output_level: int) -> Float32Array:
        """Log-odds for a box of output cells, nan where never measured."""
        out: Float32Array = np.full(
            (box.row1 - box.row0, box.column1 - box.column0), np.nan, np.float32
        )
        column0 = box.column0 - (self.column0 >> output_level)
        row0 = box.row0 - (self.row0 >> output_level)
        # The kernel reads the table, which ends where the extent does.
        shift = self.coarsest - output_level
        left, bottom = max(0, -column0), max(0, -row0)
        right = min(out.shape[1], (self.table.shape[1] << shift) - column0)
        top = min(out.shape[0], (self.table.shape[0] << shift) - row0)
        if left < right and bottom < top:
            inside = np.full((top - bottom, right - left), np.nan, np.float32)
            fill_log_odds(
                self.tree,
                self.table,
                self.coarsest,
                output_level,
                column0 + left,
                row0 + bottom,
                inside,
            )
            out[bottom:top, left:right] = inside
        return out

    def leaves(self) -> Leaves:
        """List the leaves, level by level from the coarsest."""
        rows, columns = np.nonzero(self.table >= 0)
        nodes = self.table[rows, columns].astype(np.int64)
        columns, rows = columns + self.tile_column0, rows + self.tile_row0
        found: list[tuple[Int64Array, Int64Array, Int64Array]] = []
        for level in range(self.coarsest, -1, -1):
            first = self.tree.first_child[nodes].astype(np.int64)
            leaf = first < 0
            found.append((nodes[leaf], columns[leaf] << level, rows[leaf] << level))
            child = np.arange(4)
            nodes = (first[~leaf, None] + child).ravel()
            columns = (2 * columns[~leaf, None] + child % 2).ravel()
            rows = (2 * rows[~leaf, None] + child // 2).ravel()
        nodes, columns, rows = (np.concatenate(parts) for parts in zip(*found, strict=True))
        tree = self.tree
        return Leaves(
            tree.level[nodes],
            columns,
            rows,
            tree.log_odds[nodes],
            tree.hits[nodes],
            tree.misses[nodes],
        )

    def plant(self, leaves: Leaves) -> None:
        """Make the tree that has exactly these leaves.

        Raises GridError, with nothing in the tree, when they are no leaves of one tree.
        """
        self.clear()
        if leaves.level.size == 0:
            return
        side = np.int64(1) << leaves.level.astype(np.int64)
        if leaves.level.max() > self.coarsest:
            raise GridError(f'leaf of level {leaves.level.max()}: expected up to {self.coarsest}')
        if (leaves.column % side).any() or (leaves.row % side).any():
            raise GridError('leaf beside the lattice of its level')
        left, bottom = int(leaves.column.min()), int(leaves.row.min())
        right, top = int((leaves.column + side).max()), int((leaves.row + side).max())
        self.cover(CellBox(left, bottom, right, top))
        placed = leaves._replace(column=leaves.column - self.column0, row=leaves.row - self.row0)
        done = -1
        planted = 0
        while planted < leaves.level.size:
            if planted == done:
                self.clear()
                raise GridError('leaves overlap')
            done = planted
            self.make_room(rows=64 + leaves.level.size // 2, slots=0)
            planted = plant(self.tree, self.counters, self.table, self.coarsest, placed, planted)
        area = int((side * side).sum())
        if area != int((self.table >= 0).sum()) << 2 * self.coarsest:
            self.clear()
            raise GridError('leaves leave gaps in their tiles')

    def statistics(self) -> TreeStatistics:
        """Count leaves and bytes."""
        used = int(self.counters[ROWS])
        tree = self.tree
        alive = tree.parent[:used] != FREED
        leaves = alive & (tree.first_child[:used] < 0)
        levels = tree.level[:used][leaves].astype(np.int64)
        measured = levels[~np.isnan(tree.log_odds[:used][leaves])]
        row_bytes = sum(array.itemsize for array in self.tree)
        nodes = int(alive.sum())
        regular = self.box.n_cells
        return TreeStatistics(
            leaves=int(leaves.sum()),
            nodes=nodes,
            leaves_by_level=tuple(np.bincount(levels, minlength=self.coarsest + 1).tolist()),
            measured_cells=int((4**measured).sum()),
            n_bytes=nodes * row_bytes + self.table.nbytes,
            allocated_bytes=sum(array.nbytes for array in self.tree) + self.table.nbytes,
            regular_cells=regular,
            regular_bytes=4 * regular,
        )
