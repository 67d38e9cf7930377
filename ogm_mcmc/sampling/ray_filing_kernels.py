"""Kernels that build the ray index; its layout is described in `ogm_mcmc.sampling.ray_index`.

Rays come as `BeamRays`, in cells of the window. Nothing is checked: every ray must lie inside.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import PLAN_SIZE, SHIFT, plan_ray
from ogm_mcmc.sampling.ray_index_kernels import (
    WIDTH,
    list_of,
    reaches_in_front,
    tile_of,
)
from ogm_mcmc.sampling.ray_line_kernels import (
    BEGINS_LEFT,
    BORDER,
    ENDS_LEFT,
    LEVEL,
    LOW_16,
    LOW_32,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    UPWARDS,
    first_place,
    lay_ray,
    place_of,
    places_of,
    row_of_ray,
)
from ogm_mcmc.sensors.forward_model import ForwardModel
from ogm_mcmc.sensors.forward_model_kernels import (
    level_log_likelihood,
    range_log_likelihood,
    unseen_log_likelihood,
)

# A cell takes less of a ray than this, cells.
MOST_IN_CELL = 1.5

LONGEST_RUN = 255

# Nats: what a ray can add to a cell counts in whole ones of these. So sums in float32 are exact up
# to 2**24 of them, 1024 nats, and what was added can be taken away again without a rest. Beyond
# that, where a robot stood for long, sums are rounded upwards and a rest stays: still a bound.
GRAIN_OF_GAIN = 2.0**-14

# Nats: a ray tells something of a cell that makes a difference of more than this to it.
TELLING = 0.5


@njit(cache=True, nogil=True, inline='always')
def per_unit(direction):
    """Reciprocal of one component of a direction, huge where the ray never moves that way."""
    if abs(direction) > 1e-300:
        return 1.0 / direction
    return 1e300 if direction >= 0.0 else -1e300


@njit(cache=True, nogil=True, inline='always')
def sum_rounded_up(total, term):
    """Add to a float32 that must not become less than the sum: a bound stays a bound.

    The term may be negative, the sum not.
    """
    exact = np.float64(total) + term
    rounded = np.float32(exact)
    return rounded if rounded >= exact else np.float32(exact * (1.0 + 2.0**-23))


@njit(cache=True, nogil=True, inline='always')
def most_added(value, lowest):
    """Return the most that a ray can add to a cell, nats, rounded up: see `GRAIN_OF_GAIN`.

    value, lowest  its log-likelihood there, and the lowest of what lies behind
    """
    more = np.float64(value) - np.float64(lowest)
    return np.ceil(more / GRAIN_OF_GAIN) * GRAIN_OF_GAIN if more > 0.0 else 0.0


@njit(cache=True, nogil=True)
def longest_ray(lengths):
    """Return more cells than any ray of these lengths crosses."""
    longest = 0
    for length in lengths:
        longest = max(longest, int(2.0 * length) + 6)
    return longest


@njit(cache=True, nogil=True)
def near_from(model, reading, reach):
    """Return (level, from how many m on it is not level): see `level_log_likelihood`.

    What a hit adds to the level falls with the distance like exp(-d^2 / 2 sigma^2); where it is
    lost in the rounding of a float32 the likelihood is level.
    """
    level, near = level_log_likelihood(model, reading, reach)
    if near == math.inf:
        return level, -math.inf
    adds = 2.0 * model.hit / model.missing
    if reading <= reach:
        adds = 2.0 * model.hit * reach / (model.clutter * model.sigma_m)
    lost = max(abs(level), 1e-3) * 2.0**-25
    near = min(near, model.sigma_m * math.sqrt(2.0 * max(math.log(adds / lost), 1.0)))
    return level, min(reading, reach) - near


@njit(cache=True, nogil=True, inline='always')
def with_sigma(model, sigma):
    """Return the model of one beam, the standard deviation of which is `sigma`, m."""
    return ForwardModel(
        model.is_gaussian, sigma, model.hit, model.clutter, model.missing, model.short,
        model.short_decay, model.depth,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def nearest_of(model, readings, reaches, sigmas, nearest):
    """Fill `nearest` (n,) with from how many m on the likelihood of each beam is not level."""
    for n in range(readings.size):
        nearest[n] = near_from(with_sigma(model, sigmas[n]), readings[n], reaches[n])[1]


@njit(cache=True, nogil=True)
def near_cells(rays, n, ray, nearest, resolution, depth, columns, rows, distances):
    """List the cells of a laid ray (5,) from the first one at least `nearest` m away; count them.

    rays, n    the beam, `BeamRays` and its number there
    columns, rows, distances  (longest,), output: window cells, and where in each of them, `depth`
               of the way through, the beam would be reflected, m
    """
    x, y, ux, uy = rays.x[n], rays.y[n], rays.ux[n], rays.uy[n]
    start, shape = ray[START], ray[SHAPE]
    column0, row0 = start & LOW_32, start >> 32
    flags, last = shape >> 48, shape & LOW_16
    across = 1 if flags & RIGHTWARDS else -1
    up = 1 if flags & UPWARDS else -1
    # Begin a little before the first one.
    column, at = column0, np.int64(0)
    before = nearest / resolution - MOST_IN_CELL
    if before > 0.0:
        at = min(max(np.int64(math.floor(y + before * uy)) * up, np.int64(0)), last)
        column += np.int64(math.floor(x + before * ux))
    row = row0 + up * at
    begins, ends, _ = row_of_ray(ray[BORDER], ray[SLOPE], start, shape, row)
    column = min(max(column, min(begins, ends)), max(begins, ends))
    right, upper = (1.0 if ux >= 0.0 else 0.0), (1.0 if uy >= 0.0 else 0.0)
    per_x, per_y = per_unit(ux), per_unit(uy)
    count = 0
    while True:
        # A ray leaves a cell by its right or left, and by its upper or lower border; one that
        # runs along an axis never meets the border beside it.
        here_x, here_y = column - column0 - x, row - row0 - y
        entering = max((here_x + (1.0 - right)) * per_x, (here_y + (1.0 - upper)) * per_y, 0.0)
        # Next to a corner rounding may let a ray leave a cell before it comes in.
        leaving = max(min((here_x + right) * per_x, (here_y + upper) * per_y), entering)
        distance = (entering + depth * (leaving - entering)) * resolution
        if count > 0 or distance >= nearest:
            columns[count], rows[count], distances[count] = column, row, distance
            count += 1
        if column != ends:
            column += across
        elif at == last:
            break
        else:
            at += 1
            row += up
            column, ends, _ = row_of_ray(ray[BORDER], ray[SLOPE], start, shape, row)
    return count


@njit(cache=True, nogil=True)
def lay_rays(beams, model, resolution, width, rays, counts):
    """Fill `rays` (n, 5) from n beams, and count in `counts` (K,) int32 their near cells.

    A beam with reading nan is a line alone: it says nothing yet, and is near from its reach on.
    """
    ray_bits = rays.view(np.float32)
    longest = longest_ray(beams.length)
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    distances = np.empty(longest)
    plan = np.empty(PLAN_SIZE, np.int64)
    for n in range(beams.length.size):
        x, y, length = beams.x[n], beams.y[n], beams.length[n]
        reading, reach = beams.reading[n], beams.reach[n]
        end_x, end_y = x + length * beams.ux[n], y + length * beams.uy[n]
        plan_ray(np.int64(beams.column[n]), np.int64(beams.row[n]), x, y, end_x, end_y, plan)
        lay_ray(plan, end_y < y, rays[n])
        level, nearest, unseen = 0.0, reach, 0.0
        if not math.isnan(reading):
            own = with_sigma(model, beams.sigma[n])
            level, nearest = near_from(own, reading, reach)
            unseen = unseen_log_likelihood(own, reading, reach, length * resolution)
        ray_bits[n, LEVEL] = level
        ray_bits[n, UNSEEN] = unseen
        count = near_cells(
            beams, n, rays[n], nearest, resolution, model.depth, columns, rows, distances
        )
        start, shape = rays[n, START], rays[n, SHAPE]
        near = places_of(shape)
        if count > 0:
            near = np.int64(place_of(shape >> 48, columns[0], rows[0])) - first_place(start, shape)
        rays[n, SHAPE] = shape | (near << 32)
        for p in range(count):
            counts[rows[p] * width + columns[p]] += 1


@njit(cache=True, nogil=True)
def file_near(
    beams, model, resolution, first_ray, rays, marks, next_pair, near, gain, telling, grid
):  # fmt: skip
    """Enter beams, the rays from `first_ray` on, in the lists of the cells they are near to.

    next_pair  (S,) int32, in and out: where the next pair of each list goes
    Adds to `gain` (S,) what each pair can at most add to the log-odds of its cell: the likelihood
    of ending there less the lowest of what lies behind. Fills `telling` (N,) int32.
    """
    near_bits = near.view(np.float32)
    ray_bits = rays.view(np.float32)
    longest = longest_ray(beams.length)
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    distances = np.empty(longest)
    for n in range(beams.length.size):
        ray = first_ray + n
        reading, reach = beams.reading[n], beams.reach[n]
        level, nearest, varies, near_to = 0.0, reach, 0.0, 0.0
        own = with_sigma(model, beams.sigma[n])
        if not math.isnan(reading):
            level, nearest = near_from(own, reading, reach)
            _, varies = level_log_likelihood(own, reading, reach)
            near_to = min(reading, reach)
        count = near_cells(
            beams, n, rays[ray], nearest, resolution, model.depth, columns, rows, distances
        )
        start, shape = rays[ray, START], rays[ray, SHAPE]
        code = np.int32((ray << 2) | ((shape >> 48) & 3))
        unseen = ray_bits[ray, UNSEEN]
        lowest, last = unseen, -1
        for p in range(count - 1, -1, -1):
            value = np.float32(level)
            if abs(distances[p] - near_to) < varies:
                value = np.float32(range_log_likelihood(own, reading, reach, distances[p]))
            number = list_of(rows[p] * grid[WIDTH] + columns[p], marks)
            i = next_pair[number]
            next_pair[number] = i + 1
            near[i, 0] = code
            near_bits[i, 1] = value
            if last < 0 and abs(value - unseen) > TELLING:
                last = p
            if value > lowest:
                gain[number] = sum_rounded_up(gain[number], most_added(value, lowest))
            else:
                lowest = value
        telling[ray] = 0
        if last >= 0:
            place = np.int64(place_of(code, columns[last], rows[last]))
            telling[ray] = place - first_place(start, shape) + 1
        elif abs(ray_bits[ray, LEVEL] - unseen) > TELLING:
            telling[ray] = min((shape >> 32) & LOW_16, places_of(shape))


@njit(cache=True, nogil=True)
def walk_front(
    first_ray, end_ray, rays, marks, full, grid, crossed, tile_last, tile_run, next_run,
    next_front, runs, run_lengths, front, filing,
):  # fmt: skip
    """Follow the rays from `first_ray` to `end_ray`; enter them where level, or only count.

    crossed    (ceil(K / 8),) uint8, in and out: a bit for each cell that a ray crosses
    tile_last, tile_run  (Q,) int32, in and out: the last ray of each tile, and of how many rays,
               one after the other, the last run consists
    next_run   (Q,) int32, in and out: where the next run of each tile goes
    next_front (S,) int32, in and out: where the next ray of each full list goes
    runs, run_lengths, front  output where `filing`
    Returns the number of pairs of a ray and a cell.
    """
    width, pairs = grid[WIDTH], np.int64(0)
    for ray in range(first_ray, end_ray):
        border, slope, start, shape = rays[ray, 0], rays[ray, 1], rays[ray, 2], rays[ray, 3]
        flags, last = shape >> 48, shape & LOW_16
        across = 1 if flags & RIGHTWARDS else -1
        up = 1 if flags & UPWARDS else -1
        code = np.int32((ray << 2) | (flags & 3))
        left = (shape >> 32) & LOW_16  # columns and rows to go in front
        row = start >> 32
        tile_before = np.int64(-1)
        column, ends, behind = row_of_ray(border, slope, start, shape, row)
        before = place_of(flags, column, row)
        for at in range(last + 1):
            if at > 0:
                row += up
                column = (behind - (1 if flags & BEGINS_LEFT else 0)) >> SHIFT
                behind += slope
                ends = (behind - (1 if flags & ENDS_LEFT else 0)) >> SHIFT
                if at == last:
                    ends = (start & LOW_32) + across * ((shape >> 16) & LOW_16)
            pairs += abs(ends - column) + 1
            for there in range(column, ends + across, across):
                cell = row * width + there
                crossed[cell >> 3] |= np.uint8(1 << (cell & 7))
                if place_of(flags, there, row) - before >= left:
                    continue
                tile = tile_of(there, row, grid)
                if tile != tile_before:
                    tile_before = tile
                    if tile_last[tile] == ray - 1 and 0 < tile_run[tile] < LONGEST_RUN:
                        tile_run[tile] += 1
                        if filing:
                            run_lengths[next_run[tile] - 1] += np.uint8(1)
                    elif tile_last[tile] != ray or tile_run[tile] == 0:
                        tile_run[tile] = 1
                        if filing:
                            runs[next_run[tile]] = ray
                            run_lengths[next_run[tile]] = 1
                        next_run[tile] += 1
                    tile_last[tile] = ray
                number = list_of(cell, marks)
                if number >= 0 and full[number]:
                    if filing:
                        front[next_front[number]] = code
                    next_front[number] += 1
    return pairs


@njit(cache=True, nogil=True)
def spread(before, where, after, entries):
    """Move the entries of every list to where it begins now, last list first.

    before  (S,) int64: old beginnings and the end of the last; where (S - 1,): their new numbers;
    after   new beginnings, none before the old one; entries (T, n): the last axis stays together
    """
    for number in range(where.size - 1, -1, -1):
        begin, end = before[number], before[number + 1]
        shift = after[where[number]] - begin
        if shift == 0:
            continue
        for i in range(end - 1, begin - 1, -1):
            for k in range(entries.shape[1]):
                entries[i + shift, k] = entries[i, k]


@njit(cache=True, nogil=True)
def fill_fronts(numbers, places, n_rays, tiles, runs, run_lengths, rays, grid, next_front, front):
    """Enter the rays up to `n_rays` in lists that become full; `front` empty: count them.

    numbers, places  (n,) the lists and their cells
    """
    for j in range(numbers.size):
        row, column = places[j] // grid[WIDTH], places[j] % grid[WIDTH]
        tile = tile_of(column, row, grid)
        at = next_front[numbers[j]]
        for i in range(tiles[tile], tiles[tile + 1]):
            for ray in range(runs[i], min(runs[i] + run_lengths[i], n_rays)):
                if reaches_in_front(ray, column, row, rays):
                    if front.size:
                        front[at] = (ray << 2) | ((rays[ray, SHAPE] >> 48) & 3)
                    at += 1
        next_front[numbers[j]] = at
