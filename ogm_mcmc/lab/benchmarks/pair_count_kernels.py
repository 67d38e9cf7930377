"""Counts what a sweep looks at: the sampler's own decisions, one counter added."""

import math

import numpy as np
from numba import njit

from ogm_mcmc.sampling.gibbs_kernels import NOTHING, SLACK, next_hit


@njit(cache=True, nogil=True)
def count_looked_at(rng, order, cells, records, index, ceiling, prior):
    """Return (cells, pairs) that drawing every cell of `order` once would look at.

    As `sweep_cells` decides, but each cell given the same present map, which stays as it is: on
    average over a converged chain as many as in a sweep. Pairs that a flip changes come on top.
    """
    bits, pair_bits = records.view(np.float32), index.pairs.view(np.float32)
    looked_cells, looked_pairs = 0, 0
    for cell in order:
        u = rng.random()
        if not u < ceiling[cell]:
            continue
        looked_cells += 1
        enough = (math.log(u / (1.0 - u)) if u > 0.0 else -math.inf) - index.gain[cell] - SLACK
        log_odds = prior
        for i in range(index.cell_start[cell], index.cell_start[cell + 1]):
            looked_pairs += 1
            ray, position = index.pairs[i, 0], index.positions[i]
            if records[ray, 0] > position:
                log_odds += pair_bits[i, 1] - bits[ray, 1]
            elif records[ray, 0] == position:
                behind = next_hit(
                    ray, position, cell, cells, index.ray_start, index.steps, index.across,
                    index.up,
                )  # fmt: skip
                now = index.nothing[ray]
                if behind != NOTHING:
                    now = index.ray_likelihood[index.ray_start[ray] + behind]
                log_odds += pair_bits[i, 1] - now
            if log_odds < enough:
                break
    return looked_cells, looked_pairs
