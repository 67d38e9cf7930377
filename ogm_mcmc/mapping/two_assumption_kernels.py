"""Kernels of the two-assumption update ([gibbs] section II): rays into a log-odds array.

log_odds  (height, width) float32, nats, nan where nothing was ever measured; width % 64 == 0
A cell's first update starts from the prior: l <- l + l(m | z) - l(m), with l(m | z) - l(m) the
step of the inverse model. Rays must lie inside the array; nothing is checked.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import (
    IN_WORD,
    ONE,
    PLAN_SIZE,
    WORD,
    mark_plan,
    plan_ray,
    trace_ray,
)

ONE32 = np.uint32(1)


@njit(cache=True, nogil=True, inline='always')
def updated(old, change, prior, limit):
    """Log-odds of a cell after one more piece of evidence, within the limits."""
    before = prior if old != old else old
    return min(max(before + change, -limit), limit)


@njit(cache=True, nogil=True)
def add_misses(log_odds, free, bottom, top, first_word, last_word, l_free, prior, limit):
    """Add `l_free` to every marked cell of a block of words and clear the marks."""
    words_per_row = log_odds.shape[1] // 64
    cells = log_odds.reshape(-1)
    for row in range(bottom, top + 1):
        for word in range(row * words_per_row + first_word, row * words_per_row + last_word + 1):
            marked = free[np.uint64(word)]
            if marked == 0:
                continue
            free[np.uint64(word)] = 0
            # Two halves of 32, so that one mask bit and one float32 fill equal SIMD lanes.
            for half in range(2):
                mask = np.uint32(marked >> np.uint64(32 * half))
                # Written as `if mask != 0:` around the loop, LLVM makes no SIMD of it (2.3 x).
                if mask == 0:
                    continue
                start = 64 * word + 32 * half
                lane = cells[start : start + 32]
                for i in range(32):
                    old = lane[np.uint64(i)]
                    # `updated` without its upper limit, which a miss never reaches.
                    new = max((prior if old != old else old) + l_free, -limit)
                    lane[np.uint64(i)] = new if (mask >> np.uint32(i)) & ONE32 else old


@njit(cache=True, nogil=True)
def mark_rays(free, words_per_row, column, row, x, y, ends, n_rays):
    """Mark the cells of all rays; return the outermost (left, right, bottom, top).

    These are relative to the cell of the sensor; other arguments as in `fuse_per_scan`.
    """
    plans = np.empty((n_rays, PLAN_SIZE), np.int64)
    left = right = bottom = top = 0.0
    for ray in range(n_rays):
        end_x, end_y = ends[0, ray], ends[1, ray]
        plan_ray(column, row, x, y, end_x, end_y, plans[ray])
        left, right = min(left, end_x), max(right, end_x)
        bottom, top = min(bottom, end_y), max(top, end_y)
    for ray in range(n_rays):
        mark_plan(free, words_per_row, plans[ray])
    return math.floor(left), math.floor(right), math.floor(bottom), math.floor(top)


@njit(cache=True, nogil=True)
def fuse_per_scan(
    log_odds, free, hits, column, row, x, y, ends, hit, n_rays, l_free, l_occ, prior, limit
):
    """Add a scan with every touched cell updated once: a hit beats a miss.

    free, hits  (height * width / 64,) uint64 bit sets, empty before and after
    column, row  cell of the sensor in the array; x, y, ends, hit, n_rays as in `Rays`
    """
    words_per_row = np.uint64(log_odds.shape[1] // 64)
    left, right, bottom, top = mark_rays(free, words_per_row, column, row, x, y, ends, n_rays)
    hit_words = np.empty(n_rays, np.uint64)
    n_hits = 0
    for ray in range(n_rays):
        if hit[ray]:
            c = np.uint64(column + math.floor(ends[0, ray]))
            r = np.uint64(row + math.floor(ends[1, ray]))
            word = r * words_per_row + (c >> WORD)
            bit = ONE << (c & IN_WORD)
            free[word] &= ~bit
            if not hits[word] & bit:
                hits[word] |= bit
                log_odds[r, c] = updated(log_odds[r, c], l_occ, prior, limit)
                hit_words[n_hits] = word
                n_hits += 1
    for k in range(n_hits):
        hits[hit_words[k]] = 0
    add_misses(
        log_odds,
        free,
        row + bottom,
        row + top,
        (column + left) // 64,
        (column + right) // 64,
        l_free,
        prior,
        limit,
    )


@njit(cache=True, nogil=True)
def fuse_per_beam(
    log_odds, columns, rows, column, row, x, y, ends, hit, n_rays, l_free, l_occ, prior, limit
):
    """Add a scan with every beam counted in every cell it crosses ([gibbs] section II).

    columns, rows  (n,) int64 scratch, n at least the cells of the longest ray and three more
    """
    for ray in range(n_rays):
        cells = trace_ray(column, row, x, y, ends[0, ray], ends[1, ray], columns, rows)
        c = column + math.floor(ends[0, ray])
        r = row + math.floor(ends[1, ray])
        for k in range(cells):
            if hit[ray] and columns[k] == c and rows[k] == r:
                continue
            old = log_odds[rows[k], columns[k]]
            log_odds[rows[k], columns[k]] = updated(old, l_free, prior, limit)
        if hit[ray]:
            log_odds[r, c] = updated(log_odds[r, c], l_occ, prior, limit)
