"""Kernels that draw cells from log-odds that are kept; why: `ogm_mcmc.sampling.kept_odds`.

odds    (K, 2) float32: LOG_ODDS of each free cell where a ray arrives, never below those given
        the present map; ARRIVING, how many rays do. NaN in the first of all: nothing is kept
zones   (N, 4) int32: the first cell of each ray where ending is less than `FAR` below its best,
        OFFSET, which is to be added to a place for where its likelihood lies in `values`; as
        `lowest`, the same memory as float32, LOWEST: a hit counts as no better in cells in front
values  (V,) float32: the likelihoods of a ray side by side, one for each place
"""

import math

import numpy as np

from ogm_mcmc.geometry.traversal_kernels import SHIFT
from ogm_mcmc.sampling.borrowed_arrays import borrowed
from ogm_mcmc.sampling.gibbs_kernels import SLACK, UNTOLD
from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_index_kernels import NEAR, NOTHING, WIDTH, list_of, near_entry
from ogm_mcmc.sampling.ray_line_kernels import (
    BEGINS_LEFT,
    BORDER,
    ENDS_LEFT,
    LOW_16,
    LOW_32,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    UPWARDS,
    cells_of_ray,
    next_occupied,
    place_of,
    places_of,
)

LOG_ODDS, ARRIVING = range(2)

# Columns of `zones`.
ZONE_COLUMN, ZONE_ROW, LOWEST, OFFSET = range(4)

# Nats below the best that a ray can be: where its zone begins, and LOWEST.
FAR, SLIP = 8.0, 3.0

# Twice what a float32 is rounded by: kept numbers are rounded upwards.
UPWARDS_BY = 1.2e-7

# Less than log(2**-53): no random number above 0 is so small.
NEVER = -37.0


@inlined
def rounded_up(value):
    """Return a float32 that is no smaller."""
    return np.float32(value + abs(value) * UPWARDS_BY)


@kernel
def find_zones(
    marks, lists, near, near_bits, rays, ray_bits, width, zones, lowest, values
):  # fmt: skip
    """Fill `zones` (N, 4) int32, `lowest`, the same memory as float32, and `values`."""
    total = np.int64(0)
    for ray in range(rays.shape[0]):
        shape = rays[ray, SHAPE]
        columns, rows = np.empty((2, places_of(shape)), np.int64)
        count = cells_of_ray(rays[ray], columns, rows)
        code = (ray << 2) | ((shape >> 48) & 3)
        offset = total - place_of(code, columns[0], rows[0])
        best = ray_bits[ray, UNSEEN]
        for i in range(count):
            number = list_of(rows[i] * width + columns[i], marks)
            value = near_bits[near_entry(code, number, lists, near), 1]
            values[offset + place_of(code, columns[i], rows[i])] = value
            best = max(best, value)
        first = 0
        while first < count - 1:
            if values[offset + place_of(code, columns[first], rows[first])] >= best - FAR:
                break
            first += 1
        zones[ray, ZONE_COLUMN], zones[ray, ZONE_ROW] = columns[first], rows[first]
        zones[ray, OFFSET] = offset
        lowest[ray, LOWEST] = np.float32(best - SLIP)
        total += places_of(shape)


@inlined
def value_behind(ray, column, row, cells, zones, values, rays, ray_bits, width):
    """As `hit_behind`, of a ray whose likelihoods lie side by side."""
    cell, place = next_occupied(
        rays[ray, BORDER], rays[ray, SLOPE], rays[ray, START], rays[ray, SHAPE], column, row,
        width, cells,
    )  # fmt: skip
    value = ray_bits[ray, UNSEEN]
    if cell >= 0:
        value = values[zones[ray, OFFSET] + place]
    else:
        place = NOTHING
    return place, value


