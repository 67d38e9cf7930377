"""Closed form for cells in one line, all seen from the same end."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import require

__all__ = ['line_posterior']


def line_posterior(log_likelihood: Float64Array, prior: float) -> Float64Array:
    """Posterior probability (F,) of every cell of a line, each occupied with `prior` before.

    log_likelihood  (N, F + 1) nats: log p(z_n | first occupied cell), the last column for none.
    All readings depend on the map by its first occupied cell f alone, so
      p(f | z) = prior (1 - prior)^f prod p(z_n | f),  p(none | z) = (1 - prior)^F prod p(z_n | none)
    up to one factor, and a cell is occupied if it is the first, or with `prior` if it is behind it.
    """  # noqa: E501
    require(0.0 < prior < 1.0, 'prior', prior, 'must be in (0, 1)')
    n_cells = log_likelihood.shape[1] - 1
    log_weight = log_likelihood.sum(axis=0) + np.arange(n_cells + 1) * np.log1p(-prior)
    log_weight[:-1] += np.log(prior)
    weight = np.exp(log_weight - log_weight.max())
    first = weight / weight.sum()
    behind = np.concatenate(([0.0], np.cumsum(first[:-2])))
    posterior: Float64Array = first[:-1] + prior * behind
    return posterior
