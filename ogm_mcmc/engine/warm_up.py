"""Compiles, or loads from the cache, what `~/refine` and its users would wait for otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ogm_mcmc.config import SamplerConfig, StopConfig, TrajectoryConfig
from ogm_mcmc.engine.collision import collision_risk
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D, SampleBits, Scan

__all__ = ['warm_up_collisions', 'warm_up_poses', 'warm_up_sampling']


def warm_up_sampling(config: SamplerConfig) -> int:
    """Compile, or load from the cache, every kernel the configuration needs.

    Returns the sweeps done on a window of one scan.
    """
    reach = 4.0 * config.window.resolution
    scan = Scan.checked(
        np.array([0.5, np.inf], np.float32) * np.float32(reach),
        angle_min_rad=0.1,
        angle_increment_rad=1.0,
        range_min_m=0.0,
        range_max_m=reach,
    )
    first, second = (PlacedScan.at(scan, Pose2D(x, 0.0)) for x in (0.0, reach))
    refinement = Refinement(replace(config, window=replace(config.window, beam_stride=1)))
    # The second time extends the index, the third merges beams that are equal: each takes kernels
    # of its own.
    for scans in ([first], [first, second], [first, second, first]):
        refinement.take(scans)
        done = list(refinement.run(StopConfig(max_sweeps=config.chain.burn_in + 1)))
    return done[-1].sweeps


def warm_up_poses() -> int:
    """Compile, or load from the cache, what refining poses needs; return the steps done."""
    scan = Scan.checked(
        np.linspace(1.0, 1.5, 16), angle_min_rad=0.0, angle_increment_rad=0.1,
        range_min_m=0.0, range_max_m=5.0,
    )  # fmt: skip
    scans = [PlacedScan.at(scan, Pose2D(x)) for x in (0.0, 0.1)]
    return len(list(PoseRefinement(scans, TrajectoryConfig(search=True, draws=2)).run()))


def warm_up_collisions() -> None:
    """Compile, or load from the cache, what the first answer would wait for."""
    blank = np.zeros((1, 1, 1), np.uint8)
    samples = SampleBits.of_maps(GridSpec(1.0, 1, 1), blank, blank[0] == 0)
    collision_risk(samples, [(0.5, 0.5)], 0.1, 0.5)
