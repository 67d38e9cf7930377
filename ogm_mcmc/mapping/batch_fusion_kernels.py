"""Kernels of the two-assumption update for many scans at once: the same numbers, bit for bit.

Most of what a scan does is to miss: the same step for every cell that a beam crosses. Misses are
counted, 64 cells at a time, and come to the log-odds when the cell is hit, or at the end: one
after the other and in their place among the hits, so that limits and rounding are those of scan
after scan. What is touched for each scan is an eighth of the memory.

counters  (height * width / 64, PLANES) uint64: bit p of how often each cell of a word was missed
Other arguments: see `two_assumption_kernels.fuse_per_scan`.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import IN_WORD, ONE, WORD
from ogm_mcmc.mapping.two_assumption_kernels import mark_rays, updated

# As many as a cache line holds.
PLANES = 8

ONE32 = np.uint32(1)


@njit(cache=True, nogil=True)
def missed(value, times, l_free, prior, limit):
    """Log-odds after so many misses; nan after none of a cell that was never measured."""
    if times > 0 and value != value:
        value = prior
    for _ in range(times):
        new = max(value + l_free, -limit)
        if new == value:
            break
        value = new
    return value


@njit(cache=True, nogil=True, inline='always')
def take_count(counters, word, bit):
    """Return how often a cell was missed, and set that to 0."""
    times = 0
    for plane in range(PLANES):
        if counters[word, plane] & bit:
            times += 1 << plane
            counters[word, plane] ^= bit
    return times


@njit(cache=True, nogil=True)
def count_scan(
    log_odds, free, hits, counters, column, row, x, y, ends, hit, n_rays, l_free, l_occ, prior,
    limit,
):  # fmt: skip
    """Count the misses of a scan; cells that it hits are brought up to date."""
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
                times = take_count(counters, word, bit)
                before = missed(log_odds[r, c], times, l_free, prior, limit)
                log_odds[r, c] = updated(before, l_occ, prior, limit)
                hit_words[n_hits] = word
                n_hits += 1
    for k in range(n_hits):
        hits[hit_words[k]] = 0
    cells = log_odds.reshape(-1)
    for up in range(row + bottom, row + top + 1):
        start = up * np.int64(words_per_row)
        for at_word in range(start + (column + left) // 64, start + (column + right) // 64 + 1):
            carry = free[np.uint64(at_word)]
            if carry == 0:
                continue
            free[np.uint64(at_word)] = 0
            line = counters[at_word]
            for plane in range(PLANES):
                both = line[plane] & carry
                line[plane] ^= carry
                carry = both
                if carry == 0:
                    break
            if carry != 0:
                add_full(cells, at_word, carry, l_free, prior, limit)


@njit(cache=True, nogil=True)
def add_full(cells, word, marked, l_free, prior, limit):
    """Add the misses of the cells of a word whose counters ran over."""
    for i in range(64):
        if (marked >> np.uint64(i)) & ONE:
            cells[64 * word + i] = missed(cells[64 * word + i], 1 << PLANES, l_free, prior, limit)


@njit(cache=True, nogil=True)
def add_counted(log_odds, counters, l_free, prior, limit):
    """Add all misses that were counted, and set the counters to 0."""
    cells = log_odds.reshape(-1)
    times, values = np.empty(32, np.int32), np.empty(32, np.float32)
    for word in range(counters.shape[0]):
        some = np.uint64(0)
        for plane in range(PLANES):
            some |= counters[word, plane]
        if some == 0:
            continue
        for half in range(2):
            shift = np.uint64(32 * half)
            if np.uint32(some >> shift) == 0:
                continue
            times[:] = 0
            for plane in range(PLANES):
                bits = np.uint32(counters[word, plane] >> shift)
                if bits == 0:
                    continue
                for i in range(32):
                    times[i] += np.int32((bits >> np.uint32(i)) & ONE32) << plane
            lane = cells[64 * word + 32 * half : 64 * word + 32 * half + 32]
            for i in range(32):
                old = lane[np.uint64(i)]
                values[i] = prior if old != old and times[i] > 0 else old
            for level in range(times.max()):
                for i in range(32):
                    new = max(values[i] + l_free, -limit)
                    values[i] = new if times[i] > level else values[i]
            for i in range(32):
                lane[np.uint64(i)] = values[i]
        counters[word, :] = 0
