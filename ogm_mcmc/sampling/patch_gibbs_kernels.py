"""Kernels of Gibbs sampling over patches ([patch] Algorithm 1); note in `patch_gibbs`.

cells, records, `_bits`  as in `ogm_mcmc.sampling.gibbs_kernels`
corner  the lower left cell of a patch of `side` x `side` cells; the ring of cells around it lies
        inside the window, too
Patterns and borders are numbers as `ogm_mcmc.sampling.patch_patterns` has them.
"""

import math

import numpy as np

from ogm_mcmc.sampling.borrowed_arrays import borrowed
from ogm_mcmc.sampling.gibbs_kernels import (
    PARTS,
    SLACK,
    behind_first,
    log_odds_unless_below,
    redirect_rays,
)
from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_index_kernels import (
    FRONT,
    MOST_IN_TILE,
    NEAR,
    WIDTH,
    find_front,
    hit_behind,
    list_of,
)
from ogm_mcmc.sampling.ray_line_kernels import LEVEL, place_of

# Options are numbered by the bits of whole numbers, the sign left out.
WORD = 62

# Follows all rays of a cell.
NO_RAY = np.int64(2**62)

# Where the rays of a cell come from, and the rows of `heads`: the next one and the end of these,
# the code of the next ray, the cell of the patch, the source.
FROM_NEAR, FROM_FRONT, FROM_FOUND = range(3)
AT, LAST, CODE, PLACE, SOURCE = range(5)

# What is so many nats less likely than the likeliest is never drawn.
NEGLIGIBLE = -45.0


@inlined
def read_pattern(cells, corner, offsets):
    """Return the cells at `corner + offsets` as a number, the first its lowest bit."""
    pattern = np.int64(0)
    for i in range(offsets.size):
        pattern |= np.int64(cells[corner + offsets[i]]) << i
    return pattern


@inlined
def place_in(candidates, first, last, pattern):
    """Return where a pattern stands among the listed ones, -1 if it does not."""
    place = -1
    for i in range(first, last):
        if candidates[i] == pattern:
            place = i
            break
    return place


