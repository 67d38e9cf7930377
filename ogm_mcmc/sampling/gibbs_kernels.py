"""Kernels of Gibbs sampling over single cells ([gibbs] Algorithm 1); note in the package.

cells    (K,) uint8: the current map, 0 free, 1 occupied
records  (N, 4) int32, one row a ray: the place (see `ray_line_kernels`) of the first occupied
         cell, NOTHING if there is none, and log p(z | that) as the bits of a float32, so that one
         look fetches both; the same of the first occupied cell behind that one, with UNTOLD as
         its place where nobody has looked. Of a ray that hits nothing the last two say nothing

Names ending in `_bits` are the same memory as float32. All kernels take plain arrays, those of
`RayIndex.arrays()`: a tuple of arrays or a view made per cell makes Numba count references, which
takes longer than looking at the rays themselves (measured: four times the whole sweep). Each
borrows them at its beginning (see `borrowed_arrays`).

What is called once a cell is a function of its own, what is called once a ray is inlined, or
sweeps are slower by 40 %: by LLVM (`inlined`), after Numba has read and typed it once, not by
Numba itself (`inline='always'`), which does so for every place it is called from. That and no
wrappers for C callbacks (`no_cfunc_wrapper`) brought the time to compile all kernels of a sampler
from 24.2 to 16.0 s of the processor; borrowing in every function made sweeps 14 % faster
(Intel, 5 cm, pairs in one run on a busy machine, the same draws).

What lies behind the first hit of a ray is asked for in every draw of the cell that it ends in, and
seldom changes: so it is kept where it was found. In the same cache line as the first hit, sweeps
that count take .8 of the time (38 instead of 48 ms for patches in doubt, 18 instead of 20 for
others), full ones .9; in a half of the array of its own .9 and 1.1 (as above). It costs 8 bytes a
ray and chain.
"""

import math

import numpy as np

from ogm_mcmc.sampling.borrowed_arrays import borrowed
from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_index_kernels import (
    FRONT,
    NEAR,
    WIDTH,
    hit_behind,
    list_of,
    reaches_in_front,
    tile_of,
)
from ogm_mcmc.sampling.ray_line_kernels import (
    LEVEL,
    SHAPE,
    place_of,
)

# Where the next ray of a cell comes from.
FROM_NEAR, FROM_FRONT, FROM_TILE = range(3)

# Rounding of sums of up to a million terms stays far below this.
SLACK = 1e-5

# Lies before all places: what is behind the first hit of a ray has to be looked for.
UNTOLD = np.int32(-(2**31))

# Counts are in parts of a map, so that probabilities can be counted, too.
PARTS = 64
NO_CHANCE = np.uint8(255)


@inlined
def behind_first(
    code, column, row, cells, records, bits, marks, lists, near, near_bits, rays, ray_bits, grid
):  # fmt: skip
    """Return (place, log-likelihood) of the first hit of a ray behind its present first one.

    That is the cell at `column` and `row`. What nobody has looked for yet is found and kept.
    """
    if records[code >> 2, 2] == UNTOLD:
        place, value = hit_behind(
            code, column, row, cells, marks, lists, near, near_bits, rays, ray_bits, grid
        )
        records[code >> 2, 2] = place
        bits[code >> 2, 3] = value
    return records[code >> 2, 2], bits[code >> 2, 3]


