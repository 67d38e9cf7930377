"""Walk along a ray cell by cell, with the distance at which each cell is left; look at cells.

`traversal_kernels` lists or marks all cells of a segment as fast as it can; here a walk may stop
at any cell and knows how far it has come, which simulators and forward models need. The rule for
which cells are crossed is the same: those with a point in [i, i + 1) x [j, j + 1).

    column, row, entered = floor(x), floor(y), 0.0
    next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(x, y, dx, dy)
    at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
    while ...:
        leaving = min(at_x, at_y)
        column, row, next_x, next_y, at_x, at_y = next_cell(...)
        entered = leaving
"""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline='always')
def begin_walk(x, y, dx, dy):
    """Prepare a walk from (x, y), cells, along the unit vector (dx, dy).

    Returns the next grid lines ahead (x and y), the distance per unit of x and of y, and the
    steps (-1 or 1) of column and row. A line that is never met is infinitely far away.
    """
    step_x = -1 if dx < 0.0 else 1
    step_y = -1 if dy < 0.0 else 1
    next_x = math.floor(x) + (0.0 if dx < 0.0 else 1.0)
    next_y = math.floor(y) + (0.0 if dy < 0.0 else 1.0)
    inverse_x = 1.0 / dx if dx != 0.0 else math.inf
    inverse_y = 1.0 / dy if dy != 0.0 else math.inf
    return next_x, next_y, inverse_x, inverse_y, step_x, step_y


@njit(cache=True, nogil=True, inline='always')
def next_cell(x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y, at_x, at_y):
    """Go on to the next cell; return its column and row, the lines ahead and where they are met.

    Distances come from the lines themselves and are not added up: no error grows along the way.
    At a corner the point itself belongs to the cell above and to the right of it: up-right and
    down-left lead straight through, up-left first up, down-right first right.
    """
    corner = at_x == at_y and step_x == step_y
    if corner or at_x < at_y or (at_x == at_y and step_x > 0):
        column += step_x
        next_x += step_x
        if corner:
            row += step_y
            next_y += step_y
            at_y = (next_y - y) * inverse_y
        at_x = (next_x - x) * inverse_x
    else:
        row += step_y
        next_y += step_y
        at_y = (next_y - y) * inverse_y
    return column, row, next_x, next_y, at_x, at_y


@njit(cache=True, nogil=True)
def occupied_at(probability, prior, column, row):
    """Probability of a cell of (height, width) float32; `prior` where that is nan, and outside."""
    height, width = probability.shape
    if 0 <= column < width and 0 <= row < height:
        known = np.float64(probability[row, column])
        if known == known:
            return known
    return np.float64(prior)
