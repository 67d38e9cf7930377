"""Kernels that average the evidence of one scan, every beam counting, over samples of its pose.

Arguments as in `evidence_kernels`. The step model goes run by run: `l_free` for each crossed cell,
and what is missing to `l_occ` for the one a beam ended in.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import (
    END,
    FIRST_ROW,
    HERE,
    LEAVING,
    ONE,
    PLAN_SIZE,
    RIGHTWARDS,
    ROWS_UP,
    SHIFT,
    STEP,
    mark_run,
    plan_ray,
)
from ogm_mcmc.mapping.evidence_kernels import cell_log_odds, list_cells, stretch


@njit(cache=True, nogil=True, inline='always')
def add_run(evidence, seen, row_start, first, last, change):
    """Add a number to columns `first` to `last` of the row whose words begin at `row_start`."""
    mark_run(seen, row_start, first, last)
    cell = row_start * np.uint64(64)
    for column in range(first, last + ONE):
        evidence[cell + column] += change


@njit(cache=True, nogil=True, inline='always')
def add_plan(evidence, seen, words_per_row, plan, change):
    """Do to every cell of a planned segment what `add_run` does; see `mark_plan`."""
    here, end, leaving, step = plan[HERE], plan[END], plan[LEAVING], plan[STEP]
    rows_up = plan[ROWS_UP]
    start = np.uint64(plan[FIRST_ROW]) * words_per_row
    if rows_up == 0:
        left, right = np.uint64(min(here, end) >> SHIFT), np.uint64(max(here, end) >> SHIFT)
        add_run(evidence, seen, start, left, right, change)
    elif plan[RIGHTWARDS]:
        first = here >> SHIFT
        for _ in range(rows_up):
            last = (leaving - 1) >> SHIFT
            add_run(evidence, seen, start, np.uint64(first), np.uint64(last), change)
            first = leaving >> SHIFT
            leaving += step
            start += words_per_row
        last = max(first, end >> SHIFT)
        add_run(evidence, seen, start, np.uint64(first), np.uint64(last), change)
    else:
        last = here >> SHIFT
        for _ in range(rows_up):
            first = leaving >> SHIFT
            add_run(evidence, seen, start, np.uint64(first), np.uint64(last), change)
            last = first
            leaving += step
            start += words_per_row
        first = min(last, end >> SHIFT)
        add_run(evidence, seen, start, np.uint64(first), np.uint64(last), change)


@njit(cache=True, nogil=True)
def sum_steps_per_beam(
    evidence, seen, words, cells, places, ends, hit, n_rays, weights, l_free, l_occ
):
    """Sum the evidence of a scan over its samples, every beam counting in each cell it crosses."""
    words_per_row = np.uint64(words)
    plans = np.empty((n_rays, PLAN_SIZE), np.int64)
    for k in range(weights.size):
        column, row = cells[k, 0], cells[k, 1]
        x, y = places[k, 0], places[k, 1]
        missed, more = weights[k] * l_free, weights[k] * (l_occ - l_free)
        for ray in range(n_rays):
            plan_ray(column, row, x, y, ends[k, 0, ray], ends[k, 1, ray], plans[ray])
        for ray in range(n_rays):
            add_plan(evidence, seen, words_per_row, plans[ray], missed)
            if hit[ray]:
                c = np.uint64(column + math.floor(ends[k, 0, ray]))
                r = np.uint64(row + math.floor(ends[k, 1, ray]))
                evidence[r * words_per_row * np.uint64(64) + c] += more


@njit(cache=True, nogil=True)
def sum_gaussians_per_beam(
    evidence, seen, words, cells, places, ends, hit, n_rays, weights, reach, model
):
    """Do the same with the Gaussian model, cell by cell."""
    longest = 2 * np.int64(math.ceil(reach)) + 8
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    for k in range(weights.size):
        column, row = cells[k, 0], cells[k, 1]
        x, y = places[k, 0], places[k, 1]
        for ray in range(n_rays):
            end_x, end_y = ends[k, 0, ray], ends[k, 1, ray]
            _, last, length = stretch(x, y, end_x, end_y, hit[ray], reach, model)
            count = list_cells(
                column, row, x, y, x + last * (end_x - x), y + last * (end_y - y), columns, rows
            )
            for i in range(count):
                c, r = columns[i], rows[i]
                value = model.l_free
                if hit[ray]:
                    value = cell_log_odds(c - column, r - row, x, y, length, model)
                seen[np.uint64(r * words + (c >> 6))] |= ONE << np.uint64(c & 63)
                evidence[r * words * 64 + c] += weights[k] * value
