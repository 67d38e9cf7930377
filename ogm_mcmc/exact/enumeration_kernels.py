"""Kernel that goes through all maps of a window, one flipped cell at a time."""

import numpy as np
from numba import njit

from ogm_mcmc.sampling.gibbs_kernels import (
    find_first_hits,
    lengthen_rays,
    shorten_rays,
)


@njit(cache=True, nogil=True)
def fill_log_joint(touched, index, prior, log_joint):
    """Write log p(z | m) + prior * (occupied cells of m) for every map of the touched cells.

    log_joint  (2**C,) float64, output; bit b of its index is cell touched[b]
    Maps come in the order of the Gray code, so each differs from the last in one cell, and only
    the rays through that cell are looked at.
    """
    cells = np.zeros(index.gain.size, np.uint8)
    records = np.empty((index.first_cell.size, 2), np.int32)
    find_first_hits(cells, index, records)
    bits, pair_bits = records.view(np.float32), index.pairs.view(np.float32)
    value = 0.0
    for n in range(records.shape[0]):
        value += np.float64(bits[n, 1])
    code = 0
    log_joint[0] = value
    for step in range(1, log_joint.size):
        bit = 0
        while not (step >> bit) & 1:
            bit += 1
        cell = touched[bit]
        begin, end = index.cell_start[cell], index.cell_start[cell + 1]
        for i in range(begin, end):
            value -= np.float64(bits[index.pairs[i, 0], 1])
        if cells[cell]:
            cells[cell] = 0
            value -= prior
            lengthen_rays(
                begin, end, cell, cells, records, bits, index.pairs, index.positions,
                index.ray_start, index.steps, index.across, index.up, index.ray_likelihood,
                index.nothing,
            )  # fmt: skip
        else:
            cells[cell] = 1
            value += prior
            shorten_rays(begin, end, records, bits, index.pairs, pair_bits, index.positions)
        for i in range(begin, end):
            value += np.float64(bits[index.pairs[i, 0], 1])
        code ^= 1 << bit
        log_joint[code] = value
