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
        'l in the covariance exp(-d^2 / (2 l)) of two cells d cells apart, square cells',
        low=0.05,
        high=20.0,
    )
    variance: float = setting(
        0.1,
        "of each cell's own log-odds as an observation, where the field's is 1",
        low=1e-4,
        high=100.0,
    )
    mean: float = setting(
        0.0, 'log-odds of the field before any observation', low=-20.0, high=20.0
    )
    drop: float = setting(
        1e-4,
        'covariances that start below this are dropped; smaller is truer, slower and larger',
        low=1e-12,
        high=0.5,
    )
    max_variance: float = setting(
        0.9,
        'unmeasured cells are predicted up to this variance, and stay unknown above it; the '
        "field's own is 1",
        low=0.0,
        high=1.0,
    )
