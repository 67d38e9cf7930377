"""Poses as a part of what is estimated."""

from ogm_mcmc.trajectory.factors import Moves, PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints
from ogm_mcmc.trajectory.refinement import (
    TrajectoryConfig,
    TrajectoryProgress,
    TrajectoryRefinement,
)

__all__ = [
    'Moves',
    'PoseFactors',
    'ScanPoints',
    'TrajectoryConfig',
    'TrajectoryProgress',
    'TrajectoryRefinement',
]
