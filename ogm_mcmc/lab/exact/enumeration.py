"""All 2^K maps of a small window."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import WindowError
from ogm_mcmc.lab.exact.enumeration_kernels import fill_log_joint
from ogm_mcmc.sampling.first_hits import first_hits
from ogm_mcmc.sampling.ray_index import RayIndex

__all__ = ['MAX_CELLS', 'Enumeration', 'enumerate_maps']

MAX_CELLS = 24


class Enumeration(NamedTuple):
    """The whole posterior of a window of C touched cells.

    `touched` (C,): the cells; `log_joint` (2^C,): log p(z | m) + log p(m), nats, bit b of the
    index being cell touched[b]; `log_evidence`: log p(z); `marginals` (C,): p(m_k = 1 | z).
    """

    touched: AnyArray
    log_joint: Float64Array
    log_evidence: float
    marginals: Float64Array

    def probabilities(self) -> Float64Array:
        """Posterior probability (2^C,) of every map."""
        probabilities: Float64Array = np.exp(self.log_joint - self.log_evidence)
        return probabilities


def enumerate_maps(index: RayIndex, prior_log_odds: float) -> Enumeration:
    """Return the full Bayesian solution ([gibbs] section II) for independent cells of one prior.

    Raises WindowError for more than 24 touched cells.
    """
    touched = index.touched()
    if touched.size > MAX_CELLS:
        raise WindowError(
            f'{touched.size} cells to enumerate: expected at most {MAX_CELLS} (2^24 maps)'
        )
    log_joint = np.empty(2**touched.size)
    cells = np.zeros(index.n_cells, np.uint8)
    records = first_hits(cells, index)
    bits = records.view(np.float32)
    fill_log_joint(touched, prior_log_odds, log_joint, cells, records, bits, *index.arrays())
    log_joint -= touched.size * np.logaddexp(0.0, prior_log_odds)  # log of (1 - prior) per cell
    highest = log_joint.max()
    weight = np.exp(log_joint - highest)
    total = weight.sum()
    marginals = np.empty(touched.size)
    for b in range(touched.size):
        marginals[b] = weight.reshape(-1, 2, 2**b)[:, 1].sum() / total
    return Enumeration(touched, log_joint, float(highest + np.log(total)), marginals)
