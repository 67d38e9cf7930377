"""Kernels that average the evidence of one scan over samples of its pose ([pose] Eq. 9).

They work in a window of the map, the box of the scan in whole words of 64 cells. Of a window of
R rows and W words a row:

evidence  (R * W * 64,) float32, nats: sum of weight * log-odds over the samples; 0 before
best      the same size (gaussian model only): highest log-odds of this sample in special cells
seen      (R * W,) uint64 bit set: cells that any sample touched; empty before
free      (R * W,) bit set of this sample: cells its beams went through; empty before and after
misses    (R * W * D,) uint64: how many of the samples of one weight missed a cell, D binary digits
          for each word of 64 cells, lowest first; 0 before and after
hits      the same for cells that were hit (step model only)
special   (R * W,) bit set of this sample: cells with a value of their own; empty before and after

Cells are relative to the window. Rays must lie inside; nothing is checked. With one sample of
weight 1 each number is the one that `two_assumption_kernels.fuse_per_scan` adds, bit for bit.
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
from ogm_mcmc.sensors.inverse_model_kernels import gaussian_log_odds

ONE32 = np.uint32(1)


@njit(cache=True, nogil=True, inline='always')
def stretch(x, y, end_x, end_y, hit, reach, model):
    """Where a ray's flat part and its special part end, as shares of the way to its end.

    reach  cells: no further than the sensor can say anything. Returns (flat, last, range).
    A reading so short that it ends where it starts has no direction: it is about its own cell.
    """
    length = math.hypot(end_x - x, end_y - y)
    if not hit or length == 0.0:
        return 1.0, 1.0, length
    sigma = model.sigma + model.growth * length * length
    before = length - model.half_width - model.sigmas_before * sigma
    behind = min(length + model.half_width + model.sigmas_behind * sigma, max(reach, length))
    return max(before, 0.0) / length, behind / length, length


@njit(cache=True, nogil=True, inline='always')
def list_cells(column, row, x0, y0, x1, y1, columns, rows):
    """Run `trace_ray` upwards: it need not turn the list round, and order is of no matter here."""
    if y1 < y0:
        return trace_ray(column, row, x1, y1, x0, y0, columns, rows)
    return trace_ray(column, row, x0, y0, x1, y1, columns, rows)


@njit(cache=True, nogil=True, inline='always')
def cell_log_odds(c, r, x, y, length, model):
    """Log-odds of the cell in column c and row r, both relative to the sensor's cell."""
    dx, dy = c + 0.5 - x, r + 0.5 - y
    distance = math.sqrt(dx * dx + dy * dy)
    sigma = model.sigma + model.growth * length * length
    if distance < length - model.half_width - model.sigmas_before * sigma:
        return model.l_free
    return gaussian_log_odds(distance, length, sigma, model.half_width, model.l_free, model.l_occ)


@njit(cache=True, nogil=True)
def add_products(evidence, best, start, marked, weight):
    """Add weight * best to those of 64 cells from `start` on whose bit is set."""
    for half in range(2):
        mask = np.uint32(marked >> np.uint64(32 * half))
        if mask == 0:
            continue
        lane = evidence[start + 32 * half : start + 32 * half + 32]
        values = best[start + 32 * half : start + 32 * half + 32]
        for i in range(32):
            old = lane[np.uint64(i)]
            new = old + weight * values[np.uint64(i)]
            lane[np.uint64(i)] = new if (mask >> np.uint32(i)) & ONE32 else old


@njit(cache=True, nogil=True, inline='always')
def count_up(counters, start, marked):
    """Add 1 to the counters of the marked cells of a word: a ripple carry for 64 cells at once.

    counters[start + p] holds bit p of each count.
    """
    place = np.uint64(start)
    while marked != 0:
        carry = counters[place] & marked
        counters[place] ^= marked
        marked = carry
        place += ONE


@njit(cache=True, nogil=True)
def count_sample(evidence, best, seen, free, special, misses, hits, digits, first, last, weight,
                 model):  # fmt: skip
    """Count the marked cells of words first to last - 1 as missed or hit; clear the marks.

    A cell that is both free and special counts as special: a hit beats a miss. The Gaussian
    model's special cells have a value each, which goes to the evidence at once.
    """
    for word in range(first, last):
        crossed, own = free[np.uint64(word)], special[np.uint64(word)]
        if crossed == 0 and own == 0:
            continue
        free[np.uint64(word)] = 0
        special[np.uint64(word)] = 0
        seen[np.uint64(word)] |= crossed | own
        count_up(misses, word * digits, crossed & ~own)
        if own == 0:
            continue
        if model.gaussian:
            add_products(evidence, best, 64 * word, own, weight)
        else:
            count_up(hits, word * digits, own)


