"""Kernels that say how far rays tell anything; what they are for: `ogm_mcmc.sampling.informed`."""

import numpy as np
from numba import njit

from ogm_mcmc.sampling.ray_line_kernels import (
    BORDER,
    LOW_16,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UPWARDS,
    first_place,
    place_of,
    row_of_ray,
)

# Cells that are less likely occupied do not stop a ray. Hundreds of them would as independent
# ones; but the reading at its end says of all together that they are free.
DUST = np.float32(0.1)


@njit(cache=True, nogil=True)
def mark_arrivals(telling, probability, least, rays, width, arrival):
    """Raise `arrival` (K,) to the largest chance, over all rays, that one arrives at a cell.

    probability  (K,) float32 that a cell is occupied, taken as independent along a ray above DUST
    A ray is followed while it tells anything and its chance is at least `least`.
    """
    for ray in range(rays.shape[0]):
        start, shape = rays[ray, START], rays[ray, SHAPE]
        flags = shape >> 48
        across = 1 if flags & RIGHTWARDS else -1
        up = 1 if flags & UPWARDS else -1
        end = first_place(start, shape) + telling[ray]
        chance = np.float32(1.0)
        for at in range((shape & LOW_16) + 1):
            row = (start >> 32) + up * at
            begins, ends, _ = row_of_ray(rays[ray, BORDER], rays[ray, SLOPE], start, shape, row)
            for column in range(begins, ends + across, across):
                if place_of(flags, column, row) >= end or chance < least:
                    break
                cell = row * width + column
                arrival[cell] = max(arrival[cell], chance)
                if probability[cell] > DUST:
                    chance *= np.float32(1.0) - probability[cell]
            if place_of(flags, ends, row) >= end or chance < least:
                break
