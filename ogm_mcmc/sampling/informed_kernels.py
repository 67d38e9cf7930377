"""Kernels that say how far rays tell anything; what they are for: `ogm_mcmc.sampling.informed`."""

import numpy as np
from numba import njit

from ogm_mcmc.sampling.ray_index_kernels import following_cell

# Cells that are less likely occupied do not stop a ray. Hundreds of them would as independent
# ones; but the reading at its end says of all together that they are free.
DUST = np.float32(0.1)


@njit(cache=True, nogil=True)
def count_telling(ray_start, likelihood, nothing, least, telling):
    """Fill `telling` (N,): how many cells of each ray, from its first on, tell anything.

    The last of them is one whose likelihood differs by more than `least` nats from that of a ray
    on which nothing is occupied.
    """
    for ray in range(telling.size):
        at = ray_start[ray + 1]
        while at > ray_start[ray] and abs(likelihood[at - 1] - nothing[ray]) <= least:
            at -= 1
        telling[ray] = at - ray_start[ray]


@njit(cache=True, nogil=True)
def mark_arrivals(
    telling, probability, least, first_cell, ray_start, steps, across, up, arrival
):  # fmt: skip
    """Raise `arrival` (K,) to the largest chance, over all rays, that one arrives at a cell.

    probability  (K,) float32 that a cell is occupied, taken as independent along a ray above DUST
    A ray is followed while it tells anything and its chance is at least `least`.
    """
    for ray in range(first_cell.size):
        begin, end = ray_start[ray], ray_start[ray] + telling[ray]
        cell = np.int64(first_cell[ray])
        chance = np.float32(1.0)
        for at in range(begin, end):
            arrival[cell] = max(arrival[cell], chance)
            if probability[cell] > DUST:
                chance *= np.float32(1.0) - probability[cell]
            if chance < least:
                break
            cell = following_cell(cell, steps[at], across[ray], up[ray])
