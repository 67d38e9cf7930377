"""Which cells count: all, the measured ones, or those near a measured one ([patch] section IV)."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float32Array
from ogm_mcmc.errors import require

__all__ = ['MASKS', 'cells_that_count', 'near']

MASKS = ('all', 'measured', 'near')


def near(cells: BoolArray, distance: int) -> BoolArray:
    """Cells at most `distance` columns and rows away from one of `cells` (Chebyshev).

    Counts the cells of the square around each one by a summed-area table: O(K) at any distance.
    """
    require(distance >= 0, 'distance', distance, 'expected 0 or more cells')
    height, width = cells.shape
    sums = np.zeros((height + 1, width + 1), np.int64)
    np.cumsum(np.cumsum(cells, axis=0, dtype=np.int64), axis=1, out=sums[1:, 1:])
    rows, columns = np.arange(height), np.arange(width)
    bottom, top = np.maximum(rows - distance, 0), np.minimum(rows + distance + 1, height)
    left, right = np.maximum(columns - distance, 0), np.minimum(columns + distance + 1, width)
    inside = (
        sums[np.ix_(top, right)]
        - sums[np.ix_(bottom, right)]
        - sums[np.ix_(top, left)]
        + sums[np.ix_(bottom, left)]
    )
    close: BoolArray = inside > 0
    return close


def cells_that_count(probability: Float32Array, mask: str, near_cells: int = 10) -> BoolArray:
    """Return the mask of a map, whose cells are nan where nothing was ever measured.

    `near` keeps cells within `near_cells` of a measured one: "only those within 10 cells of a
    cell mapped by a range measurement are used" ([patch] section IV).
    """
    require(mask in MASKS, 'mask', mask, f'one of {", ".join(MASKS)}')
    if mask == 'all':
        return np.ones(probability.shape, np.bool_)
    measured: BoolArray = np.isfinite(probability)
    return measured if mask == 'measured' else near(measured, near_cells)