@kernel
def scratch(side, most, most_in_tile):
    """Return memory to draw among `most` options in, made once.

    (weights, occupying, heads, met, found)
    """
    return (
        np.empty((2, most)),
        np.empty((side * side, (most + WORD - 1) // WORD), np.int64),
        np.empty((5, 2 * side * side), np.int64),
        np.empty((2 * side + 1, 2), np.int64),
        np.empty((side * side, most_in_tile), np.int32),
    )


@kernel
def mark_options(options, n_options, n_cells, occupying):
    """Fill `occupying`: by cell of the patch, the options that occupy it as bits of words."""
    for i in range(n_cells):
        for word in range((n_options + WORD - 1) // WORD):
            together = np.int64(0)
            for option in range(word * WORD, min(word * WORD + WORD, n_options)):
                together |= ((options[option] >> i) & 1) << (option - word * WORD)
            occupying[i, word] = together


@inlined
def next_code(source, at, last, place, near, front, found):
    """Return the code of the ray at a place of one source, NO_RAY at its end."""
    code = NO_RAY
    if at < last:
        if source == FROM_NEAR:
            code = np.int64(near[at, 0])
        elif source == FROM_FRONT:
            code = np.int64(front[at])
        else:
            code = np.int64(found[place, at])
    return code


@kernel
def fill_heads(
    heads, found, corner, side, marks, lists, full, near, front, tiles, runs, run_lengths, rays,
    grid,
):  # fmt: skip
    """Fill `heads` with where the rays of each cell of a patch are; return how many there are."""
    count = 0
    for i in range(side * side):
        cell = corner + (i // side) * grid[WIDTH] + i % side
        number = list_of(cell, marks)
        begin, end, source = np.int64(0), np.int64(0), FROM_FOUND
        if number >= 0:
            begin, end = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
            if begin < end:
                heads[AT, count], heads[LAST, count], heads[PLACE, count] = begin, end, i
                heads[SOURCE, count], heads[CODE, count] = FROM_NEAR, near[begin, 0]
                count += 1
        if number >= 0 and full[number]:
            begin, end = np.int64(lists[number, FRONT]), np.int64(lists[number + 1, FRONT])
            source = FROM_FRONT
        else:
            row = cell // grid[WIDTH]
            begin = np.int64(0)
            end = np.int64(
                find_front(
                    cell - row * grid[WIDTH], row, tiles, runs, run_lengths, rays, grid, found[i]
                )
            )
        if begin < end:
            heads[AT, count], heads[LAST, count], heads[PLACE, count] = begin, end, i
            heads[SOURCE, count] = source
            heads[CODE, count] = next_code(source, begin, end, i, near, front, found)
            count += 1
    return count


@kernel
def add_likelihoods(
    options, scores, n_options, occupying, heads, met, found, corner, side, cells, records, bits,
    marks, lists, full, near, near_bits, front, tiles, runs, run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Add to each option's score what the rays that reach the patch say of it.

    options, scores  (>= n_options,): patterns, and their log-weights, nats; up to one constant
    occupying, heads, met, found  memory to work in, see `scratch`
    The rays of a cell come in rising order, so those of all cells of the patch can be merged: the
    cells that a ray meets come together, read one after the other from memory. The first of them
    that an option occupies is its hit; if there is none, whatever is behind the patch. Options
    that a ray passes without a hit cost nothing.
    """
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    marks, lists, full = borrowed(marks), borrowed(lists), borrowed(full)
    near, near_bits, front = borrowed(near), borrowed(near_bits), borrowed(front)
    tiles, runs, run_lengths = borrowed(tiles), borrowed(runs), borrowed(run_lengths)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    n_cells = side * side
    n_words = (n_options + WORD - 1) // WORD
    mark_options(options, n_options, n_cells, occupying)
    corner_row = corner // grid[WIDTH]
    corner_column = corner - corner_row * grid[WIDTH]
    n_heads = fill_heads(
        heads, found, corner, side, marks, lists, full, near, front, tiles, runs, run_lengths,
        rays, grid,
    )  # fmt: skip
    while True:
        code = NO_RAY
        for i in range(n_heads):
            code = min(code, heads[CODE, i])
        if code == NO_RAY:
            break
        ray = code >> 2
        count = 0
        for i in range(n_heads):
            if heads[CODE, i] != code:
                continue
            at, cell, source = heads[AT, i], heads[PLACE, i], heads[SOURCE, i]
            heads[AT, i] = at + 1
            heads[CODE, i] = next_code(source, at + 1, heads[LAST, i], cell, near, front, found)
            # Sorted by place: `met` holds (place, cell) as one number, and the pair, -1 in front.
            place = np.int64(
                place_of(code, corner_column + cell % side, corner_row + cell // side)
            )
            place = (place << 8) | cell
            k = count
            while k > 0 and met[k - 1, 0] > place:
                met[k, 0], met[k, 1] = met[k - 1, 0], met[k - 1, 1]
                k -= 1
            met[k, 0], met[k, 1] = place, at if source == FROM_NEAR else np.int64(-1)
            count += 1
        first_hit = records[ray, 0]
        if first_hit < met[0, 0] >> 8:
            continue  # stopped before the patch
        outside = np.float64(bits[ray, 1])
        if first_hit <= met[count - 1, 0] >> 8:
            # It ends in the patch at present: look for what is behind.
            i = met[count - 1, 0] & 255
            column, row = corner_column + i % side, corner_row + i // side
            if first_hit == met[count - 1, 0] >> 8:
                _, value = behind_first(
                    code, column, row, cells, records, bits, marks, lists, near, near_bits, rays,
                    ray_bits, grid,
                )  # fmt: skip
            elif records[ray, 2] > met[count - 1, 0] >> 8:
                value = bits[ray, 3]
            else:
                _, value = hit_behind(
                    code, column, row, cells, marks, lists, near, near_bits, rays, ray_bits, grid
                )
            outside = np.float64(value)
        level = np.float64(ray_bits[ray, LEVEL])
        for word in range(n_words):
            passing = np.int64(-1)
            for k in range(count):
                hit = passing & occupying[met[k, 0] & 255, word]
                if hit == 0:
                    continue
                passing &= ~hit
                at = met[k, 1]
                value = (level if at < 0 else np.float64(near_bits[at, 1])) - outside
                if value == 0.0:
                    continue
                option = word * WORD
                while hit:
                    if hit & 1:
                        scores[option] += value
                    hit >>= 1
                    option += 1


@kernel
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


@kernel
def sweep_patches(
    rng, corners, side, inner, ring, escape, random_share, flip_cells, whole_share, doubted,
    chances, entry_of_border, start, candidates, log_probability, floor, cells, records, bits,
    marks, lists, full, gain, near, near_bits, front, tiles, runs, run_lengths, rays, ray_bits,
    grid,
):  # fmt: skip
    """Draw one patch after the other given its border and all rays; return the flipped cells.

    corners  (P,) int32; inner, ring  offsets of the cells of the patch and of its border
    whole_share   share of patches that are drawn as a whole
    escape        share of the draws of whole patches that also consider one pattern that is not
                  listed
    random_share  share of the draws of whole patches that take any pattern without looking
                  ([patch] p_randPatch); above 0, patterns that are not listed count as
                  impossible, as published
    flip_cells    so many cells of each patch, from a random one on, are drawn after that, or
                  instead, one by one given the others, whatever the table lists
    doubted       (K,) uint8: cells of which it is wanted what they were drawn with
    chances       (K,) uint8, output: that probability, in `PARTS`
    """
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    doubted, chances = borrowed(doubted), borrowed(chances)
    marks, lists, full, gain = borrowed(marks), borrowed(lists), borrowed(full), borrowed(gain)
    near, near_bits, front = borrowed(near), borrowed(near_bits), borrowed(front)
    tiles, runs, run_lengths = borrowed(tiles), borrowed(runs), borrowed(run_lengths)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    patterns = np.int64(1) << (side * side)
    mask = entry_of_border.size - 1
    most = 0
    for e in range(start.size - 1):
        most = max(most, start[e + 1] - start[e])
    options = np.empty(most + 1, np.int64)
    weights, occupying, heads, met, found = scratch(side, most + 1, grid[MOST_IN_TILE])
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
        cells_only = whole_share < 1.0 and rng.random() >= whole_share
        chosen = current
        listed = place_in(candidates, first, last, current) >= 0
        if cells_only:
            pass  # `beyond` and `reckless` are of whole patches
        elif n_options == 1 and settled and not (beyond or reckless):
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
                options, scores, n_options, occupying, heads, met, found, corner, side, cells,
                records, bits, marks, lists, full, near, near_bits, front, tiles, runs,
                run_lengths, rays, ray_bits, grid,
            )  # fmt: skip
            chosen = options[draw_index(rng, scores, n_options, weights)]
        changed = chosen ^ current
        for i in range(inner.size):
            if not (changed >> i) & 1:
                continue
            flips += 1
            cell = corner + inner[i]
            cells[cell] = (chosen >> i) & 1
            redirect_rays(
                cell, cells, records, bits, marks, lists, full, near, near_bits, front, tiles,
                runs, run_lengths, rays, ray_bits, grid,
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
            number = list_of(cell, marks)
            most_added = gain[number] if number >= 0 else np.float32(0.0)
            least = threshold
            if doubted[cell]:
                least = -math.inf  # the probability itself is wanted
            if prior < least - most_added - SLACK and not cells[cell]:
                continue  # no ray can change that
            log_odds = log_odds_unless_below(
                least, prior, cell, cells, records, bits, marks, lists, full, gain, near,
                near_bits, front, tiles, runs, run_lengths, rays, ray_bits, grid,
            )  # fmt: skip
            occupied = log_odds > threshold
            if doubted[cell]:
                # To a whole number of parts, up or down so that it is right in the mean.
                chance = 1.0 / (1.0 + math.exp(-log_odds))
                chances[cell] = np.uint8(chance * PARTS + rng.random())
            if occupied != (cells[cell] != 0):
                cells[cell] = occupied
                chosen ^= one
                redirect_rays(
                    cell, cells, records, bits, marks, lists, full, near, near_bits, front, tiles,
                    runs, run_lengths, rays, ray_bits, grid,
                )  # fmt: skip
                flips += 1
    return flips
