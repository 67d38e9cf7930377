"""Kernels that draw cells where likelihoods vary all along rays; why: `ogm_mcmc.sampling.misfits`.

best      (N,) float32: the highest log-likelihood that a ray can have, whatever the map
reached   (K,) uint8: REACHED where a ray arrived since the sweep began, MISSED where one did that
          was a misfit then, its log-likelihood lower than its best by more than `MOST_MISSED`
"""

import math

import numpy as np

from ogm_mcmc.geometry.traversal_kernels import SHIFT
from ogm_mcmc.sampling.borrowed_arrays import borrowed
from ogm_mcmc.sampling.gibbs_kernels import SLACK, UNTOLD
from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_index_kernels import NEAR, WIDTH, hit_behind, list_of
from ogm_mcmc.sampling.ray_line_kernels import (
    BEGINS_LEFT,
    BORDER,
    LOW_16,
    LOW_32,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    UPWARDS,
    place_of,
    row_of_ray,
)

# Nats: 4 sigma of a Gaussian.
MOST_MISSED = 8.0

REACHED, MISSED = np.uint8(1), np.uint8(2)


@kernel
def bound_of_fitting(lists, near, near_bits, ray_bits, best, most):
    """Fill `best` (N,), and in `most` (S,) what the rays of each list add at most if all fit."""
    for ray in range(best.size):
        best[ray] = ray_bits[ray, UNSEEN]
    for i in range(near.shape[0]):
        ray = near[i, 0] >> 2
        best[ray] = max(best[ray], near_bits[i, 1])
    for number in range(most.size):
        total = 0.0
        for i in range(lists[number, NEAR], lists[number + 1, NEAR]):
            lowest = np.float64(best[near[i, 0] >> 2]) - MOST_MISSED
            total += max(np.float64(near_bits[i, 1]) - lowest, 0.0)
        most[number] = np.float32(total * (1.0 + 1e-6))


@kernel
def mark_reached(ray, column, row, bits, records, best, reached, rays, width):
    """Mark the cells of a ray from one that it crosses up to its first hit, that included.

    Those of a misfit from its beginning.
    """
    mark = REACHED
    if np.float64(bits[ray, 1]) < np.float64(best[ray]) - MOST_MISSED:
        mark = MISSED
        column, row = rays[ray, START] & LOW_32, rays[ray, START] >> 32
    border, slope, start, shape = (
        rays[ray, BORDER], rays[ray, SLOPE], rays[ray, START], rays[ray, SHAPE]
    )  # fmt: skip
    flags, last = shape >> 48, shape & LOW_16
    across = 1 if flags & RIGHTWARDS else -1
    up = 1 if flags & UPWARDS else -1
    left = min(np.int64(records[ray, 0]), np.int64(2**30)) - place_of(flags, column, row)
    at = (row - (start >> 32)) * up
    while True:
        _, ends, behind = row_of_ray(border, slope, start, shape, row)
        cell = row * width + column
        steps = min((ends - column) * across, left)
        for _ in range(steps + 1):
            reached[cell] |= mark
            cell += across
        left -= steps + 1
        if left < 0 or at == last:
            break
        at += 1
        row += up
        column = (behind - (1 if flags & BEGINS_LEFT else 0)) >> SHIFT


@inlined
def log_odds_of_lists(
    enough, prior, begin, end, column, row, cells, records, bits, marks, lists, near, near_bits,
    rays, ray_bits, grid,
):  # fmt: skip
    """As `log_odds_unless_below`, of a cell all of whose rays are in its list, in that order."""
    log_odds = prior
    for i in range(begin, end):
        code = np.int64(near[i, 0])
        place, first = place_of(code, column, row), records[code >> 2, 0]
        if first < place:
            continue
        now = bits[code >> 2, 1]
        if first == place:
            _, now = hit_behind(
                code, column, row, cells, marks, lists, near, near_bits, rays, ray_bits, grid
            )
        log_odds += np.float64(near_bits[i, 1]) - np.float64(now)
        if log_odds < enough:
            break
    return log_odds


@kernel
def sweep_lists(
    rng, order, cells, records, bits, ceiling, prior, best, most, fitting_ceiling, reached,
    marks, lists, gain, near, near_bits, rays, ray_bits, grid,
):  # fmt: skip
    """Draw every cell of `order` once, as `sweep_cells` does; return the number of flips.

    most, fitting_ceiling  what `gain` and `ceiling` are of free cells that no misfit reaches
    reached  of no ray; filled here
    What lies behind first hits is told of no ray afterwards.
    """
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    marks, lists, gain = borrowed(marks), borrowed(lists), borrowed(gain)
    near, near_bits = borrowed(near), borrowed(near_bits)
    best, most, reached = borrowed(best), borrowed(most), borrowed(reached)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    width = grid[WIDTH]
    for n in range(records.shape[0]):
        start = rays[n, START]
        mark_reached(n, start & LOW_32, start >> 32, bits, records, best, reached, rays, width)
        records[n, 2] = UNTOLD
    flips = 0
    for j in range(order.size):
        cell = np.int64(order[j])
        u = rng.random()
        how = reached[cell]
        fits = how < MISSED and not cells[cell]
        possible = u < (fitting_ceiling[cell] if fits else ceiling[cell])
        if not (possible or cells[cell]):
            continue
        row = cell // width
        column = cell - row * width
        number = np.int64(-1)
        if how:
            number = list_of(cell, marks)
        begin, end = np.int64(0), np.int64(0)
        if number >= 0:
            begin, end = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
        occupied = False
        if possible:
            threshold = math.log(u / (1.0 - u)) if u > 0.0 else -math.inf
            enough = threshold - SLACK
            if number >= 0:
                enough -= most[number] if fits else gain[number]
            occupied = threshold < log_odds_of_lists(
                enough, prior, begin, end, column, row, cells, records, bits, marks, lists, near,
                near_bits, rays, ray_bits, grid,
            )  # fmt: skip
        if occupied == (cells[cell] != 0):
            continue
        cells[cell] = occupied
        flips += 1
        for i in range(begin, end):
            code = np.int64(near[i, 0])
            ray = code >> 2
            place, first = place_of(code, column, row), records[ray, 0]
            if occupied and first > place:
                records[ray, 0] = place
                bits[ray, 1] = near_bits[i, 1]
            elif not occupied and first == place:
                behind, now = hit_behind(
                    code, column, row, cells, marks, lists, near, near_bits, rays, ray_bits, grid
                )
                records[ray, 0] = behind
                bits[ray, 1] = now
            else:
                continue
            mark_reached(ray, column, row, bits, records, best, reached, rays, width)
    return flips
