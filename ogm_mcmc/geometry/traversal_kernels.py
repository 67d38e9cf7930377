"""Kernels for the cells a segment crosses; the design note is in the package docstring.

Coordinates are in cells, relative to the lower left corner of the sensor's cell; `column` and
`row` say where that cell lies in the array. A crossed cell shares a point with the half-open
square [i, i + 1) x [j, j + 1). Nothing is checked: the segment must lie inside the array and be
shorter than 2**18 cells.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.reading_kernels import is_informative

FRACTION_BITS = 40
UNIT = float(2**FRACTION_BITS)
SHIFT = np.int64(FRACTION_BITS)
STEEPEST = 2.0**20  # columns per row; more only happens to rays that cross one border

# What `plan_ray` writes.
HERE, END, LEAVING, STEP, RIGHTWARDS, FIRST_ROW, ROWS_UP = range(7)
PLAN_SIZE = 7

WORD = np.uint64(6)  # 64 cells of a row share one word of the bit set
IN_WORD = np.uint64(63)
ONE = np.uint64(1)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)


@njit(cache=True, nogil=True, inline='always')
def mark_run(bits, row_start, first, last):
    """Set the bits of columns `first` to `last` of the row whose words begin at `row_start`."""
    first_word = row_start + (first >> WORD)
    last_word = row_start + (last >> WORD)
    from_first = ALL << (first & IN_WORD)
    to_last = ALL >> (IN_WORD - (last & IN_WORD))
    if first_word == last_word:
        bits[first_word] |= from_first & to_last
    else:
        bits[first_word] |= from_first
        word = first_word + ONE
        while word < last_word:
            bits[word] = ALL
            word += ONE
        bits[last_word] |= to_last


@njit(cache=True, nogil=True, inline='always')
def plan_ray(column, row, x0, y0, x1, y1, plan):
    """Prepare a segment for walking upwards, row by row.

    plan  (7,) int64, output. Columns are in units of 2**-40 cells, see the names above:
          HERE where the walk begins, END where it ends, LEAVING where it leaves the first row,
          STEP how much further right it leaves each row after that; RIGHTWARDS whether STEP
          goes that way; FIRST_ROW; ROWS_UP how many rows come after the first.
    Planning all rays of a scan before walking any keeps divisions off the walks' critical path.
    """
    if y1 < y0:
        x0, x1, y0, y1 = x1, x0, y1, y0
    first_row = math.floor(y0)
    rows_up = math.floor(y1) - first_row
    shift = np.int64(column) << SHIFT
    here = np.int64(math.floor(x0 * UNIT)) + shift
    end = np.int64(math.floor(x1 * UNIT)) + shift
    leaving, step = here, np.int64(0 if x1 >= x0 else -1)
    if rows_up > 0:
        slope = (x1 - x0) / (y1 - y0)
        up = first_row + 1 - y0
        # A segment can pass a border at an angle that is no float; its share of the way still is.
        across = up * slope if abs(slope) < STEEPEST else up / (y1 - y0) * (x1 - x0)
        edge = (x0 + across) * UNIT
        # Rounded towards where the walk began, and never past its end: whatever the rounding,
        # no cell outside of the segment's own columns is touched.
        if x1 >= x0:
            leaving = max(min(np.int64(math.floor(edge)) + shift, end), here)
            # The cell right of an edge met exactly belongs to the row above. A walk straight up
            # along such an edge stays on its right: an odd number of units is never on an edge.
            if leaving == here:
                leaving |= np.int64(1)
            if rows_up > 1:
                step = np.int64(slope * UNIT)
                if leaving + (rows_up - 1) * step > max(end, leaving):
                    step = max(np.int64(0), (end - leaving) // (rows_up - 1))
                if step == 0:
                    leaving |= np.int64(1)
        else:
            leaving = max(min(np.int64(math.ceil(edge)) + shift, here), end)
            if rows_up > 1:
                step = min(np.int64(slope * UNIT), np.int64(-1))
                if leaving + (rows_up - 1) * step < end:
                    step = -((leaving - end) // (rows_up - 1))
    plan[HERE] = here
    plan[END] = end
    plan[LEAVING] = leaving
    plan[STEP] = step
    plan[RIGHTWARDS] = x1 >= x0
    plan[FIRST_ROW] = row + first_row
    plan[ROWS_UP] = rows_up


@njit(cache=True, nogil=True, inline='always')
def mark_plan(bits, words_per_row, plan):
    """Set the bit of every cell of a planned segment, one run of columns per row.

    bits  (height * words_per_row,) uint64, bit c of a row at word c // 64, position c % 64
    Cost: one OR per crossed row, more where a run spans several words.
    """
    here, end, leaving, step = plan[HERE], plan[END], plan[LEAVING], plan[STEP]
    rows_up = plan[ROWS_UP]
    start = np.uint64(plan[FIRST_ROW]) * words_per_row
    if rows_up == 0:
        left, right = min(here, end), max(here, end)
        mark_run(bits, start, np.uint64(left >> SHIFT), np.uint64(right >> SHIFT))
    elif plan[RIGHTWARDS]:
        first = here >> SHIFT
        for _ in range(rows_up):
            mark_run(bits, start, np.uint64(first), np.uint64((leaving - 1) >> SHIFT))
            first = leaving >> SHIFT
            leaving += step
            start += words_per_row
        mark_run(bits, start, np.uint64(first), np.uint64(max(first, end >> SHIFT)))
    else:
        last = here >> SHIFT
        for _ in range(rows_up):
            first = leaving >> SHIFT
            mark_run(bits, start, np.uint64(first), np.uint64(last))
            last = first
            leaving += step
            start += words_per_row
        mark_run(bits, start, np.uint64(min(last, end >> SHIFT)), np.uint64(last))


@njit(cache=True, nogil=True)
def trace_ray(column, row, x0, y0, x1, y1, columns, rows):
    """List the cells the segment crosses in the order it crosses them; return their number.

    columns, rows  (n,) int64, output; n at least |dx| + |dy| + 3 cells
    From the plan that `mark_plan` takes, so the same cells.
    """
    plan = np.empty(PLAN_SIZE, np.int64)
    plan_ray(column, row, x0, y0, x1, y1, plan)
    leaving, step, end = plan[LEAVING], plan[STEP], plan[END] >> SHIFT
    entering = plan[HERE] >> SHIFT
    rows_up, rightwards = plan[ROWS_UP], plan[RIGHTWARDS]
    count = 0
    for k in range(rows_up + 1):
        if k == rows_up:
            target = end
            if rows_up > 0:
                target = max(entering, end) if rightwards else min(entering, end)
        else:
            target = (leaving - 1) >> SHIFT if rightwards else leaving >> SHIFT
        direction = 1 if target >= entering else -1
        for cell in range(entering, target + direction, direction):
            columns[count] = cell
            rows[count] = plan[FIRST_ROW] + k
            count += 1
        entering = leaving >> SHIFT
        leaving += step
    if y1 < y0:
        columns[:count] = columns[:count][::-1].copy()
        rows[:count] = rows[:count][::-1].copy()
    return count


@njit(cache=True, nogil=True)
def beam_ends(
    ranges,
    directions,
    cosine,
    sine,
    x,
    y,
    cells_per_m,
    range_min,
    range_max,
    reach,
    no_return_clears,
    ends,
    hit,
):
    """Turn ranges into end points; return (rays kept, left, bottom, right, top cell of all).

    ranges      (B,) float32, m, as in `Scan`
    directions  (2, B) unit vectors in the sensor frame; cosine, sine: heading of the sensor
    x, y        sensor, cells, in [0, 1); ends (2, B) and hit (B,) uint8 are filled from the front
    reach       m; a longer reading clears up to here and hits nothing; so does +inf, or it says
                nothing unless `no_return_clears`
    """
    count = 0
    left = right = bottom = top = 0.0
    for beam in range(ranges.size):
        reading = np.float64(ranges[beam])
        if not is_informative(reading, range_min, range_max, no_return_clears):
            continue
        scale = min(reading, reach) * cells_per_m
        end_x = x + scale * (directions[0, beam] * cosine - directions[1, beam] * sine)
        end_y = y + scale * (directions[0, beam] * sine + directions[1, beam] * cosine)
        left, right = min(left, end_x), max(right, end_x)
        bottom, top = min(bottom, end_y), max(top, end_y)
        ends[0, count] = end_x
        ends[1, count] = end_y
        hit[count] = reading <= reach
        count += 1
    return count, math.floor(left), math.floor(bottom), math.floor(right), math.floor(top)


@njit(cache=True, nogil=True)
def sampled_beam_ends(
    ranges,
    directions,
    cells,
    placed,
    cells_per_m,
    range_min,
    range_max,
    reach,
    no_return_clears,
    ends,
    hit,
    boxes,
):
    """Run `beam_ends` for M placed sensors; return the number of rays, the same for each.

    cells (M, 2) int64 column and row of each sensor; placed (M, 4) its x, y, cosine, sine
    ends (M, 2, B), hit (B,) uint8, boxes (M, 4) int64: output, see `SampledRays`
    """
    count = 0
    for k in range(cells.shape[0]):
        count, left, bottom, right, top = beam_ends(
            ranges,
            directions,
            placed[k, 2],
            placed[k, 3],
            placed[k, 0],
            placed[k, 1],
            cells_per_m,
            range_min,
            range_max,
            reach,
            no_return_clears,
            ends[k],
            hit,
        )
        boxes[k, 0] = cells[k, 0] + left
        boxes[k, 1] = cells[k, 1] + bottom
        boxes[k, 2] = cells[k, 0] + right + 1
        boxes[k, 3] = cells[k, 1] + top + 1
    return count
