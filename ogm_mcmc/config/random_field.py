"""Settings of the Gaussian random field ([field])."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import setting

__all__ = ['RandomFieldConfig']


@dataclass(frozen=True)
class RandomFieldConfig:
    """How log-odds of neighbouring cells belong together, and which cells are shown."""

    length_scale: float = setting(
        1.0,
        'l of the covariance exp(-d^2 / (2 l)) of two cells at a distance of d cells, in cells '
        'squared',
        low=0.05,
        high=20.0,
    )
    variance: float = setting(
        0.1,
        'variance of the noise of an observed log-odds; the variance of the field is 1',
        low=1e-4,
        high=100.0,
    )
    mean: float = setting(
        0.0, 'log-odds of the field before any observation', low=-20.0, high=20.0
    )
    drop: float = setting(
        1e-4,
        'prior covariances below this are set to 0; smaller values are more exact, slower and '
        'need more memory',
        low=1e-12,
        high=0.5,
    )
    max_variance: float = setting(
        0.9,
        'unmeasured cells with a larger variance stay unknown; the variance of the field is 1',
        low=0.0,
        high=1.0,
    )
