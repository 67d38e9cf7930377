"""A belief about a pose as weighted samples ([pose] section V-A)."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.geometry import PoseBelief, PoseSamples

__all__ = ['belief_samples']


def belief_samples(belief: PoseBelief, n_samples: int, rng: np.random.Generator) -> PoseSamples:
    """Particles as they are, else draws from the covariance, else the mean as the only sample.

    Any covariance will do, singular ones included: draws are made along its eigenvectors, and
    eigenvalues that rounding put below 0 count as 0.
    """
    if belief.particles is not None:
        return belief.particles
    mean = np.array([[belief.mean.x_m, belief.mean.y_m, belief.mean.yaw_rad]])
    if belief.covariance is None or not belief.covariance.any():
        return PoseSamples(mean, np.ones(1))
    values, vectors = np.linalg.eigh(0.5 * (belief.covariance + belief.covariance.T))
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = rng.standard_normal((n_samples, 3)) @ spread.T
    return PoseSamples(mean + draws, np.full(n_samples, 1.0 / n_samples))
