"""Times the simulator: beams through a grid of cells, and a whole data set."""

from __future__ import annotations

import math
import statistics
import time
from typing import Any

import numpy as np

from ogm_mcmc.simulation import Exploration, GridWorld, Lidar, explore, record_exploration
from ogm_mcmc.simulation.raster_kernels import first_occupied

__all__ = ['time_simulation']


def time_simulation(
    world: GridWorld, lidar: Lidar, repeats: int, seed: int = 1, max_scans: int = 200
) -> dict[str, Any]:
    """Return best and median of `repeats` passes, and rates.

    `beams` is the ray casting alone, from all stops of a data set; `cells` counts every cell a
    beam walks through up to the one that is hit, which is what `ns_per_cell` refers to.
    `data_set` is everything: exploring, ray casting, noise, scans.
    """
    reach = lidar.range_max_m / world.spec.resolution_m
    settings = Exploration(reach=reach, max_stops=max_scans, min_stops=max_scans)
    stops = list(explore(world, settings, np.random.default_rng(seed)))
    bearings = lidar.bearings()
    places = [(*world.cell_position(stop.pose), stop.pose.yaw_rad + bearings) for stop in stops]
    aimed = [(x, y, np.stack((np.cos(angle), np.sin(angle)))) for x, y, angle in places]
    entered, left = np.empty(lidar.beams), np.empty(lidar.beams)
    casting, making, cells = [], [], 0
    for _ in range(repeats):
        started = time.perf_counter()
        cells = 0
        for x, y, directions in aimed:
            cells += first_occupied(world.occupied, x, y, directions, reach, entered, left)
        casting.append(1e3 * (time.perf_counter() - started))
        started = time.perf_counter()
        for _ in record_exploration(world, lidar, settings, np.random.default_rng(seed)):
            pass
        making.append(time.perf_counter() - started)
    best = min(casting)
    beams = len(stops) * lidar.beams
    return {
        'beams': {
            'ms': round(best, 4),
            'median_ms': round(statistics.median(casting), 4),
            'beams': beams,
            'cells': cells,
            'ns_per_cell': round(1e6 * best / cells, 4) if cells else None,
            'beams_per_s': round(1e3 * beams / best),
        },
        'data_set': {
            'seconds': round(min(making), 4),
            'median_seconds': round(statistics.median(making), 4),
            'scans': len(stops),
            'scans_per_s': round(len(stops) / min(making), 1),
        },
        'reach_cells': math.floor(reach),
        'beams_per_scan': lidar.beams,
        'seed': seed,
        'repeats': repeats,
    }
