"""Kernels that draw cells from log-odds that are kept; why: `ogm_mcmc.sampling.kept_odds`.

odds   (K, 2) float32: LOG_ODDS of each free cell where a ray arrives, never below those given the
       present map; infinite of an occupied one, NaN where no ray arrives. As `counts`, the same
       memory as int32, ARRIVING: how many rays arrive at a free cell, the first of those that end
       in an occupied one; FORGOTTEN in the first cell of all: nothing is kept
ways   (N, 8) int32: what `ray_path_kernels` says of a ray; AT, where on its path it ends; NEXT and
       BEFORE, others that end in the same cell, or NOBODY; BEHIND, where it would go on to, when
       that was looked for last. `lows`: the same memory as float32
paths  (V, 2) int32, `said` as float32, see `ray_path_kernels`
"""

import math

import numpy as np

from ogm_mcmc.sampling.borrowed_arrays import borrowed
from ogm_mcmc.sampling.fetching import fetch_soon
from ogm_mcmc.sampling.gibbs_kernels import SLACK, UNTOLD
from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_index_kernels import NEAR, NOTHING, list_of
from ogm_mcmc.sampling.ray_line_kernels import place_of
from ogm_mcmc.sampling.ray_path_kernels import (
    CELL,
    ENDS,
    LOWEST,
    OFFSET,
    SAID,
    ZONE,
    begin_of,
    next_on_path,
)

LOG_ODDS, ARRIVING = range(2)

# Columns of `ways` behind those of `ray_path_kernels`.
AT, NEXT, BEFORE, BEHIND = range(4, 8)

# In place of a ray, and of a count.
NOBODY, FORGOTTEN = np.int32(-1), np.int32(-2)

# So many cells have their random numbers and memory looked at together.
AT_ONCE = 256

# Rows of `paths`, or of `near`, in a line of the cache.
IN_LINE = 8

# Twice what a float32 is rounded by: kept numbers are rounded upwards.
UPWARDS_BY = 1.2e-7

# A float32 read as an integer: that of 1.0, and the logarithm that one more means.
ONE_BITS, LOG_OF_BIT = np.int32(127 << 23), np.float32(math.log(2.0) / 2**23)

# Far more than what numbers up to log(2**53) are rounded by as float32.
ROUNDING = np.float32(2e-5)


@inlined
def rounded_up(value):
    """Return a float32 that is no smaller."""
    return np.float32(value + abs(value) * UPWARDS_BY)


@inlined
def end_here(ray, k, cell, odds, counts, ways):
    """Let a ray end in an occupied cell, at `k` of its path; END in place of one: nowhere."""
    after = NOBODY
    if cell >= 0:
        if not np.isnan(odds[cell, LOG_ODDS]):
            after = counts[cell, ARRIVING]
        odds[cell, LOG_ODDS], counts[cell, ARRIVING] = np.inf, ray
    ways[ray, AT], ways[ray, NEXT], ways[ray, BEFORE] = k, after, NOBODY
    if after != NOBODY:
        ways[after, BEFORE] = ray


@inlined
def end_no_more(ray, cell, odds, counts, ways):
    """Take a ray out of those that end in an occupied cell, or nowhere."""
    after, before = ways[ray, NEXT], ways[ray, BEFORE]
    if after != NOBODY:
        ways[after, BEFORE] = before
    if before != NOBODY:
        ways[before, NEXT] = after
    elif cell >= 0:
        counts[cell, ARRIVING] = after
        if after == NOBODY:
            odds[cell, LOG_ODDS] = np.nan


