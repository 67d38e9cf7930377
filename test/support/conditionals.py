"""What the sampler's kernels say of one cell, called by themselves."""

import math

import numpy as np

from ogm_mcmc.sampling.gibbs_kernels import log_odds_unless_below


def conditional_log_odds(cell, state, index, prior_log_odds):
    """Log-odds of a cell given all others, to the last ray."""
    cells, records = state[:2]
    bits = records.view(np.float32)
    arrays = index.arrays()
    return log_odds_unless_below(
        -math.inf, prior_log_odds, int(cell), cells, records, bits, *arrays
    )
