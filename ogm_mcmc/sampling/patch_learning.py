"""Count the patches of training maps, all of them and in all eight symmetries ([patch] III-A).

[patch] draws 10**10 patches at random; here every window of every map is counted once in each of
its eight images, which is what such drawing converges to.

A training map is an array (height, width) int8, row 0 lowest y: 1 occupied, 0 free, -1 unknown.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Int8Array, Int32Array, Int64Array
from ogm_mcmc.config import LearningConfig
from ogm_mcmc.errors import PriorError
from ogm_mcmc.sampling.patch_patterns import SYMMETRIES, canonical, images

__all__ = ['PatchCounts', 'WindowCounts', 'count_map', 'count_windows', 'rescaled', 'total_of']

UNKNOWN, FREE, OCCUPIED = -1, 0, 1


class WindowCounts(NamedTuple):
    """Windows of one size by class of patterns that are images of each other.

    patterns  (n,) int32, ascending; the smallest image stands for its class
    windows   (n,) int64, how many windows of the maps belong to it
    """

    patterns: Int32Array
    windows: Int64Array

    def by_pattern(self, side: int) -> tuple[Int32Array, Int64Array]:
        """Every pattern that was seen, ascending, and how often: each window in eight images."""
        seen = images(self.patterns, side)
        patterns, index = np.unique(seen, return_inverse=True)
        each = np.broadcast_to(self.windows, seen.shape).ravel()
        counts = np.zeros(patterns.size, np.int64)
        np.add.at(counts, index.ravel(), each)
        return patterns, counts


@dataclass(frozen=True)
class PatchCounts:
    """What was counted in training maps, at one resolution.

    cells    (2,) int64, free and occupied cells
    patches  (512,) int64, 3 x 3 windows by pattern, each counted in eight images
    squares  5 x 5 windows by class: the patches of L = 25, and 3 x 3 patches with their border
    dropped  5 x 5 windows of classes too rare to be kept (`without_rare`)
    """

    resolution_m: float
    cells: Int64Array
    patches: Int64Array
    squares: WindowCounts
    dropped: int = 0

    @property
    def p_occupied(self) -> float:
        """Share of the cells that are occupied."""
        return float(self.cells[1] / self.cells.sum())

    def without_rare(self, least: int) -> PatchCounts:
        """The same without the classes of 5 x 5 windows that were seen less often than this."""
        kept = self.squares.windows >= least
        squares = WindowCounts(self.squares.patterns[kept], self.squares.windows[kept])
        dropped = self.dropped + int(self.squares.windows[~kept].sum())
        return PatchCounts(self.resolution_m, self.cells, self.patches, squares, dropped)


def rescaled(states: Int8Array, resolution_m: float, target_m: float) -> Int8Array:
    """The map with cells of another size.

    Patterns depend on how many cells a wall is thick, so all maps have to have the resolution
    at which the prior is used. Coarser: a cell of the map belongs to the larger one that holds
    its centre; that is occupied if any of them is, else free if any is free: what a live map of
    larger cells would say, and thin walls stay closed. Finer: the cell that holds the centre.
    """
    step = _exact(target_m) / _exact(resolution_m)  # cells of the map per new cell
    if step == 1:
        return states
    rows, columns = (_indices(size, step) for size in states.shape)
    if step < 1:
        return np.ascontiguousarray(states[np.ix_(rows, columns)])
    # -1 < 0 < 1: the largest is the answer.
    pooled: Int8Array = np.maximum.reduceat(np.maximum.reduceat(states, rows, 0), columns, 1)
    return pooled


def _exact(length_m: float) -> Fraction:
    """A resolution as it was meant: 0.05 and not the float next to it."""
    return Fraction(length_m).limit_denominator(1_000_000)


def _indices(size: int, step: Fraction) -> Int64Array:
    """Coarser: the first cell of the map in each new cell. Finer: the cell each is taken from."""
    up, down = step.numerator, step.denominator
    if step < 1:
        count = max(1, int(Fraction(size) / step + Fraction(1, 2)))
        return np.minimum((2 * np.arange(count) + 1) * up // (2 * down), size - 1)
    held_by = (2 * np.arange(size) + 1) * down // (2 * up)
    return np.unique(held_by, return_index=True)[1]


def _sums(mask: BoolArray) -> Int64Array:
    """How many cells are set below and left of each corner of a cell (height + 1, width + 1)."""
    sums = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1), np.int64)
    np.cumsum(np.cumsum(mask, axis=0, dtype=np.int64), axis=1, out=sums[1:, 1:])
    return sums


def _none_inside(mask: BoolArray, side: int) -> BoolArray:
    """Whether no cell is set in each window (height - side + 1, width - side + 1)."""
    sums = _sums(mask)
    inside = sums[side:, side:] - sums[side:, :-side] - sums[:-side, side:] + sums[:-side, :-side]
    none: BoolArray = inside == 0
    return none


def _near(mask: BoolArray, reach: int) -> BoolArray:
    """Whether a cell within `reach` rows and columns is set, for each cell."""
    sums = _sums(mask)
    rows, columns = (np.arange(size) for size in mask.shape)
    bottom, top = (rows - reach).clip(0), (rows + reach + 1).clip(max=rows.size)
    left, right = (columns - reach).clip(0), (columns + reach + 1).clip(max=columns.size)
    across = sums[:, right] - sums[:, left]
    near: BoolArray = across[top] - across[bottom] > 0
    return near


def count_windows(
    states: Int8Array, side: int, *, unknown: str = 'occupied', margin_cells: int | None = None
) -> WindowCounts:
    """Count every window of side x side cells of a map.

    unknown       'occupied' or 'skip', see `LearningConfig`
    margin_cells  only windows whose middle has a known cell within so many rows and columns;
                  None: all windows
    """
    height, width = (size - side + 1 for size in states.shape)
    if height < 1 or width < 1:
        return WindowCounts(np.empty(0, np.int32), np.empty(0, np.int64))
    occupied = (states != FREE).astype(np.int32)
    rows = np.zeros((states.shape[0], width), np.int32)
    for column in range(side):
        rows |= occupied[:, column : column + width] << column
    codes = np.zeros((height, width), np.int32)
    for row in range(side):
        codes |= rows[row : row + height] << (side * row)
    counted = np.ones((height, width), np.bool_)
    if unknown == 'skip':
        counted = _none_inside(states == UNKNOWN, side)
    elif margin_cells is not None:
        near = _near(states != UNKNOWN, margin_cells)
        middle = side // 2
        counted = near[middle : middle + height, middle : middle + width]
    patterns, windows = np.unique(codes[counted], return_counts=True)
    return _merged([canonical(patterns, side)], [windows])


def _merged(patterns: Iterable[Int32Array], windows: Iterable[Int64Array]) -> WindowCounts:
    every, index = np.unique(np.concatenate(list(patterns)), return_inverse=True)
    total = np.zeros(every.size, np.int64)
    np.add.at(total, index, np.concatenate(list(windows)))
    return WindowCounts(every, total)


def count_map(states: Int8Array, config: LearningConfig) -> PatchCounts:
    """Count cells and 3 x 3 and 5 x 5 windows of a map that has the resolution of the prior.

    Raises PriorError when not a single 5 x 5 window counts.
    """
    margin = round(config.margin / config.resolution)
    single, small, large = (
        count_windows(states, side, unknown=config.unknown, margin_cells=margin)
        for side in (1, 3, 5)
    )
    if large.patterns.size == 0:
        raise PriorError(
            f'{states.shape[1]} x {states.shape[0]} cells of {config.resolution:g} m without '
            'a 5 x 5 window to count: expected a larger map'
        )
    cells, patches = np.zeros(2, np.int64), np.zeros(512, np.int64)
    cells[single.patterns] = single.windows
    patterns, counts = small.by_pattern(3)
    patches[patterns] = counts
    assert patches.sum() == SYMMETRIES * small.windows.sum()
    return PatchCounts(config.resolution, cells, patches, large)


def total_of(counts: Iterable[PatchCounts]) -> PatchCounts:
    """What several maps hold together; raises PriorError unless they have one resolution."""
    every = list(counts)
    resolutions = sorted({part.resolution_m for part in every})
    if len(resolutions) != 1:
        raise PriorError(f'maps have resolutions {resolutions}: expected one, so rescale them')
    return PatchCounts(
        resolutions[0],
        np.sum([part.cells for part in every], axis=0),
        np.sum([part.patches for part in every], axis=0),
        _merged(
            (part.squares.patterns for part in every), (part.squares.windows for part in every)
        ),
        sum(part.dropped for part in every),
    )