@kernel
def tell_cells(
    ray, flipped, far, entering, prior, odds, counts, ways, lows, paths, said
):  # fmt: skip
    """Keep `odds` right along a ray whose first hit changed, of all cells but the two it hits.

    flipped, far  where on its path the cell that flipped and the other first hit are: in turn,
                  the cells in front and those between are told
    entering      whether the ray goes on to the far one now, or did so before
    """
    odds, ways, lows = borrowed(odds), borrowed(ways), borrowed(lows)
    paths, said, counts = borrowed(paths), borrowed(said), borrowed(counts)
    zone, low = np.int64(ways[ray, ZONE]), np.float64(lows[ray, LOWEST])
    here, there = np.float64(said[flipped, SAID]), np.float64(said[far, SAID])
    change, change_far = here - there, min(here, low) - min(there, low)
    if not entering:
        change, change_far = -change, -change_far
    if change_far != 0.0:
        for k in range(begin_of(ray, ways), min(zone, flipped)):
            cell = paths[k, CELL]
            if cell >= 0:
                odds[cell, LOG_ODDS] = rounded_up(np.float64(odds[cell, LOG_ODDS]) + change_far)
    for k in range(zone, flipped):
        cell = paths[k, CELL]
        if cell >= 0:
            odds[cell, LOG_ODDS] = rounded_up(np.float64(odds[cell, LOG_ODDS]) + change)
    for k in range(flipped + 1, far):
        cell = paths[k, CELL]
        if cell < 0:
            continue
        value = np.float64(said[k, SAID]) - (there if k >= zone else min(there, low))
        kept = np.float64(odds[cell, LOG_ODDS])
        if not entering:
            counts[cell, ARRIVING] -= 1
            kept = kept - value if counts[cell, ARRIVING] > 0 else np.float64(np.nan)
        elif np.isnan(kept):
            counts[cell, ARRIVING] = 1
            kept = prior + value
        else:
            counts[cell, ARRIVING] += 1
            kept += value
        odds[cell, LOG_ODDS] = rounded_up(kept)


@kernel
def begin_anew(records, odds, counts, ways, paths):
    """Fill `odds` and `ways` from first hits: of cells where a ray arrives nothing is known."""
    odds[:, LOG_ODDS] = np.nan
    counts[:, ARRIVING] = 0
    for ray in range(records.shape[0]):
        records[ray, 2] = UNTOLD
        at = np.int64(ways[ray, ENDS])
        if records[ray, 0] != NOTHING:
            at = np.int64(records[ray, 0] + ways[ray, OFFSET])
        for k in range(begin_of(ray, ways), at):
            cell = paths[k, CELL]
            if cell >= 0:
                odds[cell, LOG_ODDS] = np.inf
                counts[cell, ARRIVING] += 1
        end_here(ray, at, paths[at, CELL], odds, counts, ways)


@inlined
def logit(u):
    """Return log(u / (1 - u)) of 0 <= u < 1."""
    return math.log(u / (1.0 - u)) if u > 0.0 else -math.inf


@kernel
def least_free(prior):
    """Return the least random number with which a cell is free where no ray arrives."""
    u = 1.0 / (1.0 + math.exp(-prior))
    while u < 1.0 and prior > logit(u):
        u += 2.0**-53
    while u > 0.0 and not prior > logit(u - 2.0**-53):
        u -= 2.0**-53
    return u


@kernel
def least_log_odds(numbers, least):
    """Fill `least` with what is not above logit(u) of random numbers, without a logarithm.

    Bits of a float read as an integer are its binary logarithm, straight between powers of two,
    .0861 too low at most; and log(u) <= logit(u).
    """
    for i in range(numbers.size):
        u = np.float32(numbers[i])
        low = np.float32(u.view(np.int32) - ONE_BITS) * LOG_OF_BIT - ROUNDING
        least[i] = low if u > 0.0 else -np.inf


@inlined
def occupied_log_odds(prior, first, cells, ways, paths, said):
    """Log-odds of an occupied cell given all others, from the `first` of the rays that end there.

    Where they would go on to is left in BEHIND.
    """
    log_odds = prior
    ray = first
    while ray != NOBODY:
        k = np.int64(ways[ray, AT])
        behind = next_on_path(k, cells, paths)
        ways[ray, BEHIND] = behind
        log_odds += np.float64(said[k, SAID]) - np.float64(said[behind, SAID])
        ray = ways[ray, NEXT]
    return log_odds


