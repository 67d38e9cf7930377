"""Kernels of the inverse sensor models; see `inverse_model` for what they mean."""

import math

import numpy as np
from numba import njit

# Phi at steps of 1 / STEPS_PER_SIGMA from -LAST to LAST; linear between, that is wrong by less
# than 8e-6, and by less than 0.3 % of itself in the tail.
LAST, STEPS_PER_SIGMA = 7.0, 64.0
PHI = np.array(
    [
        0.5 * math.erfc(-(step / STEPS_PER_SIGMA - LAST) * math.sqrt(0.5))
        for step in range(int(2 * LAST * STEPS_PER_SIGMA) + 2)
    ]
)


@njit(cache=True, nogil=True, inline='always')
def phi(x):
    """Return the standard normal distribution at x, from the table."""
    place = (min(max(x, -LAST), LAST) + LAST) * STEPS_PER_SIGMA
    index = np.uint64(place)
    low = PHI[index]
    return low + (place - np.float64(index)) * (PHI[index + np.uint64(1)] - low)


@njit(cache=True, nogil=True, inline='always')
def gaussian_log_odds(distance, reading, sigma, half_width, low, high):
    """Log-odds of a cell at `distance` after `reading` ([pose] Eq. 4, corrected), float32.

    distance, reading, sigma, half_width  in one unit of length; low, high  float32, nats
    g = Phi(a) - Phi(b) / 2 with a, b = (distance - reading +- half_width) / sigma
    """
    scale = 1.0 / sigma
    offset = distance - reading
    occupied = phi((offset + half_width) * scale) - 0.5 * phi((offset - half_width) * scale)
    # At the ends of what a float tells apart there is nothing to take the logarithm of.
    if occupied <= 0.0:
        return low
    if occupied >= 1.0:
        return high
    return min(max(np.float32(math.log(occupied / (1.0 - occupied))), low), high)


@njit(cache=True, nogil=True, inline='always')
def sonar_log_odds(distance, angle, reading, hit, strength, sigma, thickness):
    """Log-odds of a cell in the cone of a sonar, nats.

    distance, reading, thickness  m; angle  off the axis, rad; sigma  of the angle, rad
    strength  most the probability moves away from 0.5, on the axis; hit  whether there was an echo
    """
    offset = (distance - reading) / thickness
    if not hit:
        shape = -1.0 if offset <= 0.0 else 0.0
    elif offset < -1.0:
        shape = -1.0
    elif offset < -0.5:
        shape = 3.0 + 4.0 * offset
    elif offset <= 0.5:
        shape = 1.0
    else:
        shape = max(2.0 - 2.0 * offset, 0.0)
    off_axis = angle / sigma
    moved = shape * strength * math.exp(-0.5 * off_axis * off_axis)
    return math.log((0.5 + moved) / (0.5 - moved))
