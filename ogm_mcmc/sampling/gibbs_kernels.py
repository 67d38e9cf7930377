"""Kernels of Gibbs sampling over single cells ([gibbs] Algorithm 1); note in the package.

cells    (K,) uint8: the current map, 0 free, 1 occupied
records  (N, 2) int32, one row a ray: position of the first occupied cell, NOTHING if there is
         none, and log p(z | that) as the bits of a float32, so that one look fetches both

Names ending in `_bits` are the same memory as float32. The inner functions take plain arrays,
those of `RayIndex`, and call no further function for an element of one: a tuple of arrays, a view
made per cell or a call per ray makes Numba count references, which takes longer than looking at
the rays themselves (measured: four times the whole sweep).
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.sampling.ray_index_kernels import following_cell

NOTHING = np.int32(2**31 - 1)

# Rounding of sums of up to a million terms stays far below this.
SLACK = 1e-5


@njit(cache=True, nogil=True, inline='always')
def next_hit(ray, position, cell, cells, ray_start, steps, across, up):
    """Position of the first occupied cell of a ray behind `position`, which lies in `cell`."""
    begin, last = ray_start[ray], ray_start[ray + 1] - 1
    at = begin + position
    step_x, step_y = across[ray], up[ray]
    while at < last:
        cell = following_cell(cell, steps[at], step_x, step_y)
        at += 1
        if cells[cell]:
            return np.int32(at - begin)
    return NOTHING


@njit(cache=True, nogil=True)
def find_first_hits(cells, index, records):
    """Fill the records from the map."""
    bits = records.view(np.float32)
    first_cell, ray_start, steps = index.first_cell, index.ray_start, index.steps
    across, up = index.across, index.up
    likelihood, nothing = index.ray_likelihood, index.nothing
    for ray in range(records.shape[0]):
        cell = np.int64(first_cell[ray])
        position = np.int32(0)
        if not cells[cell]:
            position = next_hit(ray, 0, cell, cells, ray_start, steps, across, up)
        records[ray, 0] = position
        bits[ray, 1] = (
            nothing[ray] if position == NOTHING else likelihood[ray_start[ray] + position]
        )


@njit(cache=True, nogil=True, inline='always')
def log_odds_unless_below(
    enough, prior, begin, end, cell, cells, records, bits, pairs, pair_bits, positions,
    ray_start, steps, across, up, likelihood, nothing,
):  # fmt: skip
    """Log-odds that a cell is occupied, given all other cells and all readings ([gibbs] Eq. 3).

    l = prior + sum over the rays not stopped before the cell of
        log p(z | they end here) - log p(z | they end at what is behind), nats.
    Stops adding when the sum is below `enough`, and returns what it has then.
    """
    log_odds = prior
    for i in range(begin, end):
        ray, position = pairs[i, 0], np.int32(positions[i])
        first = records[ray, 0]
        if first > position:
            log_odds += np.float64(pair_bits[i, 1]) - np.float64(bits[ray, 1])
        elif first == position:
            behind = next_hit(ray, position, np.int64(cell), cells, ray_start, steps, across, up)
            now = nothing[ray] if behind == NOTHING else likelihood[ray_start[ray] + behind]
            log_odds += np.float64(pair_bits[i, 1]) - np.float64(now)
        if log_odds < enough:
            return log_odds
    return log_odds


@njit(cache=True, nogil=True)
def conditional_log_odds(cell, cells, records, index, prior):
    """Log-odds of one cell given all others, to the last ray; see `log_odds_unless_below`."""
    return log_odds_unless_below(
        -math.inf, prior, index.cell_start[cell], index.cell_start[cell + 1], cell, cells,
        records, records.view(np.float32), index.pairs, index.pairs.view(np.float32),
        index.positions, index.ray_start, index.steps, index.across, index.up,
        index.ray_likelihood, index.nothing,
    )  # fmt: skip


@njit(cache=True, nogil=True, inline='always')
def shorten_rays(begin, end, records, bits, pairs, pair_bits, positions):
    """Let the rays that pass a newly occupied cell end in it."""
    for i in range(begin, end):
        ray, position = pairs[i, 0], np.int32(positions[i])
        if records[ray, 0] > position:
            records[ray, 0] = position
            bits[ray, 1] = pair_bits[i, 1]


@njit(cache=True, nogil=True, inline='always')
def lengthen_rays(
    begin, end, cell, cells, records, bits, pairs, positions, ray_start, steps, across, up,
    likelihood, nothing,
):  # fmt: skip
    """Let the rays that ended in a newly free cell go on to what is behind."""
    for i in range(begin, end):
        ray, position = pairs[i, 0], np.int32(positions[i])
        if records[ray, 0] == position:
            behind = next_hit(ray, position, np.int64(cell), cells, ray_start, steps, across, up)
            records[ray, 0] = behind
            bits[ray, 1] = (
                nothing[ray] if behind == NOTHING else likelihood[ray_start[ray] + behind]
            )


@njit(cache=True, nogil=True)
def sweep_cells(rng, order, cells, records, index, ceiling, prior):
    """Draw every cell of `order` once from its conditional; return the number of flips.

    ceiling  (K,) float32: no map of the other cells gives a cell a higher probability
    A cell is occupied when u < p, u uniform. Where u is not below the ceiling it is free, and no
    ray has to be looked at; elsewhere rays are added until what the others can add at most
    (`index.gain`) does not matter any more. Neither changes any draw.
    """
    return sweep_arrays(
        rng, order, cells, records, records.view(np.float32), index.cell_start, index.pairs,
        index.pairs.view(np.float32), index.positions, index.gain, index.ray_start, index.steps,
        index.across, index.up, index.ray_likelihood, index.nothing, ceiling, prior,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def sweep_arrays(
    rng, order, cells, records, bits, cell_start, pairs, pair_bits, positions, gain, ray_start,
    steps, across, up, likelihood, nothing, ceiling, prior,
):  # fmt: skip
    """Sweep over all cells of `order` once; return the flips. Arguments: see `sweep_cells`."""
    flips = 0
    for j in range(order.size):
        cell = order[j]
        u = rng.random()
        possible = u < ceiling[cell]
        if not (possible or cells[cell]):
            continue
        begin, end = cell_start[cell], cell_start[cell + 1]
        occupied = False
        if possible:
            threshold = math.log(u / (1.0 - u)) if u > 0.0 else -math.inf
            log_odds = log_odds_unless_below(
                threshold - gain[cell] - SLACK, prior, begin, end, cell, cells, records, bits,
                pairs, pair_bits, positions, ray_start, steps, across, up, likelihood, nothing,
            )  # fmt: skip
            occupied = log_odds > threshold
        if occupied and not cells[cell]:
            cells[cell] = 1
            shorten_rays(begin, end, records, bits, pairs, pair_bits, positions)
            flips += 1
        elif cells[cell] and not occupied:
            cells[cell] = 0
            lengthen_rays(
                begin, end, cell, cells, records, bits, pairs, positions, ray_start, steps,
                across, up, likelihood, nothing,
            )  # fmt: skip
            flips += 1
    return flips


@njit(cache=True, nogil=True)
def add_occupied(cells, touched, counts):
    """Count the occupied among the touched cells: counts (C,) uint32."""
    for j in range(touched.size):
        counts[j] += cells[touched[j]]
