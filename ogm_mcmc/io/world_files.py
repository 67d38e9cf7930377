"""Worlds by name or from a file, and the truth that is written beside a simulated recording."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.image_files import read_greys
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.io.map_files import load_grid
from ogm_mcmc.io.map_images import MOST_CELLS, greys_as_map
from ogm_mcmc.io.trajectory_files import POSE_COLUMNS
from ogm_mcmc.simulation import FLOOR_PLANS, WORLDS, Building, GridWorld, generate_floor

__all__ = ['WORLD_NAMES', 'load_image', 'load_world', 'world_kind', 'write_poses']

WORLD_NAMES = (*sorted(WORLDS), *(f'building-{k + 1}' for k in range(len(FLOOR_PLANS))))

MAP_SUFFIXES = ('.yaml', '.yml', '.npz')


def world_kind(name: str) -> str:
    """Return of which kind a world is: `walls`, `building` (generated), `map` or `image`.

    Raises MapFileError for one that is neither known by name nor a file.
    """
    if name in WORLD_NAMES:
        return 'walls' if name in WORLDS else 'building'
    if not name or not user_path(name, 'world', MapFileError).exists():
        raise MapFileError(
            f'world {name!r}: expected {", ".join(WORLD_NAMES)}, or a map YAML, NPZ or image'
        )
    return 'map' if user_path(name).suffix in MAP_SUFFIXES else 'image'


def load_world(
    name: str,
    *,
    resolution_m: float = 0.05,
    unknown_occupied: bool = True,
    world_seed: int = 0,
    most_cells: int = MOST_CELLS,
) -> Building | GridWorld:
    """Return a world by its name, or from a map YAML, an NPZ or an image file.

    `resolution_m` is the side of an image's pixels. Raises MapFileError.
    """
    kind = world_kind(name)
    if kind == 'walls':
        return WORLDS[name]()
    if kind == 'building':
        return generate_floor(int(name.partition('-')[2]), world_seed)
    path = user_path(name, 'world', MapFileError)
    if kind == 'map':
        grid_map = load_grid(path, most_cells)
    else:
        grid_map = load_image(path, resolution_m, most_cells)
    world = GridWorld.from_map(grid_map, unknown_occupied=unknown_occupied)
    if world.occupied.all():
        raise MapFileError(f'{path}: no free cell in it; expected some')
    return world


def load_image(path: Path, resolution_m: float, most_cells: int = MOST_CELLS) -> GridMap:
    """Read an image as a map as nav2 does: dark is occupied, light free, the rest unknown.

    Raises MapFileError.
    """
    if not (math.isfinite(resolution_m) and resolution_m > 0.0):
        raise MapFileError(f'{path}: resolution is {resolution_m:g}: expected metres per pixel')
    return greys_as_map(read_greys(path, MapFileError, most_cells), resolution_m)


def write_poses(path: Path, poses: Iterable[tuple[int, Pose2D]]) -> None:
    """Write a CSV that `read_trajectory` reads, exact to the last digit."""
    with replacing(path) as temporary, temporary.open('w', newline='', encoding='utf-8') as stream:
        table = csv.writer(stream)
        table.writerow(POSE_COLUMNS)
        for stamp_ns, pose in poses:
            table.writerow((stamp_ns, repr(pose.x_m), repr(pose.y_m), repr(pose.yaw_rad)))
