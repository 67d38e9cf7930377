"""The simulated data sets of [gibbs] and [patch]: ten runs on each of ten maps.

500 x 500 cells, range F = 75 cells, Gaussian noise on the ranges, an exploring robot that scans
when it stands. The papers do not say how many beams a scan has; here one a degree, all around.
Their maps are not public: ours are generated, from cluttered offices to sparse halls.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.simulation import (
    Exploration,
    GridWorld,
    Lidar,
    generate_floor,
    record_exploration,
)

__all__ = ['REACH_CELLS', 'SimulatedSet', 'set_names', 'simulated_set']

REACH_CELLS = 75.0


class SimulatedSet(NamedTuple):
    """One data set: the true world and the scans with their true poses."""

    world: GridWorld
    scans: list[PlacedScan]


def set_names(maps: int = 10, runs: int = 10) -> dict[str, tuple[int, int]]:
    """Names of data sets and their (building, run), both from 1 on.

    One run in every building, then the next: what is finished early speaks for all buildings.
    """
    return {
        f'map{building:02d}_run{run:02d}': (building, run)
        for run in range(1, runs + 1)
        for building in range(1, maps + 1)
    }


def simulated_set(
    building: int,
    run: int,
    *,
    seed: int,
    noise_cells: float,
    beams: int = 360,
    max_scans: int = 1000,
) -> SimulatedSet:
    """Return one data set; every run starts elsewhere and has noise of its own."""
    world = generate_floor(building, seed)
    cell_m = world.spec.resolution_m
    lidar = Lidar(
        beams,
        range_min_m=0.0,
        range_max_m=REACH_CELLS * cell_m,
        noise_m=noise_cells * cell_m,
        dropout=0.0,
    )
    settings = Exploration(reach=REACH_CELLS, max_stops=max_scans)
    rng = np.random.default_rng((seed, building, run))
    return SimulatedSet(world, list(record_exploration(world, lidar, settings, rng)))
