"""Kernels that take rays out of the ray index, in place; see `ogm_mcmc.sampling.ray_dropping`.

`number` (N,) int32 are the numbers that rays will have, -1 for those that go.
"""

import numpy as np
from numba import njit

from ogm_mcmc.sampling.ray_filing_kernels import LONGEST_RUN, most_added, sum_rounded_up
from ogm_mcmc.sampling.ray_index_kernels import (
    FRONT,
    NEAR,
    WIDTH,
    list_of,
    near_entry,
    reaches_in_front,
    tile_of,
)
from ogm_mcmc.sampling.ray_line_kernels import (
    BORDER,
    LOW_16,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    UPWARDS,
    first_place,
    near_place,
    place_of,
    row_of_ray,
)

# What rays say of a cell: none crosses it, some do, some tell of it.
UNCROSSED, CROSSED, TOLD = range(3)


@njit(cache=True, nogil=True)
def drop_entries(number, begins, wanted, entries, kept):
    """Keep the entries of rays that stay, under their new numbers; others close up behind.

    begins  (S + 1,) int32: where each list begins; wanted (S,) uint8: lists that are kept at all
    entries (T, n) int32, codes in the first column; kept (S,) int32, output: how many of each list
    """
    at = 0
    for which in range(wanted.size):
        first = at
        if wanted[which]:
            for i in range(begins[which], begins[which + 1]):
                code = entries[i, 0]
                ray = number[code >> 2]
                if ray >= 0:
                    entries[at, 0] = (ray << 2) | (code & 3)
                    for k in range(1, entries.shape[1]):
                        entries[at, k] = entries[i, k]
                    at += 1
        kept[which] = at - first


@njit(cache=True, nogil=True)
def drop_runs(staying, tiles, runs, run_lengths):
    """Keep the rays of every tile that stay, in as few runs as they fill; `tiles` follow.

    staying  (N + 1,) int32: how many rays stay of those before each one
    """
    at, end = 0, tiles[0]
    for tile in range(tiles.size - 1):
        begin, end = end, tiles[tile + 1]
        first = at
        for i in range(begin, end):
            ray = staying[runs[i]]
            left = staying[runs[i] + run_lengths[i]] - ray
            if left and at > first and runs[at - 1] + run_lengths[at - 1] == ray:
                more = min(left, LONGEST_RUN - run_lengths[at - 1])
                run_lengths[at - 1] += np.uint8(more)
                ray += more
                left -= more
            if left:
                runs[at], run_lengths[at] = ray, left
                at += 1
        tiles[tile + 1] = at


@njit(cache=True, nogil=True)
def look_again(
    places, telling, marks, lists, full, near, front, tiles, runs, run_lengths, rays, grid, found
):  # fmt: skip
    """Find what the rays of an index say of some cells.

    places  (n,) int32: the cells; telling (N,): see `RayIndex`
    found   (n,) uint8, output: UNCROSSED, CROSSED or TOLD
    """
    for j in range(places.size):
        row, column = places[j] // grid[WIDTH], places[j] % grid[WIDTH]
        number, said = list_of(places[j], marks), UNCROSSED
        if number >= 0:
            for i in range(lists[number, NEAR], lists[number + 1, NEAR]):
                said = max(said, _said_by(near[i, 0], column, row, rays, telling))
                if said == TOLD:
                    break
        if said < TOLD and number >= 0 and full[number]:
            for i in range(lists[number, FRONT], lists[number + 1, FRONT]):
                said = max(said, _said_by(front[i], column, row, rays, telling))
                if said == TOLD:
                    break
        elif said < TOLD:
            tile = tile_of(column, row, grid)
            for i in range(tiles[tile], tiles[tile + 1]):
                for ray in range(runs[i], runs[i] + run_lengths[i]):
                    if reaches_in_front(ray, column, row, rays):
                        code = (ray << 2) | ((rays[ray, SHAPE] >> 48) & 3)
                        said = max(said, _said_by(code, column, row, rays, telling))
                        if said == TOLD:
                            break
                if said == TOLD:
                    break
        found[j] = said


@njit(cache=True, nogil=True, inline='always')
def _said_by(code, column, row, rays, telling):
    ray = code >> 2
    place = place_of(code, column, row) - first_place(rays[ray, START], rays[ray, SHAPE])
    return TOLD if place < telling[ray] else CROSSED


@njit(cache=True, nogil=True)
def take_gains(gone, marks, lists, near, rays, grid, gain):
    """Take what the rays `gone` (n,) can add to the log-odds of cells from `gain` (S,)."""
    near_bits, ray_bits = near.view(np.float32), rays.view(np.float32)
    for ray in gone:
        start, shape = rays[ray, START], rays[ray, SHAPE]
        flags, last = shape >> 48, shape & LOW_16
        code, nearest = (ray << 2) | (flags & 3), near_place(start, shape)
        across = 1 if flags & RIGHTWARDS else -1
        up = 1 if flags & UPWARDS else -1
        lowest = ray_bits[ray, UNSEEN]
        for at in range(last, -1, -1):
            row = (start >> 32) + up * at
            begins, ends, _ = row_of_ray(rays[ray, BORDER], rays[ray, SLOPE], start, shape, row)
            if place_of(flags, ends, row) < nearest:
                break
            for column in range(ends, begins - across, -across):
                if place_of(flags, column, row) < nearest:
                    break
                number = list_of(row * grid[WIDTH] + column, marks)
                value = near_bits[near_entry(code, number, lists, near), 1]
                adds = most_added(value, lowest)
                if adds > 0.0:
                    gain[number] = max(sum_rounded_up(gain[number], -adds), np.float32(0.0))
                lowest = min(lowest, value)
