"""What cutting a ray behind its reading changes at most."""

from __future__ import annotations

import math

from ogm_mcmc.sensors.forward_model import ForwardModel
from ogm_mcmc.sensors.forward_model_kernels import unseen_log_likelihood

__all__ = ['cut_error']


def cut_error(model: ForwardModel, cut_sigma: float, reading_m: float, reach_m: float) -> float:
    """Bound, in nats, on what cutting a ray `cut_sigma` behind its reading changes.

    The largest difference between the likelihood given to "nothing up to the cut" and that of any
    first hit behind it. For `gaussian` that grows with the square of the distance: there a cut is
    another model, one whose likelihood stays level behind the cut.
    """
    cut_m = reading_m + cut_sigma * model.sigma_m
    if not cut_m < reach_m:
        return 0.0
    given = float(unseen_log_likelihood(model, reading_m, reach_m, cut_m))
    # The likelihood falls monotonically behind the reading, so the ends are extreme.
    outcomes = (cut_m, reach_m, math.inf)
    return max(
        abs(model.log_likelihood(reading_m, reach_m, distance) - given) for distance in outcomes
    )
