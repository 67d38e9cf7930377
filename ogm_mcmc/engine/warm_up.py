"""Compiles, or loads from the cache, what `~/refine` and its users would wait for otherwise.

The compiler takes one core. Two processes share the work (`cli.warm_up`), one does
`warm_up_chains` (31 s of processor time, cold, on a busy machine), the other all else and
`warm_up_changes` (24 s), in the order in which neither compiles what the other has not finished.
Numba's cache does not stand two that compile a kernel for different types at once; the same types
cost time only.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ogm_mcmc.config import SamplerConfig, StopConfig, TrajectoryConfig
from ogm_mcmc.engine.collision import chance_of_unknown, collision_risk
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.live_map import live_map, reflection_map
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.sensor_fit import fit_sensor
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, SampleBits, Scan
from ogm_mcmc.geometry.slants import slants_of
from ogm_mcmc.sampling.chain_starts import forgotten

__all__ = [
    'warm_up_chains',
    'warm_up_changes',
    'warm_up_collisions',
    'warm_up_maps',
    'warm_up_poses',
    'warm_up_sampling',
]

# Of the first of two beams.
FIRST_RAD = 0.1


def warm_up_sampling(config: SamplerConfig) -> int:
    """Compile, or load from the cache, every kernel the configuration needs.

    Returns the sweeps done on a window of one scan.
    """
    refinement = Refinement(replace(config, window=replace(config.window, beam_stride=1)))
    for scans in _changing_windows(config.window.resolution):
        refinement.take(scans)
        done = list(refinement.run(StopConfig(max_sweeps=config.chain.burn_in + 1)))
    refinement.known_map()
    slants_of(_two_scans(config.window.resolution)[0].scan, config.window.resolution)
    return done[-1].sweeps


def warm_up_chains(config: SamplerConfig) -> int:
    """Compile the part of `warm_up_sampling` that takes longest: the index, then the sweeps.

    No map is made for them, but at the very end. Returns the sweeps done.
    """
    refinement, start = _of_given_sensor(config)
    for scans in _changing_windows(config.window.resolution):
        refinement.take(scans, start if refinement.sampler is None else None)
        done = list(refinement.run(StopConfig(max_sweeps=config.chain.burn_in + 1)))
        if refinement.sampler is not None:
            cells = [state.cells for state in refinement.sampler.states]
            forgotten(refinement.sampler.model, cells, config.chain.seed)
    return done[-1].sweeps


def warm_up_changes(config: SamplerConfig) -> int:
    """Compile the part of `warm_up_chains` that extends, merges and drops rays, but for sweeps.

    The index itself comes first there: who comes later finds it compiled. Returns the rays left.
    """
    refinement, start = _of_given_sensor(config)
    windows = _changing_windows(config.window.resolution)
    return [refinement.take(scans, start) for scans in windows][-1]


def _of_given_sensor(config: SamplerConfig) -> tuple[Refinement, GridMap]:
    """Return what takes scans of which nothing is to be found, and a map to begin at."""
    window = replace(config.window, beam_stride=1, no_return='clear')
    # Of a spread that is given nothing is looked for in maps of the scans.
    model = replace(config.model, sigma=config.model.sigma_m, grazing=0.0)
    chain = replace(config.chain, sensor='given')
    refinement = Refinement(replace(config, window=window, model=model, chain=chain))
    return refinement, GridMap(refinement.window.spec, np.zeros((1, 1), np.float32))


def warm_up_maps(config: SamplerConfig) -> None:
    """Compile what `warm_up_sampling` needs beside `warm_up_chains`: maps of scans."""
    scans = _two_scans(config.window.resolution)
    window = replace(config.window, no_return='clear')
    live_map(scans, window)
    reflection_map(scans, window)
    fit_sensor(scans, replace(config, window=window))
    slants_of(scans[0].scan, window.resolution)


def _changing_windows(resolution_m: float) -> list[list[PlacedScan]]:
    """Return the scans of windows, each of which takes kernels of its own after the last one.

    The second extends the index, the third merges beams that are equal, the last drops some.
    """
    first, second = _two_scans(resolution_m)
    again = first._replace()
    return [[first], [first, second], [first, second, again], [second, again]]


def _two_scans(resolution_m: float) -> list[PlacedScan]:
    """Return scans of two beams, one of which hits, at two places.

    It hits the middle of a cell: half way between two of them it may tell nothing of either.
    """
    reach = 4.0 * resolution_m
    scan = Scan.checked(
        np.array([0.625 / math.cos(FIRST_RAD), np.inf], np.float32) * np.float32(reach),
        angle_min_rad=FIRST_RAD,
        angle_increment_rad=1.0,
        range_min_m=0.0,
        range_max_m=reach,
    )
    return [PlacedScan.at(scan, Pose2D(x, 0.0)) for x in (0.0, reach)]


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
    collision_risk(samples, [(0.5, 0.5)], 0.1, chance_of_unknown(samples, 0.5))
