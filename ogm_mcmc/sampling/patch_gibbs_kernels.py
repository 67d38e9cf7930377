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
    SLACK,
    lengthen_rays,
    log_odds_unless_below,
    shorten_rays,
)
from ogm_mcmc.sampling.ray_index_kernels import following_cell

# Options are numbered by the bits of whole numbers, the sign left out.
WORD = 62

# Follows all rays of a cell.
NO_RAY = np.int64(2**62)

# What is so many nats less likely than the likeliest is never drawn.
NEGLIGIBLE = -45.0


@njit(cache=True, nogil=True, inline='always')
def read_pattern(cells, corner, offsets):
    """Return the cells at `corner + offsets` as a number, the first its lowest bit."""
    pattern = np.int64(0)
    for i in range(offsets.size):
        pattern |= np.int64(cells[corner + offsets[i]]) << i
    return pattern


@njit(cache=True, nogil=True, inline='always')
def place_in(candidates, first, last, pattern):
    """Return where a pattern stands among the listed ones, -1 if it does not."""
    place = -1
    for i in range(first, last):
        if candidates[i] == pattern:
            place = i
            break
    return place


@njit(cache=True, nogil=True)
def scratch(side, most):
    """Return (weights, occupying, heads, met): what draws among `most` options need, made once."""
    return (
        np.empty((2, most)),
        np.empty((side * side, (most + WORD - 1) // WORD), np.int64),
        np.empty((3, side * side), np.int64),
        np.empty((2 * side + 1, 2), np.int64),
    )


@njit(cache=True, nogil=True, inline='always')
def mark_options(options, n_options, n_cells, occupying):
    """Fill `occupying`: by cell of the patch, the options that occupy it as bits of words."""
    for i in range(n_cells):
        for word in range((n_options + WORD - 1) // WORD):
            together = np.int64(0)
            for option in range(word * WORD, min(word * WORD + WORD, n_options)):
                together |= ((options[option] >> i) & 1) << (option - word * WORD)
            occupying[i, word] = together


@njit(cache=True, nogil=True, inline='always')
def add_likelihoods(
    options, scores, n_options, occupying, heads, met, corner, side, width, cells, records, bits,
    cell_start, pairs, pair_bits, positions, ray_start, steps, across, up, likelihood, nothing,
):  # fmt: skip
    """Add to each option's score what the rays that reach the patch say of it.

    options, scores  (>= n_options,): patterns, and their log-weights, nats; up to one constant
    occupying, heads, met  memory to work in, see `scratch`
    The rays of a cell come in rising order, so those of all cells of the patch can be merged: the
    cells that a ray meets come together, read one after the other from memory. The first of them
    that an option occupies is its hit; if there is none, whatever is behind the patch. Options
    that a ray passes without a hit cost nothing.
    """
    n_cells = side * side
    n_words = (n_options + WORD - 1) // WORD
    mark_options(options, n_options, n_cells, occupying)
    for i in range(n_cells):
        cell = corner + (i // side) * width + i % side
        heads[0, i], heads[1, i] = cell_start[cell], cell_start[cell + 1]
        heads[2, i] = pairs[heads[0, i], 0] if heads[0, i] < heads[1, i] else NO_RAY
    while True:
        ray = heads[2, 0]
        for i in range(1, n_cells):
            ray = min(ray, heads[2, i])
        if ray == NO_RAY:
            break
        count = 0
        for i in range(n_cells):
            if heads[2, i] != ray:
                continue
            at = heads[0, i]
            heads[0, i] = at + 1
            heads[2, i] = pairs[at + 1, 0] if at + 1 < heads[1, i] else NO_RAY
            # Sorted by position: `met` holds (position, cell) as one number, and the pair.
            place = (np.int64(positions[at]) << 8) | i
            k = count
            while k > 0 and met[k - 1, 0] > place:
                met[k, 0], met[k, 1] = met[k - 1, 0], met[k - 1, 1]
                k -= 1
            met[k, 0], met[k, 1] = place, at
            count += 1
        first_hit = records[ray, 0]
        if first_hit < met[0, 0] >> 8:
            continue  # stopped before the patch
        outside = np.float64(bits[ray, 1])
        position = met[count - 1, 0] >> 8
        if first_hit <= position:
            # It ends in the patch at present: look for what is behind.
            outside = np.float64(nothing[ray])
            i = met[count - 1, 0] & 255
            cell = corner + (i // side) * width + i % side
            at, last = ray_start[ray] + position, ray_start[ray + 1] - 1
            step_x, step_y = across[ray], up[ray]
            while at < last:
                cell = following_cell(cell, steps[at], step_x, step_y)
                at += 1
                if cells[cell]:
                    outside = np.float64(likelihood[at])
                    break
        for word in range(n_words):
            passing = np.int64(-1)
            for k in range(count):
                hit = passing & occupying[met[k, 0] & 255, word]
                if hit == 0:
                    continue
                passing &= ~hit
                value = np.float64(pair_bits[met[k, 1], 1]) - outside
                if value == 0.0:
                    continue
                option = word * WORD
                while hit:
                    if hit & 1:
                        scores[option] += value
                    hit >>= 1
                    option += 1


@njit(cache=True, nogil=True, inline='always')
def draw_index(rng, log_weights, count, weights):
    """Draw from the first `count` of some log-weights; `weights` holds what they are."""
    highest = log_weights[0]
    for i in range(1, count):
        highest = max(highest, log_weights[i])
    total = 0.0
    for i in range(count):
        below = log_weights[i] - highest
        weights[i] = math.exp(below) if below > NEGLIGIBLE else 0.0
        total += weights[i]
    left = rng.random() * total
    drawn = 0
    while drawn < count - 1:
        left -= weights[drawn]
        if left < 0.0:
            break
        drawn += 1
    return drawn


@njit(cache=True, nogil=True)
def sweep_patches(
    rng, corners, side, width, inner, ring, escape, random_share, flip_cells, entry_of_border,
    start, candidates, log_probability, floor, cells, records, bits, cell_start, pairs, pair_bits,
    positions, gain, ray_start, steps, across, up, likelihood, nothing,
):  # fmt: skip
    """Draw one patch after the other given its border and all rays; return the flipped cells.

    corners  (P,) int32; inner, ring  offsets of the cells of the patch and of its border
    escape        share of draws that also consider one pattern that is not listed
    random_share  share of draws that take any pattern without looking ([patch] p_randPatch); above
                  0, patterns that are not listed count as impossible, as published
    flip_cells    so many cells of each patch, from a random one on, are drawn afterwards one by
                  one given the others, whatever the table lists
    """
    patterns = np.int64(1) << (side * side)
    mask = entry_of_border.size - 1
    most = 0
    for e in range(start.size - 1):
        most = max(most, start[e + 1] - start[e])
    options = np.empty(most + 1, np.int64)
    weights, occupying, heads, met = scratch(side, most + 1)
    scores, weights = weights[0], weights[1]
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
        chosen = current
        listed = place_in(candidates, first, last, current) >= 0
        if n_options == 1 and settled and not (beyond or reckless):
            pass  # one candidate: no ray can change that
        elif reckless:
            chosen = np.int64(rng.random() * patterns)
        elif listed or beyond or random_share > 0.0:
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
                options, scores, n_options, occupying, heads, met, corner, side, width, cells,
                records, bits, cell_start, pairs, pair_bits, positions, ray_start, steps, across,
                up, likelihood, nothing,
            )  # fmt: skip
            chosen = options[draw_index(rng, scores, n_options, weights)]
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
        place = np.int64(rng.random() * inner.size) if flip_cells else np.int64(0)
        for _ in range(flip_cells):
            place = (place + 1) % inner.size
            one = np.int64(1) << place
            cell, u = corner + inner[place], rng.random()
            threshold = math.log(u / (1.0 - u)) if u > 0.0 else -math.inf
            prior = 0.0
            for option in range(2):
                pattern = (chosen | one) if option else (chosen & ~one)
                row = place_in(candidates, first, last, pattern)
                value = floor[entry] if row < 0 else log_probability[row]
                prior += value if option else -value
            enough = threshold - gain[cell] - SLACK
            if prior < enough and not cells[cell]:
                continue  # no ray can change that
            begin, end = cell_start[cell], cell_start[cell + 1]
            log_odds = log_odds_unless_below(
                enough, prior, begin, end, cell, cells, records, bits, pairs, pair_bits, positions,
                ray_start, steps, across, up, likelihood, nothing,
            )  # fmt: skip
            if log_odds > threshold and not cells[cell]:
                cells[cell] = 1
                chosen |= one
                shorten_rays(begin, end, records, bits, pairs, pair_bits, positions)
                flips += 1
            elif cells[cell] and not log_odds > threshold:
                cells[cell] = 0
                chosen &= ~one
                lengthen_rays(
                    begin, end, cell, cells, records, bits, pairs, positions, ray_start, steps,
                    across, up, likelihood, nothing,
                )  # fmt: skip
                flips += 1
    return flips
