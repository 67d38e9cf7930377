"""Kernels that read the ray index; its layout is described in `ogm_mcmc.sampling.ray_index`.

Inner functions take plain arrays, those of `RayIndex.arrays()`, in that order; see the note in
`ogm_mcmc.sampling.gibbs_kernels`.
"""

import numpy as np

from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_line_kernels import (
    BORDER,
    LEVEL,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    crosses,
    near_place,
    next_occupied,
    place_of,
)

# The place of the first hit of a ray on which nothing is occupied.
NOTHING = np.int32(2**31 - 1)

# Numbers of `RayIndex.grid`.
WIDTH, CELLS, TILE_COLUMNS, TILE_X, TILE_Y, MOST_IN_TILE, PAIRS = range(7)
GRID_SIZE = 7

# Cells are grouped in square tiles of 2**3 cells a side.
TILE_BITS = 3

# Columns of `RayIndex.lists`.
NEAR, FRONT = 0, 1

# Numbers for counting bits; all unsigned, or Numba would turn to floating point.
ONE, TWO, FOUR, IN_WORD = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(63)
ODD_BITS = np.uint64(0x5555555555555555)
ODD_PAIRS = np.uint64(0x3333333333333333)
ODD_NIBBLES = np.uint64(0x0F0F0F0F0F0F0F0F)
EVERY_BYTE = np.uint64(0x0101010101010101)
TOP_BYTE = np.uint64(56)


@inlined
def list_of(cell, marks):
    """Return the number of a cell's list, -1 if it has none."""
    word, before = marks[cell >> 6, 0], marks[cell >> 6, 1]
    bit = np.uint64(cell) & IN_WORD
    number = np.int64(-1)
    if (word >> bit) & ONE:
        left = word & ((ONE << bit) - ONE)
        left -= (left >> ONE) & ODD_BITS
        left = (left & ODD_PAIRS) + ((left >> TWO) & ODD_PAIRS)
        left = (left + (left >> FOUR)) & ODD_NIBBLES
        number = np.int64(before) + np.int64((left * EVERY_BYTE) >> TOP_BYTE)
    return number


@inlined
def tile_of(column, row, grid):
    """Return the number of the tile a cell lies in."""
    across = (column + grid[TILE_X]) >> TILE_BITS
    return ((row + grid[TILE_Y]) >> TILE_BITS) * grid[TILE_COLUMNS] + across


@inlined
def near_entry(code, number, lists, near):
    """Return where a ray is in the list of a cell, which holds it, by halving."""
    low, high = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
    while high - low > 1:
        middle = (low + high) >> 1
        if near[middle, 0] <= code:
            low = middle
        else:
            high = middle
    return low


@inlined
def likelihood_there(code, cell, place, marks, lists, near, near_bits, rays, ray_bits):
    """Log p(z | a cell that the ray crosses, at that place, is its first hit)."""
    ray = code >> 2
    value = ray_bits[ray, LEVEL]
    if place >= near_place(rays[ray, START], rays[ray, SHAPE]):
        value = near_bits[near_entry(code, list_of(cell, marks), lists, near), 1]
    return value


@inlined
def hit_behind(
    code, column, row, cells, marks, lists, near, near_bits, rays, ray_bits, grid
):  # fmt: skip
    """Return (place, log-likelihood) of the first hit of a ray behind a cell that it crosses."""
    ray = code >> 2
    cell, place = next_occupied(
        rays[ray, BORDER], rays[ray, SLOPE], rays[ray, START], rays[ray, SHAPE], column, row,
        grid[WIDTH], cells,
    )  # fmt: skip
    value = ray_bits[ray, UNSEEN]
    if cell >= 0:
        value = likelihood_there(code, cell, place, marks, lists, near, near_bits, rays, ray_bits)
    else:
        place = NOTHING
    return place, value


@inlined
def reaches_in_front(ray, column, row, rays):
    """Whether a ray crosses a cell where its likelihood is level."""
    start, shape = rays[ray, START], rays[ray, SHAPE]
    there = False
    if crosses(rays[ray, BORDER], rays[ray, SLOPE], start, shape, column, row):
        there = place_of(shape >> 48, column, row) < near_place(start, shape)
    return there


@kernel
def find_front(column, row, tiles, runs, run_lengths, rays, grid, found):
    """Fill `found` with the codes of the rays that cross a cell in front; return how many.

    They come in rising order. found  (>= rays in the tile,) int32
    """
    count = 0
    tile = tile_of(column, row, grid)
    for i in range(tiles[tile], tiles[tile + 1]):
        for ray in range(runs[i], runs[i] + run_lengths[i]):
            if reaches_in_front(ray, column, row, rays):
                found[count] = (ray << 2) | ((rays[ray, SHAPE] >> 48) & 3)
                count += 1
    return count
