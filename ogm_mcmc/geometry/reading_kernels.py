"""What a range says (REP 117), for kernels; `Scan.informative` is the same for arrays."""

import math

from numba import njit


@njit(cache=True, nogil=True, inline='always')
def is_measured(reading, range_min, range_max):
    """Whether something was met at this range, m: a finite one above 0 within the limits."""
    return 0.0 < reading < math.inf and range_min <= reading <= range_max


@njit(cache=True, nogil=True, inline='always')
def is_informative(reading, range_min, range_max, no_return_clears):
    """Whether a range says anything: it was measured, or it is +inf and `no_return_clears`."""
    return (reading == math.inf and no_return_clears) or is_measured(reading, range_min, range_max)