@kernel
def tell_cells(
    ray, flipped, far, entering, here, there, prior, odds, zones, lowest, values, rays, width
):  # fmt: skip
    """Keep `odds` right along a ray whose first hit changed.

    flipped, far  places of the cell that flipped and of the other first hit, or behind the ray's
                  end: in turn, the cells in front, those between and the far one are told
    entering      whether the ray goes on to the far one now, or did so before
    here, there   log p(z | the one that flipped, the far one, is hit)
    """
    odds, zones, lowest = borrowed(odds), borrowed(zones), borrowed(lowest)
    values, rays = borrowed(values), borrowed(rays)
    slope, start, shape = rays[ray, SLOPE], rays[ray, START], rays[ray, SHAPE]
    flags, rows = shape >> 48, shape & LOW_16
    across = 1 if flags & RIGHTWARDS else -1
    up = 1 if flags & UPWARDS else -1
    begins_left = 1 if flags & BEGINS_LEFT else 0
    ends_left = 1 if flags & ENDS_LEFT else 0
    last_column = (start & LOW_32) + across * ((shape >> 16) & LOW_16)
    column, row = np.int64(zones[ray, ZONE_COLUMN]), np.int64(zones[ray, ZONE_ROW])
    zone, low = np.int64(place_of(flags, column, row)), np.float64(lowest[ray, LOWEST])
    change = here - there if entering else there - here
    change_far = min(here, low) - min(there, low)
    if not entering:
        change_far = -change_far
    if change_far != 0.0 or flipped < zone:
        column, row = start & LOW_32, start >> 32
    place = np.int64(place_of(flags, column, row))
    offset = zones[ray, OFFSET]
    at = (row - (start >> 32)) * up
    behind = rays[ray, BORDER] + at * slope
    while True:
        ends = last_column if at == rows else (behind - ends_left) >> SHIFT
        cell = row * width + column
        steps = min((ends - column) * across + 1, far - place + 1)
        for _ in range(steps):
            if place < flipped:
                more = change if place >= zone else change_far
                odds[cell, LOG_ODDS] = rounded_up(np.float64(odds[cell, LOG_ODDS]) + more)
            elif place > flipped:
                arriving = odds[cell, ARRIVING]
                if place < far:
                    said = np.float64(values[offset + place]) - (
                        there if place >= zone else min(there, low)
                    )
                    before = np.float64(odds[cell, LOG_ODDS]) if arriving > 0 else prior
                    odds[cell, LOG_ODDS] = rounded_up(before + (said if entering else -said))
                odds[cell, ARRIVING] = arriving + (1 if entering else -1)
            place += 1
            cell += across
        if at == rows or place > far:
            break
        # The next row begins a place further, in the same column or one beside.
        at += 1
        row += up
        column = (behind - begins_left) >> SHIFT
        place += (column - ends) * across
        behind += slope


@kernel
def count_arriving(records, odds, prior, rays, width):
    """Fill `odds` (K, 2) from first hits: of cells where a ray arrives nothing is known."""
    for cell in range(odds.shape[0]):
        odds[cell, LOG_ODDS], odds[cell, ARRIVING] = prior, 0.0
    for ray in range(records.shape[0]):
        start, shape = rays[ray, START], rays[ray, SHAPE]
        flags, rows = shape >> 48, shape & LOW_16
        across = 1 if flags & RIGHTWARDS else -1
        column, row = start & LOW_32, start >> 32
        last_column = column + across * ((shape >> 16) & LOW_16)
        behind = rays[ray, BORDER]
        for at in range(rows + 1):
            ends = (behind - (1 if flags & ENDS_LEFT else 0)) >> SHIFT
            if at == rows:
                ends = last_column
            for x in range(column, ends + across, across):
                if place_of(flags, x, row) <= records[ray, 0]:
                    odds[row * width + x, LOG_ODDS] = np.inf
                    odds[row * width + x, ARRIVING] += 1.0
            row += 1 if flags & UPWARDS else -1
            column = (behind - (1 if flags & BEGINS_LEFT else 0)) >> SHIFT
            behind += rays[ray, SLOPE]


@inlined
def surely_free(u, log_odds):
    """Whether u, even from [0, 1), is above a probability, without its exponential.

    p < exp(-x) <= 1 / (1 + x + x^2 / 2 + x^3 / 6 + x^4 / 24), x = - log-odds > 0.
    """
    x = -np.float64(log_odds)
    sure = False
    if u > 0.0 and x > 0.0:
        series = 1.0 + x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0)))
        sure = log_odds < NEVER or u * series > 1.0 + SLACK
    return sure


