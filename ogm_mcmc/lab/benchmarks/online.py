"""Times the mapping call."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import GridSpec, PlacedScan, cast_rays
from ogm_mcmc.geometry.traversal_kernels import trace_ray
from ogm_mcmc.mapping import MappingMethod, PoseUncertainMapper, make_method
from ogm_mcmc.mapping.pose_samples import pose_samples

__all__ = ['count_ray_cells', 'time_online']


def time_online(
    placed: Sequence[PlacedScan], config: MapperConfig, repeats: int
) -> dict[str, Any]:
    """Map all scans `repeats` times on an emptied map; return best and median, ms, and rates.

    As in a running node the map's memory is there: a first, untimed pass lets it grow. `cells`
    counts every cell every beam crosses, once for each pose sample, which is what `ns_per_cell`
    refers to.
    """
    method = make_method(config)
    times_ms = []
    for attempt in range(repeats + 1):
        started = time.perf_counter()
        for scan, belief in placed:
            method.update(PlacedScan(scan, belief))
        if attempt:
            times_ms.append(1e3 * (time.perf_counter() - started))
        method.forget_cells()
    best = min(times_ms)
    samples = _mean_samples(placed, method)
    cells = round(samples * count_ray_cells(placed, config))
    return {
        'method': config.method,
        'inverse_model': config.inverse_model,
        'samples': round(samples, 2),
        'ms': round(best, 4),
        'median_ms': round(statistics.median(times_ms), 4),
        'scans': len(placed),
        'scans_per_s': round(1e3 * len(placed) / best, 1),
        'ns_per_cell': round(1e6 * best / cells, 4) if cells else None,
        'cells': cells,
        'resolution': config.resolution,
        'fusion': config.fusion,
        'no_return': config.no_return,
        'repeats': repeats,
    }


def _mean_samples(placed: Sequence[PlacedScan], method: MappingMethod) -> float:
    """Return the mean number of poses that one scan is mapped at."""
    if not isinstance(method, PoseUncertainMapper):
        return 1.0
    return statistics.mean(
        pose_samples(one, method.config.pose_uncertain, np.random.default_rng(1)).weights.size
        for one in placed
    )


def count_ray_cells(placed: Sequence[PlacedScan], config: MapperConfig) -> int:
    """Count the cells crossed, each beam for itself."""
    spec = GridSpec(config.resolution, 1, 1)
    total = 0
    scratch = np.empty((2, 0), np.int64)
    for scan, belief in placed:
        rays = cast_rays(
            scan,
            belief.mean,
            spec,
            max_range_m=config.max_range,
            no_return_clears=config.no_return == 'clear',
        )
        longest = rays.box.column1 - rays.box.column0 + rays.box.row1 - rays.box.row0 + 3
        if scratch.shape[1] < longest:
            scratch = np.empty((2, longest), np.int64)
        for ray in range(rays.n_rays):
            end_x, end_y = rays.ends[0, ray], rays.ends[1, ray]
            total += trace_ray(0, 0, rays.x, rays.y, end_x, end_y, scratch[0], scratch[1])
    return total
