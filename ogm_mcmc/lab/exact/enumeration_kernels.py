"""Kernel that goes through all maps of a window, one flipped cell at a time."""

import numpy as np
from numba import njit

from ogm_mcmc.sampling.gibbs_kernels import find_first_hits, redirect_rays
from ogm_mcmc.sampling.ray_index_kernels import CELLS


@njit(cache=True, nogil=True)
def fill_log_joint(touched, index, prior, log_joint):
    """Write log p(z | m) + prior * (occupied cells of m) for every map of the touched cells.

    log_joint  (2**C,) float64, output; bit b of its index is cell touched[b]
    Maps come in the order of the Gray code, so each differs from the last in one cell.
    """
    cells = np.zeros(index.grid[CELLS], np.uint8)
    records = np.empty((index.rays.shape[0], 2), np.int32)
    find_first_hits(cells, index, records)
    bits, near_bits = records.view(np.float32), index.near.view(np.float32)
    ray_bits = index.rays.view(np.float32)
    value = 0.0
    for n in range(records.shape[0]):
        value += np.float64(bits[n, 1])
    log_joint[0] = value
    code, occupied = 0, 0
    for step in range(1, log_joint.size):
        bit = 0
        while not (step >> bit) & 1:
            bit += 1
        cell = np.int64(touched[bit])
        cells[cell] = 1 - cells[cell]
        occupied += 1 if cells[cell] else -1
        redirect_rays(
            cell, cells, records, bits, index.marks, index.lists, index.full, index.near,
            near_bits, index.front, index.tiles, index.runs, index.run_lengths, index.rays,
            ray_bits, index.grid,
        )  # fmt: skip
        value = 0.0
        for n in range(records.shape[0]):
            value += np.float64(bits[n, 1])
        code ^= 1 << bit
        log_joint[code] = value + prior * occupied
