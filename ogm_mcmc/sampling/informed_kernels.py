"""Kernels that say how far rays tell anything; what they are for: `ogm_mcmc.sampling.informed`."""

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import SHIFT
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
    UPWARDS,
    first_place,
    place_of,
)

# Cells that are less likely occupied do not stop a ray. Hundreds of them would as independent
# ones; but the reading at its end says of all together that they are free.
DUST = np.float32(0.1)


@njit(cache=True, nogil=True)
def mark_arrivals(telling, probability, least, rays, width, arrival):
    """Raise `arrival` (K,) to the largest chance, over all rays, that one arrives at a cell.

    probability  (K,) float32 that a cell is occupied, taken as independent along a ray above DUST
    A ray is followed while it tells anything and its chance is at least `least`, row by row as
    `row_of_ray` has them (a look at each cell's place took 1.7 times as long).
    """
    for ray in range(rays.shape[0]):
        start, shape = rays[ray, START], rays[ray, SHAPE]
        flags, rows = shape >> 48, shape & LOW_16
        across = 1 if flags & RIGHTWARDS else -1
        up = 1 if flags & UPWARDS else -1
        begins_left = 1 if flags & BEGINS_LEFT else 0
        ends_left = 1 if flags & ENDS_LEFT else 0
        behind, slope = rays[ray, BORDER], rays[ray, SLOPE]
        begins, row = start & LOW_32, start >> 32
        last = begins + across * ((shape >> 16) & LOW_16)
        end = first_place(start, shape) + telling[ray]
        chance = np.float32(1.0)
        for at in range(rows + 1):
            ends = last if at == rows else (behind - ends_left) >> SHIFT
            left = np.int64(end - place_of(flags, begins, row))
            cell = row * width + begins
            for _ in range(min((ends - begins) * across + 1, left)):
                arrival[cell] = max(arrival[cell], chance)
                if probability[cell] > DUST:
                    chance *= np.float32(1.0) - probability[cell]
                    if chance < least:
                        break
                cell += across
            if left <= 0 or chance < least:
                break
            row += up
            begins = (behind - begins_left) >> SHIFT
            behind += slope
