"""Maps of a simulated data set: the traditional one, and the mean of samples from a chain.

The forward model is the one the data sets are made with: N(f, sigma^2), a beam reflected half
way through the first occupied cell, nothing at the end of the reach. Rays are followed to some
sigma behind their reading; behind that a Gaussian is taken as level.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig, WindowConfig
from ogm_mcmc.evaluation import aligned
from ogm_mcmc.experiments.hundred_sets import SimulatedSet
from ogm_mcmc.geometry import GridMap, GridSpec, PoseBelief
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.sampling import CellModel, PosteriorModel, PosteriorSampler, RayWindow
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_prior import PatchTable

__all__ = [
    'CUT_SIGMA',
    'DEPTH',
    'ChainPlan',
    'on_window',
    'posterior_map',
    'rays_of',
    'sampled_map',
    'traditional_map',
]

CUT_SIGMA, DEPTH = 6.0, 0.5


class ChainPlan(NamedTuple):
    """How many maps one chain draws, and how many sweeps go before them."""

    samples: int
    burn_in: int


def traditional_map(data: SimulatedSet, prior: float) -> GridMap:
    """Return the two-assumption map, every beam on its own ([gibbs] section II)."""
    pipeline = MappingPipeline(
        MapperConfig(fusion='per_beam', resolution=data.world.spec.resolution_m, prior=prior)
    )
    for scan, pose in data.scans:
        pipeline.update(scan, PoseBelief(pose))
    return GridMap(data.world.spec, aligned(pipeline.map(), data.world.truth()))


def rays_of(data: SimulatedSet, noise_cells: float, *, margin: int = 0) -> RayWindow:
    """Return the rays of all scans on the lattice of the world."""
    cell_m = data.world.spec.resolution_m
    window = RayWindow(
        WindowConfig(resolution=cell_m, cut_sigma=CUT_SIGMA),
        ForwardModelConfig(kind='gaussian', sigma=noise_cells * cell_m, depth=DEPTH),
        margin=margin,
    )
    window.add(data.scans)
    return window


def on_window(spec: GridSpec, cells: UInt8Array, world: GridSpec, elsewhere: int) -> UInt8Array:
    """Return cells (height, width) of a world as a map (K,) of a window."""
    whole = np.full((spec.height, spec.width), elsewhere, np.uint8)
    common = spec.box.intersection(world.box)
    whole[spec.slices(common)] = cells[world.slices(common)]
    return whole.reshape(-1)


def posterior_map(sampler: PosteriorSampler, spec: GridSpec, world: GridSpec) -> GridMap:
    """Return the mean of the samples on the cells of a world, nan where nothing is sampled."""
    whole = np.full(spec.height * spec.width, np.nan, np.float32)
    whole[sampler.model.touched] = sampler.estimate().mean
    nothing = np.zeros((world.height, world.width), np.float32)
    found = GridMap(spec, whole.reshape(spec.height, spec.width))
    return GridMap(world, aligned(found, GridMap(world, nothing)))


def sampled_map(
    data: SimulatedSet,
    window: RayWindow,
    plan: ChainPlan,
    start: UInt8Array,
    *,
    table: PatchTable | None,
    prior: float,
    seed: int,
) -> GridMap:
    """Return the mean of a chain that starts at `start` (height, width), occupied around it.

    Single cells with `prior` if there is no `table`.
    """
    spec, world = window.spec, data.world.spec
    model: PosteriorModel
    if table is None:
        model = CellModel(window.index, math.log(prior / (1.0 - prior)), spec.width)
    else:
        model = PatchModel(window.index, spec.width, table)
    begin = on_window(spec, start, world, 1)
    sampler = PosteriorSampler(model, [begin], seed=seed, burn_in=plan.burn_in)
    sampler.advance(plan.burn_in + plan.samples)
    return posterior_map(sampler, spec, world)
