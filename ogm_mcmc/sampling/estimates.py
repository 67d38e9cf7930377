"""What samples of maps tell beyond their mean."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import require

__all__ = ['mutual_information_bits']


def mutual_information_bits(samples: AnyArray) -> Float64Array:
    """Mutual information (c, c) between chosen cells, bits ([patch] Fig. 2).

    samples  (S, c) of 0 and 1: one row a map. I(a; b) = sum p(a, b) log2 p(a, b) / (p(a) p(b));
    on the diagonal it is the entropy of the cell. Raises ConfigError without a sample.
    """
    require(samples.shape[0] > 0, 'samples', samples.shape[0], 'expected at least one')
    # Counts are whole numbers, so what never happened is exactly 0.
    ones = samples.astype(np.float64)
    n, one = ones.shape[0], ones.sum(axis=0)
    zero = n - one
    both = ones.T @ ones
    a, b = one[:, None], one[None, :]
    joint = np.stack((both, a - both, b - both, n - a - b + both))
    product = np.stack(
        (np.outer(one, one), np.outer(one, zero), np.outer(zero, one), np.outer(zero, zero))
    )
    with np.errstate(divide='ignore', invalid='ignore'):
        terms = joint / n * np.log2(joint * n / product)
    terms[joint == 0.0] = 0.0
    information: Float64Array = terms.sum(axis=0)
    return np.maximum(information, 0.0)
