"""The live map when the pose is not known: evidence averaged over pose samples ([pose] V)."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, Pose2D, PoseBelief, PoseSamples, Scan
from ogm_mcmc.geometry.pose_sampling import samples_of
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = ['PoseUncertainMapper']


class PoseUncertainMapper(TwoAssumptionMapper):
    """The two-assumption update with E[l(m | z)] over the pose in place of l(m | z).

    l(m | z_1:t) = l(m | z_1:t-1) + sum_j w_j l(m | z_t, x_t^j) - l(m) ([pose] Eq. 3 and 9), once
    per cell and scan. The samples are particles with their weights, or drawn from the Gaussian. A
    belief of one pose is mapped as a known pose.
    """

    def __init__(self, config: MapperConfig) -> None:
        super().__init__(config)
        self.reset()

    def update(self, scan: Scan, belief: PoseBelief) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        samples = self.samples_of(scan, belief)
        if samples.weights.size == 1:
            return self.update_at(scan, Pose2D(*samples.poses[0].tolist()))
        return self.update_over(scan, samples)

    def samples_of(self, scan: Scan, belief: PoseBelief) -> PoseSamples:
        """Return the samples a belief stands for; draws go on where the last ones ended."""
        chosen = self.config.pose_uncertain
        lever_m = 0.0
        if chosen.accuracy > 0.0:
            finite = scan.ranges_m[np.isfinite(scan.ranges_m)]
            lever_m = float(finite.max(initial=0.0))
        return samples_of(
            belief,
            self._rng,
            count=chosen.samples,
            quasi=chosen.draw == 'quasi',
            accuracy_m=chosen.accuracy,
            lever_m=lever_m,
            negligible=chosen.negligible,
        )

    def reset(self) -> None:
        """Forget every scan, give the memory back, and start the draws anew."""
        super().reset()
        self._rng = np.random.default_rng(self.config.pose_uncertain.seed)
