"""Exact squared distance to the nearest marked cell, in two passes of parabolas."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def lower_envelope(heights, result, places, borders):
    """result[q] = min over p of (q - p)^2 + heights[p]; heights may be inf.

    heights, result  (n,) float64; places (n,) int64 and borders (n + 1,) float64 are scratch
    Parabolas of equal width cross once, so their minimum is a sequence of them from left to
    right, found with a stack. Cost: O(n).
    """
    last = -1
    for place in range(heights.size):
        if heights[place] == math.inf:
            continue
        border = -math.inf
        while last >= 0:
            before = places[last]
            # Where the parabola of `place` gets below the one of `before`.
            border = 0.5 * ((heights[place] - heights[before]) / (place - before) + place + before)
            if border > borders[last]:
                break
            last -= 1
            border = -math.inf
        last += 1
        places[last] = place
        borders[last] = border
    if last < 0:
        result[:] = math.inf
        return
    borders[last + 1] = math.inf
    at = 0
    for q in range(heights.size):
        while borders[at + 1] < q:
            at += 1
        gap = np.float64(q - places[at])
        result[q] = gap * gap + heights[places[at]]


@njit(cache=True, nogil=True)
def squared_distances(marked, squared):
    """Squared distance, cells^2, of every cell's centre to that of the nearest marked one.

    marked   (height, width) bool
    squared  (height, width) float64, output; inf where nothing is marked at all
    """
    height, width = marked.shape
    longest = max(height, width)
    places = np.empty(longest, np.int64)
    borders = np.empty(longest + 1, np.float64)
    line = np.empty(longest, np.float64)
    out = np.empty(longest, np.float64)
    for column in range(width):
        for row in range(height):
            line[row] = 0.0 if marked[row, column] else math.inf
        lower_envelope(line[:height], out[:height], places, borders)
        for row in range(height):
            squared[row, column] = out[row]
    for row in range(height):
        for column in range(width):
            line[column] = squared[row, column]
        lower_envelope(line[:width], out[:width], places, borders)
        for column in range(width):
            squared[row, column] = out[column]
