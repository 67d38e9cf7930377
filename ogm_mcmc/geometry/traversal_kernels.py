"""Kernels for the cells a segment crosses; the design note is in the package docstring.

Coordinates are in cells, relative to the lower left corner of the sensor's cell; `column` and
`row` say where that cell lies in the array. A crossed cell shares a point with the half-open
square [i, i + 1) x [j, j + 1). Nothing is checked: the segment must lie inside the array and be
shorter than 2**18 cells.
"""

import math

import numpy as np
from numba import njit

FRACTION_BITS = 44
UNIT = float(2**FRACTION_BITS)
SHIFT = np.int64(FRACTION_BITS)

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


@njit(cache=True, nogil=True)
def mark_ray(bits, words_per_row, column, row, x0, y0, x1, y1):
    """Set the bit of every cell the segment crosses, one run of columns per row.

    bits  (height * words_per_row,) uint64, bit c of a row at word c // 64, position c % 64
    Cost: one OR per crossed row, more where a run spans several words.
    """
    if y1 < y0:
        x0, x1, y0, y1 = x1, x0, y1, y0
    first_row = math.floor(y0)
    steps = math.floor(y1) - first_row
    start = np.uint64(row + first_row) * words_per_row
    shift = np.int64(column) << SHIFT
    here = np.int64(math.floor(x0 * UNIT)) + shift
    end = np.int64(math.floor(x1 * UNIT)) + shift
    if steps == 0:
        left, right = min(here, end), max(here, end)
        mark_run(bits, start, np.uint64(left >> SHIFT), np.uint64(right >> SHIFT))
        return
    slope = (x1 - x0) / (y1 - y0)
    # Where the segment leaves the first row; a row's upper edge belongs to the row above.
    leaving = np.int64(math.floor((x0 + (first_row + 1 - y0) * slope) * UNIT)) + shift
    step = np.int64(slope * UNIT) if steps > 1 else np.int64(0)
    if slope >= 0.0:
        first = here >> SHIFT
        for _ in range(steps):
            last = max((leaving - 1) >> SHIFT, first)
            mark_run(bits, start, np.uint64(first), np.uint64(last))
            first = leaving >> SHIFT
            leaving += step
            start += words_per_row
        mark_run(bits, start, np.uint64(first), np.uint64(max(first, end >> SHIFT)))
    else:
        last = here >> SHIFT
        for _ in range(steps):
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
    The same arithmetic as `mark_ray`, so the same cells.
    """
    downwards = y1 < y0
    if downwards:
        x0, x1, y0, y1 = x1, x0, y1, y0
    first_row = math.floor(y0)
    steps = math.floor(y1) - first_row
    shift = np.int64(column) << SHIFT
    here = np.int64(math.floor(x0 * UNIT)) + shift
    end = np.int64(math.floor(x1 * UNIT)) + shift
    slope = (x1 - x0) / (y1 - y0) if steps > 0 else 0.0
    leaving = np.int64(math.floor((x0 + (first_row + 1 - y0) * slope) * UNIT)) + shift
    step = np.int64(slope * UNIT) if steps > 1 else np.int64(0)
    entering = here >> SHIFT
    count = 0
    for k in range(steps + 1):
        if k == steps:
            target = end >> SHIFT
            if steps > 0:
                target = max(entering, target) if slope >= 0.0 else min(entering, target)
        elif slope >= 0.0:
            target = max((leaving - 1) >> SHIFT, entering)
        else:
            target = leaving >> SHIFT
        direction = 1 if target >= entering else -1
        for cell in range(entering, target + direction, direction):
            columns[count] = cell
            rows[count] = row + first_row + k
            count += 1
        entering = leaving >> SHIFT
        leaving += step
    if downwards:
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
        if reading == math.inf and no_return_clears:
            length = reach
        elif reading > 0.0 and range_min <= reading <= range_max:
            length = min(reading, reach)
        else:
            continue
        scale = length * cells_per_m
        end_x = x + scale * (directions[0, beam] * cosine - directions[1, beam] * sine)
        end_y = y + scale * (directions[0, beam] * sine + directions[1, beam] * cosine)
        left, right = min(left, end_x), max(right, end_x)
        bottom, top = min(bottom, end_y), max(top, end_y)
        ends[0, count] = end_x
        ends[1, count] = end_y
        hit[count] = reading <= reach
        count += 1
    return count, math.floor(left), math.floor(bottom), math.floor(right), math.floor(top)
