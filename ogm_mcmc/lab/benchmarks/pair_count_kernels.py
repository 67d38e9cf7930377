"""Counts what a sweep looks at: the sampler's own decisions, one counter added."""

import math

import numpy as np
from numba import njit

from ogm_mcmc.sampling.gibbs_kernels import SLACK
from ogm_mcmc.sampling.ray_index_kernels import (
    FRONT,
    MOST_IN_TILE,
    NEAR,
    WIDTH,
    find_front,
    hit_behind,
    list_of,
)
from ogm_mcmc.sampling.ray_line_kernels import LEVEL, place_of


@njit(cache=True, nogil=True)
def added(
    code, value, column, row, cells, records, bits, marks, lists, near, near_bits, rays, ray_bits,
    grid,
):  # fmt: skip
    """Return what a ray adds to the log-odds of a cell where its likelihood is `value`."""
    place, first = place_of(code, column, row), records[code >> 2, 0]
    if first < place:
        return 0.0
    now = bits[code >> 2, 1]
    if first == place:
        _, now = hit_behind(
            code, column, row, cells, marks, lists, near, near_bits, rays, ray_bits, grid
        )
    return np.float64(value) - now


@njit(cache=True, nogil=True)
def count_looked_at(rng, order, cells, records, index, ceiling, prior):
    """Return (cells, pairs) that drawing every cell of `order` once would look at.

    As `sweep_cells` decides, but each cell given the same present map, which stays as it is: on
    average over a converged chain as many as in a sweep. Pairs that a flip changes come on top.
    """
    marks, lists, full, gain, near = index.marks, index.lists, index.full, index.gain, index.near
    front, tiles, runs, lengths = index.front, index.tiles, index.runs, index.run_lengths
    rays, grid = index.rays, index.grid
    bits, near_bits, ray_bits = (
        records.view(np.float32), near.view(np.float32), rays.view(np.float32)
    )  # fmt: skip
    found = np.empty(max(grid[MOST_IN_TILE], 1), np.int32)
    looked_cells, looked_pairs = 0, 0
    for cell in order:
        u = rng.random()
        if not u < ceiling[cell]:
            continue
        looked_cells += 1
        least = (math.log(u / (1.0 - u)) if u > 0.0 else -math.inf) - SLACK
        row, column = cell // grid[WIDTH], cell % grid[WIDTH]
        log_odds = prior
        number = list_of(np.int64(cell), marks)
        begin, end = np.int64(0), np.int64(0)
        if number >= 0:
            begin, end = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
        for i in range(begin, end):
            looked_pairs += 1
            log_odds += added(
                np.int64(near[i, 0]), near_bits[i, 1], column, row, cells, records, bits, marks,
                lists, near, near_bits, rays, ray_bits, grid,
            )  # fmt: skip
            if log_odds < least - gain[number]:
                break
        if number >= 0 and full[number]:
            passing = front[lists[number, FRONT] : lists[number + 1, FRONT]]
        else:
            passing = found[: find_front(column, row, tiles, runs, lengths, rays, grid, found)]
        for code in passing:
            if log_odds < least:
                break
            looked_pairs += 1
            log_odds += added(
                np.int64(code), ray_bits[code >> 2, LEVEL], column, row, cells, records, bits,
                marks, lists, near, near_bits, rays, ray_bits, grid,
            )  # fmt: skip
    return looked_cells, looked_pairs