@kernel
def let_pass(
    cell, prior, records, bits, odds, counts, ways, lows, paths, said
):  # fmt: skip
    """Let rays that end in a cell go on, to where `occupied_log_odds` left them: it is free."""
    records, bits, ways = borrowed(records), borrowed(bits), borrowed(ways)
    odds, counts, lows = borrowed(odds), borrowed(counts), borrowed(lows)
    paths, said = borrowed(paths), borrowed(said)
    ray, most, count = counts[cell, ARRIVING], prior, 0
    while ray != NOBODY:
        after = ways[ray, NEXT]
        k, behind = np.int64(ways[ray, AT]), np.int64(ways[ray, BEHIND])
        now = said[behind, SAID]
        bits[ray, 1] = now
        if k < ways[ray, ZONE]:
            now = min(now, lows[ray, LOWEST])
        most += np.float64(said[k, SAID]) - np.float64(now)
        count += 1
        hit = paths[behind, CELL]
        records[ray, 0] = behind - ways[ray, OFFSET] if hit >= 0 else NOTHING
        end_here(ray, behind, hit, odds, counts, ways)
        tell_cells(ray, k, behind, True, prior, odds, counts, ways, lows, paths, said)
        ray = after
    odds[cell, LOG_ODDS], counts[cell, ARRIVING] = rounded_up(most), count


@inlined
def free_log_odds(
    prior, begin, end, column, row, ways, lows, said, near, near_bits
):  # fmt: skip
    """Log-odds of a free cell all of whose rays are in its list, and what is kept of it."""
    log_odds, most = prior, prior
    for i in range(begin, end):
        code = np.int64(near[i, 0])
        ray = code >> 2
        k, at = place_of(code, column, row) + ways[ray, OFFSET], ways[ray, AT]
        if at < k:
            continue
        now = said[np.int64(at), SAID]
        log_odds += np.float64(near_bits[i, 1]) - np.float64(now)
        if k < ways[ray, ZONE]:
            now = min(now, lows[ray, LOWEST])
        most += np.float64(near_bits[i, 1]) - np.float64(now)
    return log_odds, most


@kernel
def stop_rays(
    cell, begin, end, column, row, prior, records, bits, odds, counts, ways, lows,
    paths, said, near, near_bits,
):  # fmt: skip
    """Let rays that arrive at a cell end there: it is occupied."""
    records, bits, ways = borrowed(records), borrowed(bits), borrowed(ways)
    odds, counts, lows = borrowed(odds), borrowed(counts), borrowed(lows)
    paths, said = borrowed(paths), borrowed(said)
    near, near_bits = borrowed(near), borrowed(near_bits)
    odds[cell, LOG_ODDS] = np.nan
    for i in range(begin, end):
        code = np.int64(near[i, 0])
        ray = code >> 2
        place = place_of(code, column, row)
        k, far = np.int64(place + ways[ray, OFFSET]), np.int64(ways[ray, AT])
        if far < k:
            continue
        records[ray, 0], bits[ray, 1] = place, near_bits[i, 1]
        end_no_more(ray, paths[far, CELL], odds, counts, ways)
        end_here(ray, k, cell, odds, counts, ways)
        tell_cells(ray, k, far, False, prior, odds, counts, ways, lows, paths, said)


