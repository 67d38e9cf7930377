"""Times sampling from the full posterior: the index of the rays, sweeps, two chains at once.

What counts as memory: the most that was taken while the index was built, so nothing that is only
there for a while is left out; what sampling takes afterwards is given beside it.
"""

from __future__ import annotations

import statistics
import time
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import ChainConfig, ForwardModelConfig, SamplerConfig, WindowConfig, flatten
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.lab.benchmarks.pair_count_kernels import count_looked_at
from ogm_mcmc.lab.benchmarks.plain_sweep import time_beside_plain
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow

__all__ = ['Effort', 'bag_config', 'scene_config', 'time_sampling']

BUILDS = 3


@dataclass(frozen=True)
class Effort:
    """How much is measured: sweeps that warm up, sweeps that are timed one by one."""

    warm_up: int = 20
    sweeps: int = 20


def scene_config(resolution_m: float, cut_sigma: float, prior: float) -> SamplerConfig:
    """Return [gibbs] on the scene: Gaussian readings, sigma of two cells."""
    return SamplerConfig(
        model=ForwardModelConfig(kind='gaussian', sigma=2.0 * resolution_m),
        window=WindowConfig(resolution=resolution_m, cut_sigma=cut_sigma),
        chain=ChainConfig(prior=prior, start='live', chains=1),
    )


def bag_config(resolution_m: float, no_return: str, prior: float) -> SamplerConfig:
    """Return the beam model as it comes, at a resolution."""
    return SamplerConfig(
        window=WindowConfig(resolution=resolution_m, no_return=no_return, max_memory_mb=1e6),
        chain=ChainConfig(prior=prior, start='live', chains=1),
    )


def time_sampling(
    placed: Sequence[PlacedScan], config: SamplerConfig, effort: Effort
) -> dict[str, Any]:
    """Measure one input; chains start from the thresholded live map and warm up untimed."""
    index_ms, peak_bytes = _time_index(placed, config)
    refinement = Refinement(config)
    refinement.take(placed)
    assert refinement.sampler is not None
    chain, index, model = config.chain, refinement.window.index, refinement.sampler.model
    assert isinstance(model, CellModel)
    start = refinement.sampler.states[0].cells
    sampler = PosteriorSampler(model, [start], seed=chain.seed, burn_in=0)
    sampler.advance(effort.warm_up)
    times_ms = []
    for _ in range(effort.sweeps):
        started = time.perf_counter()
        model.advance(sampler.rngs[0], sampler.states[0])
        times_ms.append(1e3 * (time.perf_counter() - started))
    best = min(times_ms)
    cells, pairs = count_looked_at(
        np.random.default_rng(chain.seed), model.touched, *sampler.states[0][:2], index,
        model.ceiling, chain.prior_log_odds,
    )  # fmt: skip
    size = refinement.size
    sampling_bytes = size.n_bytes + model.ceiling.nbytes + sampler.n_bytes
    return {
        'ms_per_sweep': round(best, 4),
        'median_ms_per_sweep': round(statistics.median(times_ms), 4),
        'pairs': size.n_pairs,
        'ns_per_pair': round(1e6 * best / size.n_pairs, 4),
        'bytes_per_pair': round(peak_bytes / size.n_pairs, 3),
        'bytes_per_ray': round(size.n_bytes / size.n_rays, 1),
        'peak_bytes_per_ray': round(peak_bytes / size.n_rays, 1),
        'index_mb': round(size.n_bytes / 1e6, 2),
        'bytes_per_pair_sampling': round(sampling_bytes / size.n_pairs, 3),
        'index_ms': round(index_ms, 3),
        'index_in_sweeps': round(index_ms / best, 2),
        'index_ns_per_pair': round(1e6 * index_ms / size.n_pairs, 2),
        'threads': _time_threads(model, start, effort),
        'plain_loop': _time_plain(model, start, chain.seed, effort),
        'looked_at': {
            'cells': int(cells),
            'pairs': int(pairs),
            'share_of_pairs': round(pairs / size.n_pairs, 5),
            'all_rays_for_every_cell': size.n_rays * int(model.touched.size),
        },
        'rays': size.n_rays,
        'cells': int(model.touched.size),
        'scans': len(placed),
        'warm_up_sweeps': effort.warm_up,
        'timed_sweeps': effort.sweeps,
        'settings': flatten(config),
    }


def _time_index(placed: Sequence[PlacedScan], config: SamplerConfig) -> tuple[float, int]:
    """Build the index several times; return the best ms and the most memory in bytes."""

    def build() -> RayWindow:
        window = RayWindow(config.window, config.model)
        window.add(placed)
        return window

    build()  # kernels may have to be compiled
    times_ms = []
    for _ in range(BUILDS):
        started = time.perf_counter()
        window = build()
        times_ms.append(1e3 * (time.perf_counter() - started))
        del window
    tracemalloc.start()
    build()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return min(times_ms), peak


def _time_plain(
    model: CellModel, start: UInt8Array, seed: int, effort: Effort
) -> dict[str, Any] | None:
    """Compare with a loop over all pairs; None where rays are level in front, not listed."""
    if model.index.runs.size:
        return None
    cells = model.start(start).cells
    return time_beside_plain(model, cells, seed, effort.warm_up, effort.sweeps)


def _time_threads(model: CellModel, start: UInt8Array, effort: Effort) -> dict[str, float]:
    """Return sweeps per second of one chain, of two together, and the ratio; best of three."""
    rates: dict[str, float] = {}
    for n_chains in (1, 2):
        sampler = PosteriorSampler(model, [start] * n_chains, seed=1, burn_in=0)
        sampler.advance(effort.warm_up)
        best = 0.0
        for _ in range(3):
            started = time.perf_counter()
            sampler.advance(effort.sweeps)
            best = max(best, n_chains * effort.sweeps / (time.perf_counter() - started))
        rates[str(n_chains)] = round(best, 3)
    rates['ratio'] = round(rates['2'] / rates['1'], 3)
    return rates
