"""Kernels that find which cells of a map go with which scan."""

import math

from numba import njit


@njit(cache=True, nogil=True)
def mark_moved(corner, size, here, moved, block, found):
    """Fill `found` (height, width) uint8: 1 where the nearest of some places has moved.

    corner  lower left corner x, y, m; size of a cell, m
    here    (M, 2) the places, m; moved (M,) bool
    block   cells of so many rows and columns go with the place nearest to their middle
    """
    height, width = found.shape
    for row0 in range(0, height, block):
        rows = min(block, height - row0)
        y = corner[1] + (row0 + 0.5 * rows) * size
        for column0 in range(0, width, block):
            columns = min(block, width - column0)
            x = corner[0] + (column0 + 0.5 * columns) * size
            nearest, least = 0, math.inf
            for k in range(here.shape[0]):
                dx, dy = here[k, 0] - x, here[k, 1] - y
                distance = dx * dx + dy * dy
                if distance < least:
                    nearest, least = k, distance
            for row in range(row0, row0 + rows):
                for column in range(column0, column0 + columns):
                    found[row, column] = moved[nearest]
