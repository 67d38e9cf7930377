"""What samples of maps tell beyond their mean."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array

__all__ = ['mutual_information_bits', 'pair_information_bits']


def mutual_information_bits(samples: AnyArray) -> Float64Array:
    """Mutual information (c, c) between chosen cells, bits ([patch] Fig. 2).

    samples  (S, c) of 0 and 1: one row a map. I(a; b) = sum p(a, b) log2 p(a, b) / (p(a) p(b));
    on the diagonal it is the entropy of the cell.
    """
    ones = samples.astype(np.float64)
    n = ones.shape[0]
    return pair_information_bits(ones.mean(axis=0), ones.T @ ones / n)


def pair_information_bits(p: Float64Array, both: Float64Array) -> Float64Array:
    """Mutual information (c, c), bits, of cells that are occupied with `p` (c,), two with `both`.

    both  (c, c): p(a = 1, b = 1), on the diagonal p(a = 1)
    """
    joint = np.stack(
        (both, p[:, None] - both, p[None, :] - both, 1.0 - p[:, None] - p[None, :] + both)
    )
    q = 1.0 - p
    product = np.stack((np.outer(p, p), np.outer(p, q), np.outer(q, p), np.outer(q, q)))
    joint = np.maximum(joint, 0.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        terms = joint * np.log2(joint / product)
    terms[joint == 0.0] = 0.0
    information: Float64Array = terms.sum(axis=0)
    return np.maximum(information, 0.0)
