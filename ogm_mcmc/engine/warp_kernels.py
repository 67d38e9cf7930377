"""Kernels that find where the cells of a map were before its scans moved."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def find_before(old, new, here, moves, block, before):
    """Fill `before` (height, width) int32: the old number of each new cell, -1: outside.

    old, new  lower left corner x, y, m, cell size, m, and for `old` width and height, cells
    here      (M, 2) where the scans are, m; moves (M, 3): turn, x and y of the way back
    block     cells of so many rows and columns go with the scan nearest to their middle
    """
    left, bottom, size = new[0], new[1], new[2]
    old_width, old_height = int(old[3]), int(old[4])
    height, width = before.shape
    for row0 in range(0, height, block):
        rows = min(block, height - row0)
        for column0 in range(0, width, block):
            columns = min(block, width - column0)
            x = left + (column0 + 0.5 * columns) * size
            y = bottom + (row0 + 0.5 * rows) * size
            nearest, least = 0, math.inf
            for k in range(here.shape[0]):
                dx, dy = here[k, 0] - x, here[k, 1] - y
                distance = dx * dx + dy * dy
                if distance < least:
                    nearest, least = k, distance
            cosine, sine = math.cos(moves[nearest, 0]), math.sin(moves[nearest, 0])
            for row in range(row0, row0 + rows):
                y = bottom + (row + 0.5) * size
                for column in range(column0, column0 + columns):
                    x = left + (column + 0.5) * size
                    was_x = cosine * x - sine * y + moves[nearest, 1]
                    was_y = sine * x + cosine * y + moves[nearest, 2]
                    c = math.floor((was_x - old[0]) / old[2])
                    r = math.floor((was_y - old[1]) / old[2])
                    inside = 0 <= c < old_width and 0 <= r < old_height
                    before[row, column] = r * old_width + c if inside else -1


@njit(cache=True, nogil=True)
def take_before(before, cells, elsewhere, found):
    """Fill `found` (K,) uint8 with the cells (K_old,) uint8 that were there, or `elsewhere`."""
    places = before.reshape(-1)
    for k in range(found.size):
        place = places[np.uint64(k)]
        found[np.uint64(k)] = cells[np.uint64(place)] if place >= 0 else elsewhere
