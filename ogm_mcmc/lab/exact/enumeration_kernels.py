"""Kernel that goes through all maps of a window, one flipped cell at a time."""

import numpy as np
from numba import njit

from ogm_mcmc.sampling.gibbs_kernels import redirect_rays


@njit(cache=True, nogil=True)
def fill_log_joint(
    touched, prior, log_joint, cells, records, bits, marks, lists, full, gain, near, near_bits,
    front, tiles, runs, run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Write log p(z | m) + prior * (occupied cells of m) for every map of the touched cells.

    log_joint  (2**C,) float64, output; bit b of its index is cell touched[b]
    cells, records, bits  those of the empty map; changed
    Maps come in the order of the Gray code, so each differs from the last in one cell.
    """
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
            cell, cells, records, bits, marks, lists, full, near, near_bits, front, tiles, runs,
            run_lengths, rays, ray_bits, grid,
        )  # fmt: skip
        value = 0.0
        for n in range(records.shape[0]):
            value += np.float64(bits[n, 1])
        code ^= 1 << bit
        log_joint[code] = value + prior * occupied
