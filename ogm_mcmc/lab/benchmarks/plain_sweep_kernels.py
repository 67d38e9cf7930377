"""The slow twin of a sweep: it sums up all pairs of every cell, from one flat list of them.

begin   (C + 1,) int64: where the pairs of each sampled cell begin; of pairs (P,): `ray` int32,
        `place` int32, how many cells of the ray lie in front, `value` float32, log p(z | it ends)
starts  (N + 1,) int64: where each ray begins in `crossed` (P,) int32, its cells in order, and
        `said` (P,) float32, the same likelihoods; `unseen` (N,) float32: nothing is hit
hits    (N, 2) int32: place of the first hit, NOTHING for none, and the bits of its log-likelihood;
        `hit_bits`: the same memory as float32
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.sampling.ray_index_kernels import NOTHING


@njit(cache=True, nogil=True)
def next_hit(cells, ray, after, starts, crossed, said, unseen):
    """Return (place, log-likelihood) of the first occupied cell of a ray behind a place."""
    for k in range(starts[ray] + after + 1, starts[ray + 1]):
        if cells[crossed[k]]:
            return np.int32(k - starts[ray]), said[k]
    return np.int32(NOTHING), unseen[ray]


@njit(cache=True, nogil=True)
def find_hits(cells, starts, crossed, said, unseen, hits, hit_bits):
    """Fill `hits` from a map (K,)."""
    for ray in range(unseen.size):
        hits[ray, 0], hit_bits[ray, 1] = next_hit(cells, ray, -1, starts, crossed, said, unseen)


@njit(cache=True, nogil=True)
def sweep_plainly(
    numbers, order, cells, prior, begin, ray, place, value, starts, crossed, said, unseen, hits,
    hit_bits,
):  # fmt: skip
    """Draw the cells of `order` (C,) once with u of `numbers` (C,); return the number of flips."""
    flips = 0
    for j in range(order.size):
        log_odds = prior
        for i in range(begin[j], begin[j + 1]):
            r, p = ray[i], place[i]
            if hits[r, 0] < p:
                continue
            now = hit_bits[r, 1]
            if hits[r, 0] == p:
                _, now = next_hit(cells, r, p, starts, crossed, said, unseen)
            log_odds += np.float64(value[i]) - np.float64(now)
        u = numbers[j]
        occupied = log_odds > (math.log(u / (1.0 - u)) if u > 0.0 else -math.inf)
        if occupied == (cells[order[j]] != 0):
            continue
        cells[order[j]] = occupied
        flips += 1
        for i in range(begin[j], begin[j + 1]):
            r, p = ray[i], place[i]
            if occupied and hits[r, 0] > p:
                hits[r, 0], hit_bits[r, 1] = p, value[i]
            elif not occupied and hits[r, 0] == p:
                hits[r, 0], hit_bits[r, 1] = next_hit(cells, r, p, starts, crossed, said, unseen)
    return flips
