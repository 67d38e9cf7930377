"""Kernels of the counting model ([slides]): hits and misses of every cell.

hits, misses  (height, width) uint32; width % 64 == 0
Rays must lie inside the arrays; nothing is checked.
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
MANY = np.uint32(2**31)


@njit(cache=True, nogil=True)
def add_marked(counts, marks, bottom, top, first_word, last_word):
    """Add 1 to every marked cell of a block of words and clear the marks."""
    words_per_row = counts.shape[1] // 64
    cells = counts.reshape(-1)
    for row in range(bottom, top + 1):
        for word in range(row * words_per_row + first_word, row * words_per_row + last_word + 1):
            marked = marks[np.uint64(word)]
            if marked == 0:
                continue
            marks[np.uint64(word)] = 0
            for half in range(2):
                mask = np.uint32(marked >> np.uint64(32 * half))
                if mask == 0:
                    continue
                lane = cells[64 * word + 32 * half : 64 * word + 32 * half + 32]
                for i in range(32):
                    lane[np.uint64(i)] += (mask >> np.uint32(i)) & ONE32


@njit(cache=True, nogil=True)
def count_per_scan(hits, misses, free, ended, column, row, x, y, ends, hit, n_rays):
    """Count a scan once in every touched cell: a hit beats a miss.

    free, ended  (height * width / 64,) uint64 bit sets, empty before and after
    column, row  cell of the sensor in the array; x, y, ends, hit, n_rays as in `Rays`
    """
    words_per_row = np.uint64(misses.shape[1] // 64)
    plans = np.empty((n_rays, PLAN_SIZE), np.int64)
    left = right = bottom = top = 0.0
    for ray in range(n_rays):
        end_x, end_y = ends[0, ray], ends[1, ray]
        plan_ray(column, row, x, y, end_x, end_y, plans[ray])
        left, right = min(left, end_x), max(right, end_x)
        bottom, top = min(bottom, end_y), max(top, end_y)
    for ray in range(n_rays):
        mark_plan(free, words_per_row, plans[ray])
    for ray in range(n_rays):
        if hit[ray]:
            c = np.uint64(column + math.floor(ends[0, ray]))
            r = np.uint64(row + math.floor(ends[1, ray]))
            word, bit = r * words_per_row + (c >> WORD), ONE << (c & IN_WORD)
            free[word] &= ~bit
            ended[word] |= bit
    first_row, last_row = row + math.floor(bottom), row + math.floor(top)
    first = (column + math.floor(left)) // 64
    last = (column + math.floor(right)) // 64
    add_marked(misses, free, first_row, last_row, first, last)
    add_marked(hits, ended, first_row, last_row, first, last)


@njit(cache=True, nogil=True)
def count_per_beam(hits, misses, columns, rows, column, row, x, y, ends, hit, n_rays):
    """Count every beam in every cell it crosses or ends in.

    columns, rows  (n,) int64 scratch, n at least the cells of the longest ray and three more
    Before a count overflows both of a cell are halved: what matters is their ratio.
    """
    for ray in range(n_rays):
        cells = trace_ray(column, row, x, y, ends[0, ray], ends[1, ray], columns, rows)
        end_c = column + math.floor(ends[0, ray])
        end_r = row + math.floor(ends[1, ray])
        for k in range(cells):
            c, r = columns[k], rows[k]
            if not (hit[ray] and c == end_c and r == end_r):
                misses[r, c] += ONE32
                if misses[r, c] >= MANY:
                    misses[r, c] //= np.uint32(2)
                    hits[r, c] //= np.uint32(2)
        if hit[ray]:
            hits[end_r, end_c] += ONE32
            if hits[end_r, end_c] >= MANY:
                misses[end_r, end_c] //= np.uint32(2)
                hits[end_r, end_c] //= np.uint32(2)
