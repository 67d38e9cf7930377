"""Kernels for rays as straight lines through the window: all cells from five numbers of a ray.

A ray is a row of `rays` (N, 5) int64; `ray_bits` (N, 10) is the same memory as float32:

BORDER  where it leaves its first row of cells, in units of 2**-40 columns of the window
SLOPE   how much further right it leaves each row after that
START   its first cell: the column, and the row in the upper 32 bits
SHAPE   16 bits each: how many rows it goes on, how many columns, its first NEAR place, flags
LEVEL, UNSEEN (float32)  log p(z | a cell in front of its first near place is hit), and
        log p(z | no cell of it is hit)

A cell's `place` on a ray is how many columns and rows lie between it and the first cell, in the
direction of the ray, plus a number of the ray's own: it rises along the ray, and follows from the
cell and the direction (RIGHTWARDS, UPWARDS) alone. A ray's `code` is its number and, in the two
lowest bits, its direction.
"""

import numpy as np

from ogm_mcmc.geometry.traversal_kernels import (
    END,
    FIRST_ROW,
    HERE,
    LEAVING,
    ROWS_UP,
    SHIFT,
    STEP,
)
from ogm_mcmc.geometry.traversal_kernels import RIGHTWARDS as PLAN_RIGHTWARDS
from ogm_mcmc.sampling.kernel_options import inlined, kernel

# Words of a ray; the last two are float32.
BORDER, SLOPE, START, SHAPE = range(4)
LEVEL, UNSEEN = 8, 9
RAY_WORDS = 5

# Flags: the direction, and which side of a border a row ends on and the next one begins on.
RIGHTWARDS, UPWARDS, ENDS_LEFT, BEGINS_LEFT = 1, 2, 4, 8

LOW_32 = np.int64(0xFFFFFFFF)
LOW_16 = np.int64(0xFFFF)


@kernel
def lay_ray(plan, downwards, ray):
    """Write BORDER, SLOPE, START and SHAPE of a ray (5,) from a planned segment.

    plan       as `plan_ray` leaves it: from the lower end of the segment to the upper one
    downwards  whether the ray goes the other way
    """
    rightwards = plan[PLAN_RIGHTWARDS] != 0
    rows = plan[ROWS_UP]
    here, end = plan[HERE] >> SHIFT, plan[END] >> SHIFT
    last_border = plan[LEAVING] + max(rows - 1, 0) * plan[STEP]
    if rows > 0:
        entering = last_border >> SHIFT
        end = max(entering, end) if rightwards else min(entering, end)
    flags = np.int64(0)
    if downwards:
        ray[BORDER], ray[SLOPE] = last_border, -plan[STEP]
        column, row, columns = end, plan[FIRST_ROW] + rows, abs(end - here)
        flags = np.int64(BEGINS_LEFT if rightwards else RIGHTWARDS)
    else:
        ray[BORDER], ray[SLOPE] = plan[LEAVING], plan[STEP]
        column, row, columns = here, plan[FIRST_ROW], abs(end - here)
        flags = np.int64(UPWARDS | (ENDS_LEFT | RIGHTWARDS if rightwards else 0))
    ray[START] = column | (row << 32)
    ray[SHAPE] = rows | (columns << 16) | (flags << 48)


@kernel
def place_of(code, column, row):
    """Place of a cell on the rays of a direction."""
    across = column if code & RIGHTWARDS else -column
    return np.int32(across + row if code & UPWARDS else across - row)


@kernel
def first_place(start, shape):
    """Place of a ray's first cell."""
    return place_of(shape >> 48, start & LOW_32, start >> 32)


@kernel
def near_place(start, shape):
    """Place from which on a ray's likelihood is not level."""
    return first_place(start, shape) + ((shape >> 32) & LOW_16)


@kernel
def places_of(shape):
    """Return how many places a ray has."""
    return (shape & LOW_16) + ((shape >> 16) & LOW_16) + 1


@kernel
def row_of_ray(border, slope, start, shape, row):
    """Return (begins, ends, next border): the columns of a ray in a row it crosses, in order.

    The last one is the border behind that row.
    """
    flags = shape >> 48
    rows = shape & LOW_16
    at = row - (start >> 32) if flags & UPWARDS else (start >> 32) - row
    behind = border + at * slope
    begins = start & LOW_32
    if at > 0:
        begins = (behind - slope - (1 if flags & BEGINS_LEFT else 0)) >> SHIFT
    ends = (behind - (1 if flags & ENDS_LEFT else 0)) >> SHIFT
    if at == rows:
        columns = (shape >> 16) & LOW_16
        ends = (start & LOW_32) + (columns if flags & RIGHTWARDS else -columns)
    return begins, ends, behind


@kernel
def crosses(border, slope, start, shape, column, row):
    """Whether a ray crosses a cell."""
    flags = shape >> 48
    at = row - (start >> 32) if flags & UPWARDS else (start >> 32) - row
    if at < 0 or at > (shape & LOW_16):
        return False
    begins, ends, _ = row_of_ray(border, slope, start, shape, row)
    if flags & RIGHTWARDS:
        return begins <= column <= ends
    return ends <= column <= begins


@inlined
def next_occupied(border, slope, start, shape, column, row, width, cells):
    """Return (cell, place) of the first occupied cell of a ray behind one it crosses, or -1."""
    flags = shape >> 48
    rows = shape & LOW_16
    across = 1 if flags & RIGHTWARDS else -1
    up = 1 if flags & UPWARDS else -1
    at = (row - (start >> 32)) * up
    begins_left = 1 if flags & BEGINS_LEFT else 0
    ends_left = 1 if flags & ENDS_LEFT else 0
    last_column = (start & LOW_32) + across * ((shape >> 16) & LOW_16)
    behind = border + at * slope
    ends = last_column if at == rows else (behind - ends_left) >> SHIFT
    cell = row * width + column
    found = np.int64(-1)
    while True:
        if column != ends:
            column += across
            cell += across
        elif at == rows:
            break
        else:
            at += 1
            row += up
            column = (behind - begins_left) >> SHIFT
            behind += slope
            ends = last_column if at == rows else (behind - ends_left) >> SHIFT
            cell = row * width + column
        if cells[cell]:
            found = cell
            break
    return found, place_of(flags, column, row)


@kernel
def cells_of_ray(ray, columns, rows):
    """List the cells a ray (5,) crosses in order; return their number.

    columns, rows  (n,) int64, output; n more than rows and columns it goes on together
    """
    shape = ray[SHAPE]
    flags, last = shape >> 48, shape & LOW_16
    across = 1 if flags & RIGHTWARDS else -1
    up = 1 if flags & UPWARDS else -1
    count = 0
    for at in range(last + 1):
        row = (ray[START] >> 32) + up * at
        begins, ends, _ = row_of_ray(ray[BORDER], ray[SLOPE], ray[START], shape, row)
        for column in range(begins, ends + across, across):
            columns[count], rows[count] = column, row
            count += 1
    return count
