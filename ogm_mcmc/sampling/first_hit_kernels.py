"""Kernels that find what rays hit first; records are described in `gibbs_kernels`."""

import numpy as np

from ogm_mcmc.sampling.borrowed_arrays import borrowed
from ogm_mcmc.sampling.gibbs_kernels import UNTOLD
from ogm_mcmc.sampling.kernel_options import kernel
from ogm_mcmc.sampling.ray_index_kernels import (
    FRONT,
    NEAR,
    NOTHING,
    WIDTH,
    likelihood_there,
    list_of,
    reaches_in_front,
    tile_of,
)
from ogm_mcmc.sampling.ray_line_kernels import (
    BORDER,
    LOW_16,
    LOW_32,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    UPWARDS,
    first_place,
    next_occupied,
    place_of,
    row_of_ray,
)


@kernel
def find_first_hits(
    cells, kept, records, bits, marks, lists, full, gain, near, near_bits, front, tiles, runs,
    run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Fill the records from the map.

    kept  (n,) uint8: of the first rays, whether nothing became occupied in front of the hit in
          their record and their likelihoods are what they were. If that cell still is occupied,
          the record stays
    """
    marks, lists = borrowed(marks), borrowed(lists)
    near, near_bits = borrowed(near), borrowed(near_bits)
    cells, rays, ray_bits = borrowed(cells), borrowed(rays), borrowed(ray_bits)
    width = grid[WIDTH]
    for ray in range(records.shape[0]):
        start, shape = rays[ray, START], rays[ray, SHAPE]
        records[ray, 2] = UNTOLD
        if ray < kept.size and kept[ray]:
            place = records[ray, 0]
            if place == NOTHING:
                continue
            if cells[cell_at(place, rays[ray, BORDER], rays[ray, SLOPE], start, shape, width)]:
                continue
        column, row = start & LOW_32, start >> 32
        cell, place = row * width + column, first_place(start, shape)
        if not cells[cell]:
            cell, place = next_occupied(
                rays[ray, BORDER], rays[ray, SLOPE], start, shape, column, row, width, cells
            )
        value = ray_bits[ray, UNSEEN]
        if cell >= 0:
            code = (ray << 2) | ((shape >> 48) & 3)
            value = likelihood_there(
                code, cell, place, marks, lists, near, near_bits, rays, ray_bits
            )
        records[ray, 0] = place if cell >= 0 else NOTHING
        bits[ray, 1] = value


@kernel
def mark_through(
    places, marks, lists, full, near, front, tiles, runs, run_lengths, rays, grid, through
):  # fmt: skip
    """Mark `through` (N,) bool the rays that cross some cells (n,) int64."""
    for cell in places:
        row, column = cell // grid[WIDTH], cell % grid[WIDTH]
        number = list_of(cell, marks)
        if number >= 0:
            for i in range(lists[number, NEAR], lists[number + 1, NEAR]):
                through[near[i, 0] >> 2] = True
        if number >= 0 and full[number]:
            for i in range(lists[number, FRONT], lists[number + 1, FRONT]):
                through[front[i] >> 2] = True
        else:
            tile = tile_of(column, row, grid)
            for i in range(tiles[tile], tiles[tile + 1]):
                for ray in range(runs[i], runs[i] + run_lengths[i]):
                    if not through[ray] and reaches_in_front(ray, column, row, rays):
                        through[ray] = True


@kernel
def cell_at(place, border, slope, start, shape, width):
    """Return the cell at a place of a ray, by halving its rows."""
    flags = shape >> 48
    up = 1 if flags & UPWARDS else -1
    low, high = np.int64(0), (shape & LOW_16) + 1
    while high - low > 1:
        middle = (low + high) >> 1
        row = (start >> 32) + up * middle
        begins, _, _ = row_of_ray(border, slope, start, shape, row)
        if place_of(flags, begins, row) <= place:
            low = middle
        else:
            high = middle
    row = (start >> 32) + up * low
    begins, _, _ = row_of_ray(border, slope, start, shape, row)
    left = place - place_of(flags, begins, row)
    return row * width + begins + (left if flags & RIGHTWARDS else -left)
