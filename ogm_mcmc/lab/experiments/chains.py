"""Maps of a simulated data set: the traditional one, and the mean of samples from a chain.

The forward model is the one the data sets are made with: N(f, sigma^2), a beam reflected half
way through the first occupied cell, nothing at the end of the reach. Rays are followed to some
sigma behind their reading; behind that a Gaussian is taken as level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    MapperConfig,
    SamplerConfig,
    WindowConfig,
)
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.engine.posterior import posterior_model
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.lab.experiments.hundred_sets import SimulatedSet
from ogm_mcmc.sampling import PosteriorSampler, RayWindow
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
    spec = data.world.spec
    config = MapperConfig(fusion='per_beam', resolution=spec.resolution_m, prior=prior)
    return map_of(data.scans, config, spec.box)


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
    found = GridMap.of_cells(spec, sampler.model.touched, sampler.estimate().mean)
    return found.windowed(world.box)


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
    config = SamplerConfig(chain=ChainConfig(prior=prior))
    model = posterior_model(config, window, table, everywhere=True)
    begin = on_window(spec, start, world, 1)
    sampler = PosteriorSampler(model, [begin], seed=seed, burn_in=plan.burn_in)
    sampler.advance(plan.burn_in + plan.samples)
    return posterior_map(sampler, spec, world)
