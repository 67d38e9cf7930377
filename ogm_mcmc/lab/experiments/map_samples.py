"""One map from the full posterior, as the experiments of [patch] sample it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    SamplerConfig,
    WindowConfig,
    flatten,
)
from ogm_mcmc.engine.posterior import patch_prior, posterior_model
from ogm_mcmc.engine.prior_files import default_prior_file
from ogm_mcmc.engine.sensor_fit import fit_sensor
from ogm_mcmc.geometry import CellBox, GridMap, PlacedScan
from ogm_mcmc.sampling import (
    PosteriorSampler,
    RayWindow,
    over_dispersed_starts,
)

__all__ = ['FITTED', 'METHODS', 'SampledMap', 'config_of', 'sample_map', 'window_of']

# [patch] Table II: single cells, patches, patches given their border; the last once more.
METHODS = {
    'cell': PatchConfig(prior='uniform', size=1),
    'patch9': PatchConfig(prior='patch', size=9),
    'border9': PatchConfig(prior='border', size=9),
    'fitted9': PatchConfig(prior='border', size=9),
}

# Methods that take the share of random readings from the beams, as `refine_server` does.
FITTED = ('fitted9',)


class SampledMap(NamedTuple):
    """Posterior mean, some of the maps it comes from, and what a sample costs."""

    mean: GridMap
    samples: list[GridMap]
    seconds_per_sample: float
    rays: int
    settings: dict[str, Any]


def config_of(
    patch: PatchConfig,
    resolution_m: float,
    model: ForwardModelConfig,
    *,
    prior: float,
    threshold: float,
    burn_in: int,
    seed: int,
    sensor: str = 'given',
) -> SamplerConfig:
    """Return the settings of one chain that starts as published: from the thresholded map."""
    return SamplerConfig(
        model=model,
        window=WindowConfig(resolution=resolution_m, no_return='ignore', max_memory_mb=4000.0),
        chain=ChainConfig(
            prior=prior,
            chains=1,
            start='live',
            start_threshold=threshold,
            burn_in=burn_in,
            seed=seed,
            sensor=sensor,
        ),
        patch=patch,
    )


def window_of(config: SamplerConfig, scans: Sequence[PlacedScan], box: CellBox) -> RayWindow:
    """Return the rays of scans, cut at a box."""
    window = RayWindow(config.window, config.model, limits=box)
    window.add(scans)
    return window


def sample_map(
    config: SamplerConfig,
    scans: Sequence[PlacedScan],
    box: CellBox,
    start: GridMap,
    *,
    sweeps: int,
    kept: int = 0,
) -> SampledMap:
    """Sample `sweeps` maps a chain after the burn-in and keep `kept` of the first, evenly spaced.

    Cells of `start` that are unknown, and cells outside of what is sampled, have the prior.
    The time per sample is that of the processor, without the burn-in.
    """
    config = replace(config, model=fit_sensor(scans, config)[0])
    window = window_of(config, scans, box)
    model = posterior_model(config, window, patch_prior(config).table, everywhere=True)
    chain, spec = config.chain, window.spec
    known = np.nan_to_num(start.probability, nan=chain.prior)
    live: UInt8Array = (known >= chain.start_threshold).astype(np.uint8).reshape(-1)
    free = np.nan_to_num(start.probability, nan=1.0).reshape(-1) < 0.5
    n_chains = config.chains_for(window.n_beams)
    starts = over_dispersed_starts(chain.start, n_chains, live, chain.prior, chain.seed, free)
    sampler = PosteriorSampler(model, starts, seed=chain.seed, burn_in=chain.burn_in)
    sampler.advance(chain.burn_in)
    samples, seconds, done = [], 0.0, 0
    for part in range(max(kept, 1)):
        upto = sweeps * (part + 1) // max(kept, 1)
        began = time.process_time()
        sampler.advance(upto - done)
        seconds += time.process_time() - began
        done = upto
        if kept:
            present = sampler.states[0].cells[model.touched]
            samples.append(GridMap.of_cells(spec, model.touched, present, chain.prior))
    settings = {**flatten(config), 'sweeps': sweeps}
    if not config.patch.single_cells and config.patch.prior != 'uniform':
        settings['patch.prior_file'] = default_prior_file().name
    mean = GridMap.of_cells(spec, model.touched, sampler.estimate().mean, chain.prior)
    per_sample = seconds / (sweeps * n_chains)
    return SampledMap(mean, samples, per_sample, window.index.n_rays, settings)
