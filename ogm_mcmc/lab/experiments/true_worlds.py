"""Worlds of which all is known, driven through: generated buildings, an office, images of maps.

Images are those that the shipped prior is learned from, in `$OGM_MCMC_DATA/maps`. Whoever maps
one of them learns a prior from the others.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.config import LearningConfig
from ogm_mcmc.engine.prior_files import Prior, default_prior_file, load_prior, save_prior
from ogm_mcmc.engine.prior_learning import count_maps
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan
from ogm_mcmc.io.training_maps import MapSource, TrainingMap, read_training_map
from ogm_mcmc.lab.experiments.recordings import data_folder
from ogm_mcmc.sampling.patch_learning import rescaled
from ogm_mcmc.simulation import (
    FLOOR_PLANS,
    WORLDS,
    Exploration,
    GridWorld,
    Lidar,
    generate_floor,
    rasterised,
    record,
    record_exploration,
)

__all__ = [
    'BUILDINGS',
    'OFFICE',
    'TrueDrive',
    'drive_through',
    'image_of',
    'images',
    'prior_without',
]

BUILDINGS = tuple(f'building-{number}' for number in range(1, len(FLOOR_PLANS) + 1))
OFFICE = 'office'

# Which of the generated buildings; seeds of an experiment are of way, noise and chains.
BUILDING_SEED = 0
CELL_M = 0.05
LIDAR = Lidar()
ROBOT_RADIUS_M = 0.25

FOLDER = Path('maps')


class TrueDrive(NamedTuple):
    """Scans at their true poses, and the true map of cells of that size, none of them unknown."""

    scans: list[PlacedScan]
    truth: GridMap
    cell_m: float


@lru_cache(maxsize=1)
def images() -> dict[str, MapSource]:
    """Return the images that the shipped prior was learned from, by name without suffix."""
    return {Path(one.file).stem: one for one in load_prior(default_prior_file()).sources}


def drive_through(name: str, seed: int) -> TrueDrive:
    """Record a drive through a building, the office, or the world that an image shows.

    Raises ConfigError where the image is not there.
    """
    rng = np.random.default_rng(seed)
    if name == OFFICE:
        office = WORLDS[OFFICE]()
        truth = rasterised(office, CELL_M)
        # Behind all walls there is nothing but wall.
        solid = GridMap(truth.spec, np.nan_to_num(truth.probability, nan=1.0))
        return TrueDrive(list(record(office, LIDAR, rng)), solid, CELL_M)
    number = BUILDINGS.index(name) + 1 if name in BUILDINGS else 0
    world = generate_floor(number, BUILDING_SEED) if number else _world_of(image_of(name))
    cell_m = world.spec.resolution_m
    way = Exploration(reach=LIDAR.range_max_m / cell_m, radius=ROBOT_RADIUS_M / cell_m)
    scans = list(record_exploration(world, LIDAR, way, rng))
    return TrueDrive(scans, world.truth(), cell_m)


def image_of(name: str) -> TrainingMap:
    """Read the image of that name; raises ConfigError where it is not there."""
    source = images()[name]
    expected = f'OGM_MCMC_DATA to name a folder with {FOLDER / source.file} ({source.source})'
    path = data_folder(FOLDER / source.file, expected) / FOLDER / source.file
    return read_training_map(path, {source.file: source})


def prior_without(name: str, path: Path) -> Path:
    """Write the prior learned from all images but one, as the shipped one is; return its path."""
    return save_prior(_learned(tuple(other for other in images() if other != name)), path)


@lru_cache(maxsize=1)
def _learned(names: tuple[str, ...]) -> Prior:
    maps: Iterable[tuple[Path, TrainingMap]] = ((Path(one), image_of(one)) for one in names)
    return count_maps(maps, LearningConfig()).prior(least=1)


def _world_of(image: TrainingMap) -> GridWorld:
    """Return an image as a world of its own cells, of finer ones pooled; unknown is solid."""
    states, cell_m = image.states, image.resolution_m
    if cell_m < CELL_M:
        states, cell_m = rescaled(states, cell_m, CELL_M), CELL_M
    height, width = states.shape
    return GridWorld.checked(GridSpec(cell_m, width, height), states != 0)
