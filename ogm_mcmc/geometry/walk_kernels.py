"""Walk along a ray cell by cell, with the distance at which each cell is entered.

`traversal_kernels` lists or marks all cells of a segment as fast as it can; here a walk may stop
at any cell and knows how far it has come, which simulators and forward models need. The rule for
which cells are crossed is the same: those with a point in [i, i + 1) x [j, j + 1).

    next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(x, y, dx, dy)
    column, row, entered = 0, 0, 0.0
    while ...:
        column, row, next_x, next_y, entered = next_cell(column, row, ...)
"""

import math

from numba import njit


@njit(cache=True, nogil=True, inline='always')
def begin_walk(x, y, dx, dy):
    """Prepare a walk from (x, y), cells, along the unit vector (dx, dy).

    Returns the next grid lines ahead (x and y), the distance per unit of x and of y, and the
    steps (-1 or 1) of column and row. The walk starts in cell (floor(x), floor(y)).
    """
    step_x = 1 if dx > 0.0 else -1
    step_y = 1 if dy > 0.0 else -1
    next_x = math.floor(x) + (1.0 if dx > 0.0 else 0.0)
    next_y = math.floor(y) + (1.0 if dy > 0.0 else 0.0)
    inverse_x = 1.0 / dx if dx != 0.0 else math.inf
    inverse_y = 1.0 / dy if dy != 0.0 else math.inf
    return next_x, next_y, inverse_x, inverse_y, step_x, step_y


@njit(cache=True, nogil=True, inline='always')
def leaving_distance(x, y, next_x, next_y, inverse_x, inverse_y):
    """Return the distances at which the ray meets the next grid line of x and of y.

    Computed from the line itself, not added up: no error grows along the way.
    """
    at_x = (next_x - x) * inverse_x if inverse_x != math.inf else math.inf
    at_y = (next_y - y) * inverse_y if inverse_y != math.inf else math.inf
    return at_x, at_y


@njit(cache=True, nogil=True, inline='always')
def next_lines(at_x, at_y, step_x, step_y):
    """Whether the walk crosses a line of x, and one of y, in its next step.

    At a corner the point itself belongs to the cell above and to the right of it. Up-right and
    down-left go straight through; up-left first goes up, down-right first goes right.
    """
    if at_x < at_y:
        return True, False
    if at_y < at_x:
        return False, True
    if step_x == step_y:
        return True, True
    return step_x > 0, step_y > 0
