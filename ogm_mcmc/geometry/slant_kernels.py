"""Kernel of `ogm_mcmc.geometry.slants`."""

import math

import numpy as np
from numba import njit

# Readings in a row are of one surface where the middle one is as far from the line through the
# others as this share of how far they lie apart in range, and this many stretches more, at most.
FLAT_SHARE, FLAT_STRETCHES = 0.2, 0.6

# Readings further apart than this say nothing of what is between them; the sine of the angle.
MOST_APART = math.sin(math.radians(25.0))

# Where beams are dense, a stretch ends so many of them away at most, and within this angle.
MOST_BEAMS, WITHIN = 8, math.sin(math.radians(4.0))


@njit(cache=True, nogil=True)
def fill_slants(ranges, directions, stretch, slants):
    """Fill `slants` (B,) from ranges (B,), m, and unit vectors (2, B); see `slants_of`."""
    count = ranges.size
    slants[:] = 0.0
    for i in range(count if count > 2 else 0):
        reading = np.float64(ranges[i])
        if not 0.0 < reading < math.inf:
            continue
        ux, uy = directions[0, i], directions[1, i]
        beside = i + 1 if i + 1 < count else i - 1
        apart = abs(ux * directions[1, beside] - uy * directions[0, beside])
        if not 0.0 < apart <= MOST_APART:
            continue
        beams = min(math.ceil(stretch / (reading * apart)), MOST_BEAMS, WITHIN / apart)
        step = max(int(beams), 1)
        found = math.inf
        for middle in (i - step, i, i + step):
            first, last = middle - step, middle + step
            if first < 0 or last >= count:
                continue
            begin, end = np.float64(ranges[first]), np.float64(ranges[last])
            between = np.float64(ranges[middle])
            if not (0.0 < begin < math.inf and 0.0 < end < math.inf and 0.0 < between < math.inf):
                continue
            x, y = begin * directions[0, first], begin * directions[1, first]
            along_x, along_y = end * directions[0, last] - x, end * directions[1, last] - y
            across = directions[0, middle] * along_y - directions[1, middle] * along_x
            met = (x * along_y - y * along_x) / across if across != 0.0 else math.inf
            allowed = FLAT_SHARE * abs(end - begin) + FLAT_STRETCHES * stretch
            if not abs(met - between) <= allowed:
                continue
            sine = abs(ux * along_y - uy * along_x)
            found = min(found, abs(ux * along_x + uy * along_y) / max(sine, 1e-9))
        if found < math.inf:
            slants[i] = found