@inlined
def log_odds_of_lists(
    prior, begin, end, column, row, cells, records, bits, zones, lowest, values, near, near_bits,
    rays, ray_bits, width,
):  # fmt: skip
    """As `log_odds_unless_below`, in full, of a cell all of whose rays are in its list."""
    log_odds, most = prior, prior
    for i in range(begin, end):
        code = np.int64(near[i, 0])
        ray = code >> 2
        place, first = place_of(code, column, row), records[ray, 0]
        if first < place:
            continue
        now = bits[ray, 1]
        if first == place:
            _, now = value_behind(ray, column, row, cells, zones, values, rays, ray_bits, width)
        log_odds += np.float64(near_bits[i, 1]) - np.float64(now)
        if place < place_of(code, zones[ray, ZONE_COLUMN], zones[ray, ZONE_ROW]):
            now = min(now, lowest[ray, LOWEST])
        most += np.float64(near_bits[i, 1]) - np.float64(now)
    return log_odds, most


@kernel
def sweep_lists(
    numbers, order, cells, records, bits, prior, odds, zones, lowest, values, marks, lists,
    near, near_bits, rays, ray_bits, grid,
):  # fmt: skip
    """Draw every cell of `order` once, as `sweep_cells` does; return the number of flips.

    What lies behind first hits is told of no ray afterwards.
    """
    cells, records, bits = borrowed(cells), borrowed(records), borrowed(bits)
    odds, zones, lowest = borrowed(odds), borrowed(zones), borrowed(lowest)
    order, numbers = borrowed(order), borrowed(numbers)
    values, marks, lists = borrowed(values), borrowed(marks), borrowed(lists)
    near, near_bits = borrowed(near), borrowed(near_bits)
    rays, ray_bits, grid = borrowed(rays), borrowed(ray_bits), borrowed(grid)
    width = grid[WIDTH]
    if np.isnan(odds[0, LOG_ODDS]):
        count_arriving(records, odds, prior, rays, width)
        for n in range(records.shape[0]):
            records[n, 2] = UNTOLD
    alone = 1.0 / (1.0 + math.exp(-prior))
    flips = 0
    for j in range(order.size):
        cell = np.int64(order[j])
        u = numbers[j]
        before = cells[cell] != 0
        if odds[cell, ARRIVING] == 0:
            occupied = u < alone
            if abs(u - alone) < SLACK * alone:
                occupied = prior > math.log(u / (1.0 - u))
            if occupied != before:
                cells[cell] = occupied
                flips += 1
            continue
        if not before and surely_free(u, odds[cell, LOG_ODDS]):
            continue
        threshold = math.log(u / (1.0 - u)) if u > 0.0 else -math.inf
        if not before and threshold > odds[cell, LOG_ODDS] + SLACK:
            continue
        row = cell // width
        column = cell - row * width
        number = list_of(cell, marks)  # where a ray arrives there is one
        begin, end = np.int64(lists[number, NEAR]), np.int64(lists[number + 1, NEAR])
        log_odds, most = log_odds_of_lists(
            prior, begin, end, column, row, cells, records, bits, zones, lowest, values, near,
            near_bits, rays, ray_bits, width,
        )  # fmt: skip
        odds[cell, LOG_ODDS] = rounded_up(most)
        occupied = log_odds > threshold
        if occupied == before:
            continue
        cells[cell] = occupied
        flips += 1
        for i in range(begin, end):
            code = np.int64(near[i, 0])
            ray = code >> 2
            place, first = np.int64(place_of(code, column, row)), np.int64(records[ray, 0])
            here, there = np.float64(near_bits[i, 1]), np.float64(bits[ray, 1])
            far = first
            if occupied and first > place:
                records[ray, 0] = place
                bits[ray, 1] = near_bits[i, 1]
            elif not occupied and first == place:
                behind, now = value_behind(
                    ray, column, row, cells, zones, values, rays, ray_bits, width
                )
                records[ray, 0] = behind
                bits[ray, 1] = now
                far, there = np.int64(behind), np.float64(now)
            else:
                continue
            tell_cells(
                ray, place, far, not occupied, here, there, prior, odds, zones, lowest, values,
                rays, width,
            )  # fmt: skip
    return flips
