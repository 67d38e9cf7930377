"""The poses that a placed scan is mapped from: one place for every method that averages."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.config import PoseUncertainConfig
from ogm_mcmc.geometry import PlacedScan, PoseSamples
from ogm_mcmc.geometry.pose_sampling import samples_of

__all__ = ['pose_samples']


def pose_samples(
    placed: PlacedScan, chosen: PoseUncertainConfig, rng: np.random.Generator
) -> PoseSamples:
    """Return the samples that the belief of a scan stands for; draws advance `rng`.

    `chosen` says how many, how they are drawn and which weights are too small to matter.
    """
    lever_m = 0.0
    if chosen.accuracy > 0.0:
        ranges = placed.scan.ranges_m
        lever_m = float(ranges[np.isfinite(ranges)].max(initial=0.0))
    return samples_of(
        placed.belief,
        rng,
        count=chosen.samples,
        quasi=chosen.draw == 'quasi',
        accuracy_m=chosen.accuracy,
        lever_m=lever_m,
        negligible=chosen.negligible,
        max_particles=chosen.max_particles,
    )
