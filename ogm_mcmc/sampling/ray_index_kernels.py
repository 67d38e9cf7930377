"""Kernels that build the ray index; its layout is described in `ogm_mcmc.sampling.ray_index`.

Rays come as `BeamRays`, in cells of the window. Nothing is checked: every ray must lie inside.
"""

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import trace_ray
from ogm_mcmc.sensors.forward_model_kernels import (
    level_log_likelihood,
    range_log_likelihood,
    unseen_log_likelihood,
)

# Which way a ray goes on from a cell.
ACROSS, UP = np.uint8(1), np.uint8(2)


@njit(cache=True, nogil=True, inline='always')
def following_cell(cell, step, across, up):
    """Return the cell behind one: `step` says along which axes, `across` and `up` how far."""
    if step == ACROSS:
        return cell + across
    if step == UP:
        return cell + up
    return cell + across + up


@njit(cache=True, nogil=True, inline='always')
def per_unit(direction):
    """Reciprocal of one component of a direction, huge where the ray never moves that way."""
    if abs(direction) > 1e-300:
        return 1.0 / direction
    return 1e300 if direction >= 0.0 else -1e300


@njit(cache=True, nogil=True, inline='always')
def sum_rounded_up(total, term):
    """Add to a float32 that must not become less than the sum: a bound stays a bound."""
    exact = np.float64(total) + term
    rounded = np.float32(exact)
    return rounded if rounded >= exact else np.float32(exact * (1.0 + 2.0**-23))


@njit(cache=True, nogil=True)
def longest_ray(lengths):
    """Return more cells than any ray of these lengths crosses."""
    longest = 0
    for length in lengths:
        longest = max(longest, int(2.0 * length) + 6)
    return longest


@njit(cache=True, nogil=True)
def trace_rays(
    rays, width, resolution, model, ray_start, first_cell, across, up, steps, likelihood, nothing,
    counts,
):  # fmt: skip
    """Follow rays cell by cell; return how many pairs of ray and cell there are now.

    ray_start, first_cell, across, up, nothing, steps, likelihood  as in `RayIndex`, output
    counts  (K,) int64, in and out: pairs per cell
    The distance of a cell lies `model.depth` of the way through it.
    """
    longest = longest_ray(rays.length)
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    at = ray_start[0]
    for n in range(rays.length.size):
        x, y, ux, uy = rays.x[n], rays.y[n], rays.ux[n], rays.uy[n]
        length, reading, reach = rays.length[n], rays.reading[n], rays.reach[n]
        # Not plain zeros: Numba would compile `trace_ray` once more for them.
        zero = np.int64(0)
        count = trace_ray(zero, zero, x, y, x + length * ux, y + length * uy, columns, rows)
        first_cell[n] = rays.row[n] * width + rays.column[n]
        across[n] = 1 if ux > 0.0 else -1
        up[n] = width if uy > 0.0 else -width
        nothing[n] = unseen_log_likelihood(model, reading, reach, length * resolution)
        level, near = level_log_likelihood(model, reading, reach)
        near_to = min(reading, reach)
        # A ray leaves a cell by its right or left, and by its upper or lower border; one that
        # runs along an axis never meets the border beside it.
        right, upper = (1.0 if ux >= 0.0 else 0.0), (1.0 if uy >= 0.0 else 0.0)
        per_x, per_y = per_unit(ux), per_unit(uy)
        cell = np.int64(first_cell[n])
        entering = 0.0
        for p in range(count):
            counts[cell] += 1
            leaving_x = (columns[p] + right - x) * per_x
            leaving_y = (rows[p] + upper - y) * per_y
            # Next to a corner rounding may let a ray leave a cell before it comes in.
            leaving = max(min(leaving_x, leaving_y), entering)
            distance = (entering + model.depth * (leaving - entering)) * resolution
            value = level
            if abs(distance - near_to) < near:
                value = range_log_likelihood(model, reading, reach, distance)
            likelihood[at + p] = value
            step = np.uint8(0)
            if p + 1 < count:
                if columns[p + 1] != columns[p]:
                    step |= ACROSS
                if rows[p + 1] != rows[p]:
                    step |= UP
            steps[at + p] = step
            cell = following_cell(cell, step, across[n], up[n])
            entering = leaving
        at += count
        ray_start[n + 1] = at
    return at


@njit(cache=True, nogil=True)
def spread_pairs(before, after, pairs, positions):
    """Move the pairs of every cell to where the cell begins now, last cell first.

    before, after  (K + 1,) int64: old and new beginnings, after >= before
    """
    for cell in range(before.size - 2, -1, -1):
        shift = after[cell] - before[cell]
        if shift == 0:
            return  # nothing before it moves either
        for i in range(before[cell + 1] - 1, before[cell] - 1, -1):
            pairs[i + shift, 0] = pairs[i, 0]
            pairs[i + shift, 1] = pairs[i, 1]
            positions[i + shift] = positions[i]


@njit(cache=True, nogil=True)
def file_rays(
    first_ray, ends, ray_start, first_cell, across, up, steps, likelihood, nothing, pairs,
    positions, gain,
):  # fmt: skip
    """Enter the rays from `first_ray` on under the cells they cross.

    ends  (K,) int64, in and out: where the next pair of each cell goes
    Adds to `gain` what each pair can at most add to the log-odds of its cell: the likelihood of
    ending there less the lowest of what lies behind.
    """
    bits = pairs.view(np.float32)
    longest = np.int64(1)
    for n in range(first_ray, first_cell.size):
        longest = max(longest, ray_start[n + 1] - ray_start[n])
    cells = np.empty(longest, np.int64)
    for n in range(first_ray, first_cell.size):
        begin = ray_start[n]
        count = ray_start[n + 1] - begin
        cell = np.int64(first_cell[n])
        for p in range(count):
            cells[p] = cell
            i = ends[cell]
            ends[cell] = i + 1
            pairs[i, 0] = n
            bits[i, 1] = likelihood[begin + p]
            positions[i] = p
            cell = following_cell(cell, steps[begin + p], across[n], up[n])
        lowest = np.float64(nothing[n])
        for p in range(count - 1, -1, -1):
            here = np.float64(likelihood[begin + p])
            if here > lowest:
                gain[cells[p]] = sum_rounded_up(gain[cells[p]], here - lowest)
            else:
                lowest = here
