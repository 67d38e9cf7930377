"""Kernels that average the evidence of one scan over samples of its pose ([pose] Eq. 9).

They work in a window of the map, the box of the scan in whole words of 64 cells. Of a window of
R rows and W words a row:

evidence  (R * W * 64,) float32, nats: sum of weight * log-odds over the samples; 0 before
best      the same size (gaussian model only): highest log-odds of this sample in special cells
seen      (R * W,) uint64 bit set: cells that any sample touched; empty before
free      (R * W,) bit set of this sample: cells its beams went through; empty before and after
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
    """
    length = math.hypot(end_x - x, end_y - y)
    if not hit:
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


@njit(cache=True, nogil=True)
def add_sample(evidence, best, seen, free, special, first, last, weight, model):
    """Add weight * log-odds of every marked cell of words first to last - 1; clear the marks.

    A cell that is both free and special counts as special: a hit beats a miss.
    """
    missed = weight * model.l_free
    met = weight * model.l_occ
    for word in range(first, last):
        crossed, own = free[np.uint64(word)], special[np.uint64(word)]
        if crossed == 0 and own == 0:
            continue
        free[np.uint64(word)] = 0
        seen[np.uint64(word)] |= crossed | own
        crossed &= ~own
        # Two halves of 32, so that one mask bit and one float32 fill equal SIMD lanes.
        for half in range(2):
            mask = np.uint32(crossed >> np.uint64(32 * half))
            if mask == 0:
                continue
            lane = evidence[64 * word + 32 * half : 64 * word + 32 * half + 32]
            for i in range(32):
                old = lane[np.uint64(i)]
                lane[np.uint64(i)] = old + missed if (mask >> np.uint32(i)) & ONE32 else old
        if own == 0:
            continue
        special[np.uint64(word)] = 0
        if model.gaussian:
            add_products(evidence, best, 64 * word, own, weight)
            continue
        # Few bits are set here: one by one is quicker than all at once.
        for i in range(64):
            if (own >> np.uint64(i)) & ONE:
                evidence[64 * word + i] += met


@njit(cache=True, nogil=True)
def sum_per_scan(
    evidence, best, seen, free, special, words, cells, places, ends, hit, n_rays, reach, boxes,
    weights, model,
):  # fmt: skip
    """Sum the evidence of a scan over its samples, each cell once per sample: a hit beats a miss.

    words  per row of the window; cells, places, ends, hit, n_rays  see `SampledRays`, but cells
    and boxes relative to the window; reach  cells; weights  (M,) float32; model  `BeamModel`
    Of several beams with a say in a special cell the highest log-odds count.
    """
    words_per_row = np.uint64(words)
    plans = np.empty((n_rays, PLAN_SIZE), np.int64)
    longest = np.int64(3)
    if model.gaussian:
        longest = 2 * np.int64(math.ceil(reach)) + 8
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
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
            flat, last, length = stretch(x, y, end_x, end_y, hit[ray], reach, model)
            dx, dy = end_x - x, end_y - y
            count = list_cells(
                column, row, x + flat * dx, y + flat * dy, x + last * dx, y + last * dy,
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
        first, last_word = boxes[k, 1] * words, boxes[k, 3] * words
        add_sample(evidence, best, seen, free, special, first, last_word, weights[k], model)


@njit(cache=True, nogil=True)
def sum_per_beam(evidence, seen, words, cells, places, ends, hit, n_rays, reach, weights, model):
    """Sum the evidence of a scan over its samples, every beam counting in each cell it crosses."""
    longest = 2 * np.int64(math.ceil(reach)) + 8
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    for k in range(weights.size):
        column, row = cells[k, 0], cells[k, 1]
        x, y = places[k, 0], places[k, 1]
        weight = weights[k]
        for ray in range(n_rays):
            end_x, end_y = ends[k, 0, ray], ends[k, 1, ray]
            last, length = 1.0, 0.0
            if model.gaussian:
                _, last, length = stretch(x, y, end_x, end_y, hit[ray], reach, model)
            count = list_cells(
                column, row, x, y, x + last * (end_x - x), y + last * (end_y - y), columns, rows
            )
            end_c, end_r = column + math.floor(end_x), row + math.floor(end_y)
            for i in range(count):
                c, r = columns[i], rows[i]
                value = model.l_free
                if hit[ray]:
                    if model.gaussian:
                        value = cell_log_odds(c - column, r - row, x, y, length, model)
                    elif c == end_c and r == end_r:
                        value = model.l_occ
                word = np.uint64(r * words + (c >> 6))
                seen[word] |= ONE << np.uint64(c & 63)
                evidence[r * words * 64 + c] += weight * value


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