@kernel
def fetch_ahead(
    order, least, cells, odds, counts, ways, paths, marks, lists, near, ahead
):  # fmt: skip
    """Ask for the memory of what rays say of the cells of `order` that will be looked at.

    ahead  (C + 1,) int32, of use here only
    """
    odds, counts, ways = borrowed(odds), borrowed(counts), borrowed(ways)
    paths, marks, lists, near = borrowed(paths), borrowed(marks), borrowed(lists), borrowed(near)
    cells, order, ahead = borrowed(cells), borrowed(order), borrowed(ahead)
    found = np.int64(0)
    for j in range(order.size):
        ahead[found] = order[j]
        found += np.int64(odds[np.uint32(order[j]), LOG_ODDS] >= least[j])
    for i in range(found):
        cell = np.int64(ahead[i])
        if cells[cell]:
            fetch_soon(ways, np.int64(counts[cell, ARRIVING]))
        else:
            fetch_soon(lists, list_of(cell, marks))
    for i in range(found):
        cell = np.int64(ahead[i])
        if cells[cell]:
            ray = counts[cell, ARRIVING]
            while ray != NOBODY:
                at = np.int64(ways[ray, AT])
                fetch_soon(paths, at)
                fetch_soon(paths, at - IN_LINE)
                fetch_soon(paths, at + IN_LINE)
                ray = ways[ray, NEXT]
        else:
            first = np.int64(lists[list_of(cell, marks), NEAR])
            fetch_soon(near, first)
            fetch_soon(near, first + IN_LINE)


@kernel
def sweep_lists(
    numbers, order, cells, records, bits, prior, odds, counts, ways, lows, paths, said,
    marks, lists, near, near_bits, width,
):  # fmt: skip
    """Draw every cell of `order` once, as `sweep_cells` does; return the number of flips.

    numbers  (C,) float64 in [0, 1), one for each
    What lies behind first hits is told of no ray afterwards.
    """
    cells, records, bits, ways = borrowed(cells), borrowed(records), borrowed(bits), borrowed(ways)
    odds, counts, lows = borrowed(odds), borrowed(counts), borrowed(lows)
    order, numbers = borrowed(order), borrowed(numbers)
    paths, said = borrowed(paths), borrowed(said)
    marks, lists = borrowed(marks), borrowed(lists)
    near, near_bits = borrowed(near), borrowed(near_bits)
    if counts[0, ARRIVING] == FORGOTTEN:
        begin_anew(records, odds, counts, ways, paths)
    alone = least_free(prior)
    least, ahead = np.empty(AT_ONCE, np.float32), np.empty(AT_ONCE + 1, np.int32)
    flips = np.int64(0)
    begin, at, size = np.int64(0), np.uint64(0), np.uint64(0)
    some, chances = order[:0], numbers[:0]
    while True:
        if at == size:
            begin += np.int64(size)
            some, chances = order[begin : begin + AT_ONCE], numbers[begin : begin + AT_ONCE]
            at, size = np.uint64(0), np.uint64(some.size)
            if size == 0:
                break
            least_log_odds(chances, least)
            fetch_ahead(some, least, cells, odds, counts, ways, paths, marks, lists, near, ahead)
        # Most cells are done here, by bits, not by branches: nobody can foretell what these do.
        changed = np.int64(0)
        while at < size:
            one = np.uint32(some[at])
            kept = odds[one, LOG_ODDS]
            if kept >= least[at]:
                break
            drawn = np.uint8((chances[at] < alone) & np.isnan(kept))
            changed += np.int64(drawn ^ cells[one])
            cells[one] = drawn
            at += np.uint64(1)
        flips += changed
        if at == size:
            continue
        cell, u = np.int64(some[at]), chances[at]
        kept = odds[cell, LOG_ODDS]
        at += np.uint64(1)
        threshold = logit(u)
        if cells[cell]:
            first = counts[cell, ARRIVING]
            if not occupied_log_odds(prior, first, cells, ways, paths, said) > threshold:
                cells[cell] = 0
                flips += 1
                let_pass(cell, prior, records, bits, odds, counts, ways, lows, paths, said)
        elif kept + SLACK >= threshold:
            row = cell // width
            column = cell - row * width
            number = list_of(cell, marks)  # where a ray arrives there is one
            first, last = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
            log_odds, most = free_log_odds(
                prior, first, last, column, row, ways, lows, said, near, near_bits
            )
            odds[cell, LOG_ODDS] = rounded_up(most)
            if log_odds > threshold:
                cells[cell] = 1
                flips += 1
                stop_rays(
                    cell, first, last, column, row, prior, records, bits, odds, counts, ways,
                    lows, paths, said, near, near_bits,
                )  # fmt: skip
    return flips
