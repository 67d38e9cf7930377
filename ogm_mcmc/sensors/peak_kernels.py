"""The density of a hit without its far tails, as localizing needs it. Lengths in cells or m."""

import math

from numba import njit

from ogm_mcmc.sensors.forward_model_kernels import LOG_SQRT_2PI, below

# Localizing needs no exact tails, and they cost a third of the time: a hit so many sigma away is
# left out, and so is what less than this share of a beam's chance is left for. Clutter is above.
FAR, NOTHING_LEFT = 5.5, 1e-7


@njit(cache=True, nogil=True, inline='always')
def peak(reading, distance, reach, sigma):
    """Density of a hit at `distance`, one without a return the probability to be beyond `reach`.

    As the `beam` model has it, a range being positive.
    """
    if reading > reach:
        return below((distance - reach) / sigma) / below(distance / sigma)
    off = (reading - distance) / sigma
    if abs(off) >= FAR:
        return 0.0
    density = math.exp(-0.5 * off * off - LOG_SQRT_2PI) / sigma
    return density if distance > FAR * sigma else density / below(distance / sigma)