@kernel
def log_odds_unless_below(
    threshold, prior, cell, cells, records, bits, marks, lists, full, gain, near, near_bits,
    front, tiles, runs, run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Log-odds that a cell is occupied, given all other cells and all readings ([gibbs] Eq. 3).

    l = prior + sum over the rays not stopped before the cell of
        log p(z | they end here) - log p(z | they end at what is behind), nats.
    Rays that it is near to come first; those that only pass far in front can but lower the sum.
    Stops adding when the sum is sure to end below `threshold`, and returns what it has then.
    """
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    marks, lists, full, gain = borrowed(marks), borrowed(lists), borrowed(full), borrowed(gain)
    near, near_bits, front = borrowed(near), borrowed(near_bits), borrowed(front)
    tiles, runs, run_lengths = borrowed(tiles), borrowed(runs), borrowed(run_lengths)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    row = cell // grid[WIDTH]
    column = cell - row * grid[WIDTH]
    log_odds = prior
    enough = threshold - SLACK
    source, at, last = FROM_NEAR, np.int64(0), np.int64(0)
    ray, last_ray = np.int64(0), np.int64(0)
    number = list_of(cell, marks)
    if number >= 0:
        at, last = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
        enough -= gain[number]
    while True:
        if source == FROM_TILE:
            if ray == last_ray:
                if at == last:
                    break
                ray, last_ray = np.int64(runs[at]), np.int64(runs[at]) + run_lengths[at]
                at += 1
            code = (ray << 2) | ((rays[ray, SHAPE] >> 48) & 3)
            passes = reaches_in_front(ray, column, row, rays)
            ray += 1
            if not passes:
                continue
            value = ray_bits[code >> 2, LEVEL]
        elif at == last:
            if source == FROM_FRONT:
                break
            enough = threshold - SLACK
            if log_odds < enough:
                break
            source = FROM_TILE
            if number >= 0 and full[number]:
                source = FROM_FRONT
            if source == FROM_FRONT:
                at, last = np.int64(lists[number, FRONT]), np.int64(lists[number + 1, FRONT])
            else:
                tile = tile_of(column, row, grid)
                at, last = np.int64(tiles[tile]), np.int64(tiles[tile + 1])
            continue
        elif source == FROM_NEAR:
            code, value = np.int64(near[at, 0]), near_bits[at, 1]
            at += 1
        else:
            code = np.int64(front[at])
            value = ray_bits[code >> 2, LEVEL]
            at += 1
        place = place_of(code, column, row)
        first = records[code >> 2, 0]
        if first < place:
            continue
        now = bits[code >> 2, 1]
        if first == place:
            _, now = behind_first(
                code, column, row, cells, records, bits, marks, lists, near, near_bits, rays,
                ray_bits, grid,
            )  # fmt: skip
        log_odds += np.float64(value) - np.float64(now)
        if log_odds < enough:
            break
    return log_odds


@kernel
def redirect_rays(
    cell, cells, records, bits, marks, lists, full, near, near_bits, front, tiles, runs,
    run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Let rays end in a cell that is occupied now, or go on behind one that is free now."""
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    marks, lists, full = borrowed(marks), borrowed(lists), borrowed(full)
    near, near_bits, front = borrowed(near), borrowed(near_bits), borrowed(front)
    tiles, runs, run_lengths = borrowed(tiles), borrowed(runs), borrowed(run_lengths)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    row = cell // grid[WIDTH]
    column = cell - row * grid[WIDTH]
    occupied = cells[cell] != 0
    source, at, last = FROM_NEAR, np.int64(0), np.int64(0)
    ray, last_ray = np.int64(0), np.int64(0)
    number = list_of(cell, marks)
    if number >= 0:
        at, last = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
    while True:
        if source == FROM_TILE:
            if ray == last_ray:
                if at == last:
                    break
                ray, last_ray = np.int64(runs[at]), np.int64(runs[at]) + run_lengths[at]
                at += 1
            code = (ray << 2) | ((rays[ray, SHAPE] >> 48) & 3)
            passes = reaches_in_front(ray, column, row, rays)
            ray += 1
            if not passes:
                continue
            value = ray_bits[code >> 2, LEVEL]
        elif at == last:
            if source == FROM_FRONT:
                break
            source = FROM_TILE
            if number >= 0 and full[number]:
                source = FROM_FRONT
            if source == FROM_FRONT:
                at, last = np.int64(lists[number, FRONT]), np.int64(lists[number + 1, FRONT])
            else:
                tile = tile_of(column, row, grid)
                at, last = np.int64(tiles[tile]), np.int64(tiles[tile + 1])
            continue
        elif source == FROM_NEAR:
            code, value = np.int64(near[at, 0]), near_bits[at, 1]
            at += 1
        else:
            code = np.int64(front[at])
            value = ray_bits[code >> 2, LEVEL]
            at += 1
        place = place_of(code, column, row)
        first = records[code >> 2, 0]
        if occupied:
            if first > place:
                records[code >> 2, 2] = first
                bits[code >> 2, 3] = bits[code >> 2, 1]
                records[code >> 2, 0] = place
                bits[code >> 2, 1] = value
            elif records[code >> 2, 2] > place:
                records[code >> 2, 2] = place
                bits[code >> 2, 3] = value
        elif first == place:
            behind, now = behind_first(
                code, column, row, cells, records, bits, marks, lists, near, near_bits, rays,
                ray_bits, grid,
            )  # fmt: skip
            records[code >> 2, 0] = behind
            bits[code >> 2, 1] = now
            records[code >> 2, 2] = UNTOLD
        elif records[code >> 2, 2] == place:
            records[code >> 2, 2] = UNTOLD


@kernel
def sweep_cells(
    rng, order, cells, records, bits, ceiling, prior, marks, lists, full, gain, near, near_bits,
    front, tiles, runs, run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Draw every cell of `order` once from its conditional; return the number of flips.

    ceiling  (K,) float32: no map of the other cells gives a cell a higher probability
    A cell is occupied when u < p, u uniform. Where u is not below the ceiling it is free, and no
    ray has to be looked at; elsewhere rays are added until what the others can add at most
    (`gain`) does not matter any more. Neither changes any draw.
    """
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    marks, lists, full, gain = borrowed(marks), borrowed(lists), borrowed(full), borrowed(gain)
    near, near_bits, front = borrowed(near), borrowed(near_bits), borrowed(front)
    tiles, runs, run_lengths = borrowed(tiles), borrowed(runs), borrowed(run_lengths)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    flips = 0
    for j in range(order.size):
        cell = np.int64(order[j])
        u = rng.random()
        possible = u < ceiling[cell]
        if not (possible or cells[cell]):
            continue
        occupied = False
        if possible:
            threshold = math.log(u / (1.0 - u)) if u > 0.0 else -math.inf
            log_odds = log_odds_unless_below(
                threshold, prior, cell, cells, records, bits, marks, lists, full, gain, near,
                near_bits, front, tiles, runs, run_lengths, rays, ray_bits, grid,
            )  # fmt: skip
            occupied = log_odds > threshold
        if occupied != (cells[cell] != 0):
            cells[cell] = occupied
            redirect_rays(
                cell, cells, records, bits, marks, lists, full, near, near_bits, front, tiles,
                runs, run_lengths, rays, ray_bits, grid,
            )  # fmt: skip
            flips += 1
    return flips


@kernel
def add_occupied(cells, chances, touched, counts):
    """Count the occupied among the touched cells: counts (C,), in `PARTS`.

    chances  (K,) uint8: the probability that a cell was last drawn with, in `PARTS`, counts in
             place of what was drawn; used up, that is NO_CHANCE again afterwards
    """
    for j in range(touched.size):
        cell = touched[j]
        if chances[cell] == NO_CHANCE:
            counts[j] += cells[cell] * PARTS
        else:
            counts[j] += chances[cell]
            chances[cell] = NO_CHANCE
