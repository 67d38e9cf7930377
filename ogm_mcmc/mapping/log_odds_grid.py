"""Dense arrays that grow with the map: log-odds, or counts."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, UInt32Array
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, GridSpec

__all__ = ['CountGrid', 'GrowingGrid', 'LogOddsGrid', 'too_large']

# Columns grow in whole words of the bit sets, rows likewise for symmetry.
BLOCK = 64

# The fixed-point traversal keeps 23 bits for whole columns of the array.
MAX_SIDE = 32_767  # Nav2 reads no larger maps


class GrowingGrid:
    """Arrays (height, width), each for one fact about every cell, and bit sets as scratch.

    The window starts as one block and grows by whole blocks, with an eighth of its size to
    spare, so that copying stays a small part of the work; cells never move on the lattice.
    """

    def __init__(self, resolution_m: float, max_cells: int) -> None:
        self.max_cells = max_cells
        self._placed = False
        self._allocate(GridSpec(resolution_m, BLOCK, BLOCK))

    def _allocate(self, spec: GridSpec) -> None:
        words = spec.height * spec.width // 64
        self.spec = spec
        self._box = spec.box
        self.free_bits = np.zeros(words, np.uint64)
        self.hit_bits = np.zeros(words, np.uint64)
        self._make_layers((spec.height, spec.width))

    def _make_layers(self, shape: tuple[int, int]) -> None:
        """Make the arrays of a window in which nothing was measured yet."""
        raise NotImplementedError

    def layers(self) -> tuple[AnyArray, ...]:
        """Return what is kept when the window grows."""
        raise NotImplementedError

    def clear(self) -> None:
        """Forget everything, the extent included."""
        self._placed = False
        self._allocate(GridSpec(self.spec.resolution_m, BLOCK, BLOCK))

    def cover(self, box: CellBox) -> None:
        """Grow until every cell of a lattice box lies inside.

        Raises GridError, with nothing changed, when that takes more than `max_cells`.
        """
        if self._placed and self._box.covers(box):
            return
        tight = roomy = _whole_blocks(box)
        if self._placed:
            old = self._box
            wanted = old.union(box)
            columns, rows = wanted.column1 - wanted.column0, wanted.row1 - wanted.row0
            tight = _whole_blocks(wanted)
            roomy = _whole_blocks(
                CellBox(
                    wanted.column0 - (columns // 8 if wanted.column0 < old.column0 else 0),
                    wanted.row0 - (rows // 8 if wanted.row0 < old.row0 else 0),
                    wanted.column1 + (columns // 8 if wanted.column1 > old.column1 else 0),
                    wanted.row1 + (rows // 8 if wanted.row1 > old.row1 else 0),
                )
            )
        if refusal := too_large(tight, self.max_cells):
            raise GridError(refusal)
        target = roomy if _allowed(roomy, self.max_cells) else tight
        before, kept = self.layers(), self._box
        self._allocate(self.spec.windowed(target))
        if self._placed:
            for layer, earlier in zip(self.layers(), before, strict=True):
                layer[self.spec.slices(kept)] = earlier
        self._placed = True


def too_large(box: CellBox, max_cells: int) -> str:
    """Return why no map of at most so many cells holds a box; empty where one does."""
    whole = _whole_blocks(box)
    columns, rows = whole.column1 - whole.column0, whole.row1 - whole.row0
    if max(columns, rows) > MAX_SIDE:
        limit = f'{MAX_SIDE} along a side, as Nav2 does'
    elif _cells(whole) > max_cells:
        limit = f'max_cells = {max_cells}'
    else:
        return ''
    return f'map would grow to {columns} x {rows} cells: expected at most {limit}'


def _allowed(box: CellBox, max_cells: int) -> bool:
    longest = max(box.column1 - box.column0, box.row1 - box.row0)
    return _cells(box) <= max_cells and longest <= MAX_SIDE


class LogOddsGrid(GrowingGrid):
    """Log-odds (height, width) float32, nan where nothing was ever measured."""

    def _make_layers(self, shape: tuple[int, int]) -> None:
        self.log_odds: Float32Array = np.full(shape, np.nan, np.float32)

    def layers(self) -> tuple[AnyArray, ...]:
        """Return what is kept when the window grows."""
        return (self.log_odds,)


class CountGrid(GrowingGrid):
    """Hits and misses (height, width) uint32."""

    def _make_layers(self, shape: tuple[int, int]) -> None:
        self.hits: UInt32Array = np.zeros(shape, np.uint32)
        self.misses: UInt32Array = np.zeros(shape, np.uint32)

    def layers(self) -> tuple[AnyArray, ...]:
        """Return what is kept when the window grows."""
        return (self.hits, self.misses)


def _whole_blocks(box: CellBox) -> CellBox:
    return CellBox(
        box.column0 // BLOCK * BLOCK,
        box.row0 // BLOCK * BLOCK,
        -(-box.column1 // BLOCK) * BLOCK,
        -(-box.row1 // BLOCK) * BLOCK,
    )


def _cells(box: CellBox) -> int:
    return (box.column1 - box.column0) * (box.row1 - box.row0)
