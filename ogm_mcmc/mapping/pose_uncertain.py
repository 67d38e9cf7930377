"""The live map when the pose is not known: evidence averaged over pose samples ([pose] V)."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseSamples
from ogm_mcmc.mapping.map_weights import weighted_by_map
from ogm_mcmc.mapping.pose_samples import pose_samples
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = ['PoseUncertainMapper']


class PoseUncertainMapper(TwoAssumptionMapper):
    """The two-assumption update with E[l(m | z)] over the pose in place of l(m | z).

    l(m | z_1:t) = l(m | z_1:t-1) + sum_j w_j l(m | z_t, x_t^j) - l(m) ([pose] Eq. 3 and 9), once
    per cell and scan. The samples are particles with their weights, or drawn from the Gaussian,
    weighed by the map so far if `map_beams` says so (`map_weights`). A belief of one pose is
    mapped as a known pose.
    """

    samples: PoseSamples | None = None
    """What the last scan was mapped at: poses and the weights they had."""

    _at_the_mean = False

    def __init__(self, config: MapperConfig) -> None:
        super().__init__(config)
        self.reset()

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        samples = pose_samples(placed, self.config.pose_uncertain, self._rng)
        samples = weighted_by_map(samples, placed.scan, self, self.config)
        self.samples = samples
        if samples.weights.size == 1:
            return self.update_at(placed.scan, Pose2D(*samples.poses[0].tolist()))
        return self.update_over(placed.scan, samples)

    def reset(self) -> None:
        """Forget every scan, give the memory back, and start the draws anew."""
        super().reset()
        self.samples = None
        self._rng = np.random.default_rng(self.config.pose_uncertain.seed)
