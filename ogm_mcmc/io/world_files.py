"""Worlds by name or from a file, and the truth that is written beside a simulated recording."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.io.map_files import load_grid, replacing
from ogm_mcmc.simulation import FLOOR_PLANS, WORLDS, Building, GridWorld, generate_floor

__all__ = ['WORLD_NAMES', 'load_image', 'load_world', 'world_kind', 'write_poses']

WORLD_NAMES = (*sorted(WORLDS), *(f'building-{k + 1}' for k in range(len(FLOOR_PLANS))))

MAP_SUFFIXES = ('.yaml', '.yml', '.npz')

# As nav2 has it: darker than this is occupied, lighter than that is free.
OCCUPIED_FROM, FREE_TO = 0.65, 0.196


def world_kind(name: str) -> str:
    """Return of which kind a world is: `walls`, `building` (generated), `map` or `image`.

    Raises MapFileError for one that is neither known by name nor a file.
    """
    if name in WORLD_NAMES:
        return 'walls' if name in WORLDS else 'building'
    if not name or not Path(name).exists():
        raise MapFileError(
            f'world {name!r}: expected {", ".join(WORLD_NAMES)}, or a map YAML, NPZ or image'
        )
    return 'map' if Path(name).suffix in MAP_SUFFIXES else 'image'


def load_world(
    name: str,
    *,
    resolution_m: float = 0.05,
    unknown_occupied: bool = True,
    world_seed: int = 0,
) -> Building | GridWorld:
    """Return a world by its name, or from a map YAML, an NPZ or an image file.

    `resolution_m` is the side of an image's pixels. Raises MapFileError.
    """
    kind, path = world_kind(name), Path(name)
    if kind == 'walls':
        return WORLDS[name]()
    if kind == 'building':
        return generate_floor(int(name.partition('-')[2]), world_seed)
    grid_map = load_grid(path) if kind == 'map' else load_image(path, resolution_m)
    world = GridWorld.from_map(grid_map, unknown_occupied=unknown_occupied)
    if world.occupied.all():
        raise MapFileError(f'{path}: no free cell in it; expected some')
    return world


def load_image(path: Path, resolution_m: float) -> GridMap:
    """Read an image as a map: dark is occupied, light free, the rest unknown.

    Raises MapFileError.
    """
    try:
        with Image.open(path) as image:
            grey = np.asarray(image.convert('L'), np.float64)[::-1]
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        reason = ' '.join(str(error).split())
        raise MapFileError(f'{path}: expected a readable image ({reason})') from error
    if not (math.isfinite(resolution_m) and resolution_m > 0.0):
        raise MapFileError(f'{path}: resolution is {resolution_m:g}: expected metres per pixel')
    darkness = (255.0 - grey) / 255.0
    probability = np.full(grey.shape, np.nan, np.float32)
    probability[darkness < FREE_TO] = 0.0
    probability[darkness > OCCUPIED_FROM] = 1.0
    return GridMap(GridSpec(resolution_m, grey.shape[1], grey.shape[0]), probability)


def write_poses(path: Path, poses: Iterable[tuple[int, Pose2D]]) -> None:
    """Write a CSV with a header: stamp_ns, x_m, y_m, yaw_rad, exact to the last digit."""
    with replacing(path) as temporary, temporary.open('w', newline='', encoding='utf-8') as stream:
        table = csv.writer(stream)
        table.writerow(('stamp_ns', 'x_m', 'y_m', 'yaw_rad'))
        for stamp_ns, pose in poses:
            table.writerow((stamp_ns, repr(pose.x_m), repr(pose.y_m), repr(pose.yaw_rad)))
