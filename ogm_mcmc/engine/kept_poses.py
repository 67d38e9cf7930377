"""What poses hold for which scans, until they are forgotten."""

from __future__ import annotations

import operator
from collections.abc import Sequence

from ogm_mcmc.config import PosesConfig
from ogm_mcmc.engine.beam_times import BentScans
from ogm_mcmc.engine.joint_poses import (
    PoseRefinement,
    PosesChoice,
    RefinedTrajectory,
    choose_joint,
)
from ogm_mcmc.engine.odometry import OdometryAt
from ogm_mcmc.geometry import PlacedScan

__all__ = ['KeptPoses']


class KeptPoses:
    """Poses of the scans asked for: refined once for the same scans, gone on with if need be."""

    def __init__(self, config: PosesConfig, odometry: OdometryAt | None) -> None:
        self.config, self.odometry = config, odometry
        self._bent = BentScans()
        self.scans: Sequence[PlacedScan] = ()
        self.refinement: PoseRefinement | None = None
        self.placed: list[PlacedScan] = []
        self.trajectory: RefinedTrajectory | None = None
        self.joint: bool | None = None  # as chosen last

    def choose(self, scans: Sequence[PlacedScan], resolution_m: float) -> PosesChoice:
        """Decide whether poses of scans are estimated: as before, unless that is clearly wrong.

        Where they are not, no trajectory of before is left.
        """
        choice = choose_joint(scans, self.config, resolution_m, self.joint)
        self.joint = choice.joint
        if not choice.joint:
            self.trajectory = None
        return choice

    def take(self, scans: Sequence[PlacedScan]) -> PoseRefinement:
        """Return what refines the poses of these scans; that of before where they are the same."""
        same = len(scans) == len(self.scans) and all(map(operator.is_, scans, self.scans))
        if self.refinement is None or not same:
            settings = self.config.trajectory
            self.refinement = PoseRefinement(scans, settings, self.odometry, self._bent)
            self.scans = scans
        return self.refinement

    def keep(self) -> None:
        """Take over the poses as they are now."""
        assert self.refinement is not None
        self.placed, self.trajectory = self.refinement.placed(), self.refinement.trajectory()

    def forget(self) -> None:
        """Leave no poses of before, and no choice."""
        self.scans, self.refinement, self.placed, self.trajectory = (), None, [], None
        self.joint, self._bent = None, BentScans()
