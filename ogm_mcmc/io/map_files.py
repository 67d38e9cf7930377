"""Map files exactly as nav2_map_server writes them, and PNG and NPZ beside; read: `map_images`.

The image's top row is the map's highest y. In `trinary` a pixel is 0 (occupied), 205 (unknown)
or 254 (free). The reader takes p = (255 - x) / 255 of a pixel, occupied from `occupied_thresh`
on and free up to `free_thresh`. Grey 205 reads as 0.196078: with the widespread `free_thresh`
0.25 every unknown cell would come back as free. Which pixel a cell gets the
writer has decided; the thresholds in the YAML only have to tell the three greys apart, and are
always the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from PIL import Image

from ogm_mcmc.arrays import AnyArray, Float32Array, Int8Array
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.npz_files import NUMBER, Field, npz_file
from ogm_mcmc.files.output_files import checked_name, replacing
from ogm_mcmc.files.pictures import probability_image
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_arrays import ARRAY_SUFFIXES, load_array_map, within_rounding
from ogm_mcmc.io.map_images import (
    LEAST_YAW,
    MOST_CELLS,
    YAML_THRESHOLDS,
    load_map,
    turned,
)

__all__ = [
    'JudgedMap',
    'load_grid',
    'load_judged',
    'load_map',
    'load_npz',
    'points_file',
    'save_npz',
    'table_file',
    'write_map',
    'write_tables',
]

OCCUPIED, UNKNOWN, FREE = 0, 205, 254

NPZ_FIELDS = {
    'probability': Field('fiub', (None, None)),
    'resolution': NUMBER,
    'origin': Field('fiu', (3,)),
}

GUESSES = ('probability_everywhere', 'posterior_mean')
"""Layers of an NPZ that tell of cells, too, that data did not move; the first that is there."""


class JudgedMap(NamedTuple):
    """A map as a judge reads it.

    `known` has nan where nothing was measured, or data moved nothing; in `filled` these cells
    have what the file says of them all the same, nan where that is nothing.
    """

    known: GridMap
    filled: GridMap


def write_map(grid_map: GridMap, shown: Int8Array, folder: Path, name: str) -> None:
    """Write NAME.pgm, NAME.yaml and NAME.png into a folder, as part of a set.

    shown  what the PGM shows of each cell (height, width): occupied 100, free 0, unknown -1
    The PNG shows the probabilities. Raises OutputError for a name that is none.
    """
    checked_name(name)
    spec = grid_map.spec
    description = {
        'image': f'{name}.pgm',
        'mode': 'trinary',
        'resolution': spec.resolution_m,
        'origin': [spec.origin_x_m, spec.origin_y_m, 0.0],
        'negate': 0,
        **YAML_THRESHOLDS,
    }
    pixels = np.full(shown.shape, UNKNOWN, np.uint8)
    pixels[shown == 0] = FREE
    pixels[shown == 100] = OCCUPIED
    Image.fromarray(pixels[::-1]).save(folder / f'{name}.pgm', format='PPM')
    # Little compression, quick to write: a node saves while scans are waiting.
    picture = probability_image(grid_map.probability)
    picture.save(folder / f'{name}.png', format='PNG', compress_level=3)
    (folder / f'{name}.yaml').write_text(
        yaml.safe_dump(description, sort_keys=False, default_flow_style=None), encoding='utf-8'
    )


def save_npz(
    grid_map: GridMap,
    path: Path,
    settings: dict[str, Any],
    layers: Mapping[str, AnyArray] | None = None,
) -> Path:
    """Write the probabilities (nan: never measured), the grid and the settings that made them.

    `layers`: more facts about every cell (height, width), by name.
    """
    spec = grid_map.spec
    arrays: dict[str, Any] = {
        'probability': grid_map.probability,
        'resolution': spec.resolution_m,
        'origin': np.array([spec.origin_x_m, spec.origin_y_m, 0.0]),
        'settings': np.array(yaml.safe_dump(settings, sort_keys=False)),
        **(layers or {}),
    }
    with replacing(path) as temporary, temporary.open('wb') as stream:
        np.savez_compressed(stream, **arrays)
    return path


def table_file(name: str, table: str) -> str:
    """Return the file name of a table (`mapping.Extras`) that belongs to the map `name`."""
    return f'{name}_{table}.npz'


def points_file(name: str) -> str:
    """Return the file name of what a method says of points, beside the map `name`."""
    return f'{name}_points.csv'


def write_tables(
    tables: Mapping[str, Mapping[str, AnyArray]], settings: dict[str, Any], folder: Path, name: str
) -> None:
    """Write each table as an NPZ of its arrays and of the settings, as YAML, that made them."""
    text = np.array(yaml.safe_dump(settings, sort_keys=False))
    for table, arrays in tables.items():
        columns: dict[str, Any] = dict(arrays)
        with (folder / table_file(name, table)).open('wb') as stream:
            np.savez_compressed(stream, **columns, settings=text)


def load_grid(path: Path, most_cells: int = MOST_CELLS) -> GridMap:
    """Read a map by its suffix: NPZ, NPY, MAT, or map YAML. Raises MapFileError.

    A map of more than `most_cells` cells is refused before it takes memory.
    """
    suffix = path.suffix.lower()
    if suffix == '.npz':
        return load_npz(path, most_cells)
    if suffix in ('.yaml', '.yml'):
        return load_map(path, most_cells)
    if suffix in ARRAY_SUFFIXES:
        return load_array_map(path, most_cells)
    raise MapFileError(
        f'{path}: expected a map YAML (.yaml), probabilities (.npz) or an array (.npy, .mat)'
        + _nearest_map(path)
    )


def _nearest_map(path: Path) -> str:
    """Return which file was likely meant: one in a folder, or what lies beside an image."""
    if path.is_dir():
        meant = [one for end in ('.npz', '.yaml') for one in sorted(path.glob(f'*{end}'))]
    else:
        meant = [path.with_suffix(end) for end in ('.npz', '.yaml') if path.name]
    return next((f', such as {one}' for one in meant if one.is_file()), '')


def load_judged(path: Path, most_cells: int = MOST_CELLS, *, filled: bool = True) -> JudgedMap:
    """Read a map as `load_grid` does, for a judge. Raises MapFileError.

    Where the file is one of `sample` a layer of it fills unknown cells (`GUESSES`), if they are to
    be `filled`; any other map is what it is.
    """
    if filled and path.suffix.lower() == '.npz':
        return _read_npz(path, most_cells, guess=True)
    grid_map = load_grid(path, most_cells)
    return JudgedMap(grid_map, grid_map)


def load_npz(path: Path, most_cells: int = MOST_CELLS) -> GridMap:
    """Read the probabilities `save_npz` wrote. Raises MapFileError with the field at fault."""
    return _read_npz(path, most_cells, guess=False).known


def _read_npz(path: Path, most_cells: int, *, guess: bool) -> JudgedMap:
    what = 'an NPZ with probability, resolution and origin'
    with npz_file(path, what, MapFileError, most_bytes=16 * most_cells + 64) as held:
        fields = {name: held.read(name, field) for name, field in NPZ_FIELDS.items()}
        probability = _probability(path, 'probability', fields['probability'], most_cells)
        filled = probability
        there = [name for name in GUESSES if name in held.names]
        if guess and there:
            layer = held.read(there[0], Field('f', probability.shape))
            told = _probability(path, there[0], layer, most_cells)
            filled = np.where(np.isnan(probability), told, probability)
    spec = _spec_of(path, fields, probability)
    return JudgedMap(GridMap(spec, probability), GridMap(spec, filled))


def _probability(path: Path, name: str, stored: AnyArray, most_cells: int) -> Float32Array:
    height, width = stored.shape
    if stored.size > most_cells:
        raise MapFileError(
            f'{path}: {width} x {height} cells: expected at most {most_cells} (--max-cells)'
        )
    with np.errstate(over='ignore', invalid='ignore'):
        probability = within_rounding(stored)
    if probability is None:
        raise MapFileError(f'{path}: {name}: expected values from 0 to 1, or nan')
    return probability


def _spec_of(path: Path, fields: Mapping[str, AnyArray], probability: Float32Array) -> GridSpec:
    height, width = probability.shape
    origin = fields['origin'].astype(np.float64)
    resolution, (x, y, yaw) = float(fields['resolution']), map(float, origin)
    if not (np.isnan(yaw) or abs(yaw) <= LEAST_YAW):
        raise MapFileError(turned(path, yaw))
    try:
        return GridSpec(resolution, width, height, anchor_x_m=x, anchor_y_m=y)
    except ValueError as error:
        raise MapFileError(f'{path}: {error}') from error
