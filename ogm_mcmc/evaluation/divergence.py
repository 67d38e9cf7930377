"""Kullback-Leibler divergence between two maps ([gibbs] section IV-A), and their entropy.

Design note: probabilities of exactly 0 and 1
---------------------------------------------
0 log 0 is 0. A benchmark p that gives weight to a state which the estimate q rules out (q = 0 or
q = 1) is infinitely far from it, and so is a sum with one such cell. Live maps saturate: in
float32 every log-odds beyond 17 is a probability of exactly 1. [gibbs] compares with a ground
truth of 0 and 1 and prints finite sums without saying what was done. Here `floor` moves q into
[floor, 1 - floor], never p, and `clipped` says in how many cells it did; with the default floor
of 0 nothing is moved and the answer may be inf.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array
from ogm_mcmc.errors import GridError, require

__all__ = [
    'Divergence',
    'divergence',
    'entropy_nats',
    'summed',
    'total_divergence',
    'total_entropy',
]

PART = 1 << 20


class Divergence(NamedTuple):
    """Sum over the cells that count, nats; how many they are; in how many q was moved."""

    nats: float
    cells: int
    clipped: int


def divergence(
    benchmark: AnyArray,
    estimate: AnyArray,
    floor: float = 0.0,
    kind: type[np.floating[Any]] = np.float64,
) -> AnyArray:
    """D_KL(p || q) of every cell, nats, as numbers of a `kind`; nan where either is unknown (nan).

    p log(p / q) + (1 - p) log((1 - p) / (1 - q)), p the benchmark, q the estimate.
    """
    require(0.0 <= floor < 0.5, 'floor', floor, 'expected 0 to below 0.5')
    p, q = (np.asarray(values) for values in (benchmark, estimate))
    if p.shape != q.shape:
        raise GridError(f'benchmark {p.shape} and estimate {q.shape}: expected the same cells')
    nats = np.empty(p.shape, kind)
    flat, p, q = nats.reshape(-1), p.reshape(-1), q.reshape(-1)
    for part in _parts(flat.size):
        flat[part] = _divergence(
            _probabilities(p[part], 'benchmark'), _probabilities(q[part], 'estimate'), floor
        )
    return nats


def _divergence(p: Float64Array, q: Float64Array, floor: float) -> Float64Array:
    q = np.clip(q, floor, 1.0 - floor)
    with np.errstate(divide='ignore', invalid='ignore'):
        occupied = np.where(p == 0.0, 0.0, p * (np.log(p) - np.log(q)))
        free = np.where(p == 1.0, 0.0, (1.0 - p) * (np.log1p(-p) - np.log1p(-q)))
    # Rounding can leave a cell a hair below 0 where p and q are nearly the same.
    nats: Float64Array = np.maximum(occupied + free, 0.0)
    nats[np.isnan(p) | np.isnan(q)] = np.nan
    return nats


def total_divergence(
    benchmark: AnyArray, estimate: AnyArray, mask: BoolArray | None = None, floor: float = 0.0
) -> Divergence:
    """Sum of the divergence over cells known in both maps, of a mask or of all."""
    return summed(divergence(benchmark, estimate, floor), estimate, mask, floor)


def summed(
    nats: AnyArray, estimate: AnyArray, mask: BoolArray | None = None, floor: float = 0.0
) -> Divergence:
    """Return the total of a `divergence` that is there already, from this estimate and floor."""
    counted = ~np.isnan(nats)
    if mask is not None:
        counted &= mask
    q = np.asarray(estimate)[counted]
    clipped = int(((q < np.float64(floor)) | (q > np.float64(1.0 - floor))).sum())
    return Divergence(float(nats[counted].sum(dtype=np.float64)), int(counted.sum()), clipped)


def total_entropy(probability: AnyArray) -> float:
    """Sum of the entropy of all cells, nats."""
    flat = np.asarray(probability).reshape(-1)
    return sum(float(entropy_nats(flat[part]).sum()) for part in _parts(flat.size))


def entropy_nats(probability: AnyArray) -> Float64Array:
    """Entropy of every cell, nats; nan stays nan."""
    given = np.asarray(probability)
    nats = np.empty(given.shape, np.float64)
    flat, given = nats.reshape(-1), given.reshape(-1)
    for part in _parts(flat.size):
        p = _probabilities(given[part], 'probability')
        with np.errstate(divide='ignore', invalid='ignore'):
            occupied = np.where(p == 0.0, 0.0, p * np.log(p))
            free = np.where(p == 1.0, 0.0, (1.0 - p) * np.log1p(-p))
        flat[part] = np.where(np.isnan(p), np.nan, np.abs(occupied + free))
    return nats


def _parts(size: int) -> Iterator[slice]:
    """Yield parts of so many cells that what is computed on the way takes little memory."""
    for start in range(0, size, PART):
        yield slice(start, start + PART)


def _probabilities(values: AnyArray, name: str) -> Float64Array:
    p = np.asarray(values, np.float64)
    if p.size and (np.nanmin(p, initial=0.0) < 0.0 or np.nanmax(p, initial=1.0) > 1.0):
        raise GridError(f'{name}: expected probabilities from 0 to 1')
    return p
