"""Kernels of Gibbs sampling over patches ([patch] Algorithm 1); note in `patch_gibbs`.

cells, records, `_bits`  as in `ogm_mcmc.sampling.gibbs_kernels`
corner  the lower left cell of a patch of `side` x `side` cells; the ring of cells around it lies
        inside the window, too
Patterns and borders are numbers as `ogm_mcmc.sampling.patch_patterns` has them.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.sampling.gibbs_kernels import (
    lengthen_rays,
    shorten_rays,
)
from ogm_mcmc.sampling.ray_index_kernels import ACROSS, UP, following_cell


@njit(cache=True, nogil=True, inline='always')
def read_pattern(cells, corner, offsets):
    """Return the cells at `corner + offsets` as a number, the first its lowest bit."""
    pattern = np.int64(0)
    for i in range(offsets.size):
        pattern |= np.int64(cells[corner + offsets[i]]) << i
    return pattern


@njit(cache=True, nogil=True)
def place_in(candidates, first, last, pattern):
    """Return where a pattern stands among the listed ones, -1 if it does not."""
    for i in range(first, last):
        if candidates[i] == pattern:
            return i
    return -1


@njit(cache=True, nogil=True)
def add_likelihoods(
    options, scores, n_options, corner, side, width, cells, records, bits, cell_start, pairs,
    positions, ray_start, steps, across, up, likelihood, nothing,
):  # fmt: skip
    """Add to each option's score what the rays that reach the patch say of it.

    options, scores  (>= n_options,): patterns, and their log-weights, nats
    A ray crosses the patch in one go. Of the cells it meets there the first one that an option
    occupies is its hit; if there is none, whatever is behind the patch.
    """
    # A straight way through a square of `side` cells meets at most 2 * side of them.
    met, values = np.empty(2 * side, np.int64), np.empty(2 * side)
    for i in range(side * side):
        cell = corner + (i // side) * width + i % side
        for pair in range(cell_start[cell], cell_start[cell + 1]):
            ray, position = pairs[pair, 0], np.int64(positions[pair])
            if records[ray, 0] < position:
                continue  # stopped before, or in an earlier cell of the patch: comes up there
            at, last = ray_start[ray] + position, ray_start[ray + 1] - 1
            row, column = i // side, i % side
            right, above = (1 if across[ray] > 0 else -1), (1 if up[ray] > 0 else -1)
            if position > 0:
                step = steps[at - 1]
                row_before = row - above if step & UP else row
                column_before = column - right if step & ACROSS else column
                if 0 <= row_before < side and 0 <= column_before < side:
                    continue  # came in by another cell
            count = 0
            while 0 <= row < side and 0 <= column < side:
                met[count] = row * side + column
                values[count] = likelihood[at]
                count += 1
                if at == last:
                    break
                if steps[at] & UP:
                    row += above
                if steps[at] & ACROSS:
                    column += right
                at += 1
            outside = np.float64(bits[ray, 1])
            if records[ray, 0] < position + count:
                # It ends in the patch at present: look for what is behind.
                outside = np.float64(nothing[ray])
                inside = corner + (met[count - 1] // side) * width + met[count - 1] % side
                at = ray_start[ray] + position + count - 1
                while at < last:
                    inside = following_cell(inside, steps[at], across[ray], up[ray])
                    at += 1
                    if cells[inside]:
                        outside = np.float64(likelihood[at])
                        break
            for option in range(n_options):
                pattern, value = options[option], outside
                for k in range(count):
                    if (pattern >> met[k]) & 1:
                        value = values[k]
                        break
                scores[option] += value


@njit(cache=True, nogil=True)
def draw_index(rng, log_weights, count):
    """Draw from the first `count` of some log-weights."""
    highest = log_weights[0]
    for i in range(1, count):
        highest = max(highest, log_weights[i])
    total = 0.0
    for i in range(count):
        total += math.exp(log_weights[i] - highest)
    left = rng.random() * total
    for i in range(count):
        left -= math.exp(log_weights[i] - highest)
        if left < 0.0:
            return i
    return count - 1


@njit(cache=True, nogil=True)
def sweep_patches(
    rng, corners, side, width, inner, ring, escape, random_share, entry_of_border, start,
    candidates, log_probability, floor, cells, records, bits, cell_start, pairs, pair_bits,
    positions, ray_start, steps, across, up, likelihood, nothing,
):  # fmt: skip
    """Draw one patch after the other given its border and all rays; return the flipped cells.

    corners  (P,) int32; inner, ring  offsets of the cells of the patch and of its border
    escape        share of draws that also consider one pattern that is not listed
    random_share  share of draws that take any pattern without looking ([patch] p_randPatch); above
                  0, patterns that are not listed count as impossible, as published
    """
    patterns = np.int64(1) << (side * side)
    mask = entry_of_border.size - 1
    most = 0
    for e in range(start.size - 1):
        most = max(most, start[e + 1] - start[e])
    options, scores = np.empty(most + 1, np.int64), np.empty(most + 1)
    flips = 0
    for j in range(corners.size):
        corner = np.int64(corners[j])
        entry = 0
        if mask:
            entry = entry_of_border[read_pattern(cells, corner, ring)]
        first, last = start[entry], start[entry + 1]
        n_options = last - first
        beyond = escape > 0.0 and rng.random() < escape
        reckless = random_share > 0.0 and rng.random() < random_share
        current = read_pattern(cells, corner, inner)
        settled = random_share == 0.0 or current == candidates[first]
        if n_options == 1 and settled and not (beyond or reckless):
            continue  # one candidate: no ray can change that
        chosen = current
        if reckless:
            chosen = np.int64(rng.random() * patterns)
        else:
            listed = place_in(candidates, first, last, current) >= 0
            if not (listed or beyond or random_share > 0.0):
                continue
            for i in range(n_options):
                options[i] = candidates[first + i]
                scores[i] = log_probability[first + i]
            if beyond and n_options < patterns:
                other = current
                while place_in(candidates, first, last, other) >= 0:
                    other = np.int64(rng.random() * patterns)
                options[n_options] = other
                scores[n_options] = floor[entry] + math.log(patterns - n_options)
                n_options += 1
            add_likelihoods(
                options, scores, n_options, corner, side, width, cells, records, bits,
                cell_start, pairs, positions, ray_start, steps, across, up, likelihood, nothing,
            )  # fmt: skip
            chosen = options[draw_index(rng, scores, n_options)]
        changed = chosen ^ current
        for i in range(inner.size):
            if not (changed >> i) & 1:
                continue
            flips += 1
            cell = corner + inner[i]
            begin, end = cell_start[cell], cell_start[cell + 1]
            if (chosen >> i) & 1:
                cells[cell] = 1
                shorten_rays(begin, end, records, bits, pairs, pair_bits, positions)
            else:
                cells[cell] = 0
                lengthen_rays(
                    begin, end, cell, cells, records, bits, pairs, positions, ray_start, steps,
                    across, up, likelihood, nothing,
                )  # fmt: skip
    return flips