@njit(cache=True, nogil=True)
def add_counts(evidence, counters, digits, first, last, change):
    """Add change * count to the evidence of words first to last - 1; set the counters to 0."""
    for word in range(first, last):
        for place in range(digits):
            counted = counters[np.uint64(word * digits + place)]
            if counted == 0:
                continue
            counters[np.uint64(word * digits + place)] = 0
            more = change * np.float32(1 << place)
            # Two halves of 32, so that one mask bit and one float32 fill equal SIMD lanes.
            for half in range(2):
                mask = np.uint32(counted >> np.uint64(32 * half))
                if mask == 0:
                    continue
                lane = evidence[64 * word + 32 * half : 64 * word + 32 * half + 32]
                for i in range(32):
                    old = lane[np.uint64(i)]
                    lane[np.uint64(i)] = old + more if (mask >> np.uint32(i)) & ONE32 else old


@njit(cache=True, nogil=True)
def sum_per_scan(
    evidence, best, seen, free, special, misses, hits, digits, words, cells, places, ends, hit,
    n_rays, weights, reach, boxes, model,
):  # fmt: skip
    """Sum the evidence of a scan over its samples, each cell once per sample: a hit beats a miss.

    words  per row of the window; cells, places, ends, hit, n_rays  see `SampledRays`, but cells
    and boxes relative to the window; reach  cells; weights  (M,) float32, equal ones together;
    digits  D, enough for the most equal weights there are; model  `BeamModel`
    Of several beams with a say in a special cell the highest log-odds count.
    """
    words_per_row = np.uint64(words)
    plans = np.empty((n_rays, PLAN_SIZE), np.int64)
    longest = np.int64(3)
    if model.gaussian:
        longest = 2 * np.int64(math.ceil(reach)) + 8
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    lowest, highest = boxes[0, 1] * words, boxes[0, 3] * words
    for k in range(weights.size):
        column, row = cells[k, 0], cells[k, 1]
        x, y = places[k, 0], places[k, 1]
        for ray in range(n_rays):
            end_x, end_y = ends[k, 0, ray], ends[k, 1, ray]
            if model.gaussian:
                flat, _, _ = stretch(x, y, end_x, end_y, hit[ray], reach, model)
                end_x, end_y = x + flat * (end_x - x), y + flat * (end_y - y)
            plan_ray(column, row, x, y, end_x, end_y, plans[ray])
        for ray in range(n_rays):
            mark_plan(free, words_per_row, plans[ray])
        for ray in range(n_rays):
            if not hit[ray]:
                continue
            end_x, end_y = ends[k, 0, ray], ends[k, 1, ray]
            if not model.gaussian:
                c, r = np.uint64(column + math.floor(end_x)), np.uint64(row + math.floor(end_y))
                special[r * words_per_row + (c >> WORD)] |= ONE << (c & IN_WORD)
                continue
            flat, beyond, length = stretch(x, y, end_x, end_y, hit[ray], reach, model)
            dx, dy = end_x - x, end_y - y
            count = list_cells(
                column, row, x + flat * dx, y + flat * dy, x + beyond * dx, y + beyond * dy,
                columns, rows,
            )  # fmt: skip
            for i in range(count):
                value = cell_log_odds(columns[i] - column, rows[i] - row, x, y, length, model)
                c, r = np.uint64(columns[i]), np.uint64(rows[i])
                word, bit = r * words_per_row + (c >> WORD), ONE << (c & IN_WORD)
                cell = (word << WORD) + (c & IN_WORD)
                if special[word] & bit:
                    best[cell] = max(best[cell], value)
                else:
                    special[word] |= bit
                    best[cell] = value
        first, last = boxes[k, 1] * words, boxes[k, 3] * words
        lowest, highest = min(lowest, first), max(highest, last)
        count_sample(
            evidence, best, seen, free, special, misses, hits, digits, first, last, weights[k],
            model,
        )  # fmt: skip
        if k + 1 == weights.size or weights[k + 1] != weights[k]:
            add_counts(evidence, misses, digits, lowest, highest, weights[k] * model.l_free)
            if not model.gaussian:
                add_counts(evidence, hits, digits, lowest, highest, weights[k] * model.l_occ)
            lowest, highest = first, last


@njit(cache=True, nogil=True)
def add_evidence(log_odds, evidence, seen, words, n_rows, first_word, bottom, prior, limit):
    """Add the summed evidence of a scan to the map ([pose] Eq. 3); clear the window.

    log_odds  (height, width) float32, nan where never measured; the window's lower left word is
    word `first_word` of row `bottom`
    """
    flat = log_odds.reshape(-1)
    words_per_row = log_odds.shape[1] // 64
    for row in range(n_rows):
        for word in range(row * words, (row + 1) * words):
            marked = seen[np.uint64(word)]
            if marked == 0:
                continue
            seen[np.uint64(word)] = 0
            target = ((bottom + row) * words_per_row + first_word + word - row * words) * 64
            for half in range(2):
                mask = np.uint32(marked >> np.uint64(32 * half))
                if mask == 0:
                    continue
                cells = flat[target + 32 * half : target + 32 * half + 32]
                lane = evidence[64 * word + 32 * half : 64 * word + 32 * half + 32]
                for i in range(32):
                    old = cells[np.uint64(i)]
                    new = (prior if old != old else old) + lane[np.uint64(i)]
                    new = min(max(new, -limit), limit)
                    cells[np.uint64(i)] = new if (mask >> np.uint32(i)) & ONE32 else old
                    lane[np.uint64(i)] = np.float32(0.0)
