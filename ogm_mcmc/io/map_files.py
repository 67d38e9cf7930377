"""Map files exactly as nav2_map_server reads and writes them, and PNG and NPZ beside.

The image's top row is the map's highest y. In `trinary` a pixel is 0 (occupied), 205 (unknown)
or 254 (free). The reader takes p = (255 - x) / 255 of a pixel, occupied above `occupied_thresh`
and free below `free_thresh`. Grey 205 reads as 0.196078: with the widespread `free_thresh` 0.25
every unknown cell would come back as free. The thresholds of `OutputConfig` decide which pixel a
cell gets; those in the YAML only have to tell the three greys apart, and are always the same.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from ogm_mcmc.arrays import AnyArray, UInt8Array
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.errors import MapFileError, OutputError
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.geometry.grid_map import trinary_values

__all__ = [
    'checked_name',
    'folder_to_fill',
    'load_grid',
    'load_map',
    'load_npz',
    'makeable_folder',
    'replacing',
    'save_map',
    'save_npz',
    'trinary_pixels',
    'writable_folder',
]

OCCUPIED, UNKNOWN, FREE = 0, 205, 254

# What the reader needs to tell these three apart, nav2's own values.
YAML_THRESHOLDS = {'occupied_thresh': 0.65, 'free_thresh': 0.196}


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that takes its place when all went well.

    Raises OutputError when the place cannot be written to; nothing half-written is left.
    """
    try:
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f'.{path.stem}-', suffix=path.suffix
        )
        os.close(handle)
    except OSError as error:
        raise OutputError(f'{path}: cannot be written ({error.strerror})') from error
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f'{path}: cannot be written ({error.strerror or error})') from error
    finally:
        temporary.unlink(missing_ok=True)


def writable_folder(path: Path) -> Path:
    """Make a folder, parents included, and check that files can be made in it.

    Raises OutputError otherwise; call it before long work, so that none is lost.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise OutputError(f'{path}: expected a writable folder ({error.strerror})') from error
    return path


@contextlib.contextmanager
def folder_to_fill(path: Path) -> Iterator[Path]:
    """Make a folder as `writable_folder` does; what was made for nothing goes again.

    That is the folder, and parents that were not there before, if they are empty in the end.
    """
    new = [one for one in (path, *path.parents) if not one.exists()]
    try:
        yield writable_folder(path)
    finally:
        with contextlib.suppress(OSError):
            for one in new:
                one.rmdir()


def makeable_folder(path: Path) -> Path:
    """Check that `writable_folder` will succeed, without making any: work may fail before.

    Raises OutputError.
    """
    there = path
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise OutputError(f'{there}: expected a writable folder ({error.strerror})') from error
    return path


def checked_name(name: str) -> str:
    """Return a name for map files; raises OutputError unless it is a plain file name."""
    if not name or name.startswith('.') or Path(name).name != name:
        raise OutputError(f'name of the map is {name!r}: expected a file name without folders')
    return name


def trinary_pixels(grid_map: GridMap, output: OutputConfig) -> UInt8Array:
    """Pixels of the map image (height, width), top row highest y."""
    values = trinary_values(grid_map.probability, output.occupied_thresh, output.free_thresh)
    pixels = np.full(values.shape, UNKNOWN, np.uint8)
    pixels[values == 0] = FREE
    pixels[values == 100] = OCCUPIED
    return pixels[::-1]


def picture(grid_map: GridMap) -> Image.Image:
    """Picture for people: black occupied, white free, unknown in a bluish grey.

    One byte a pixel with a palette, quick to write: a node saves while scans are waiting.
    """
    probability = grid_map.probability[::-1]
    shade = np.rint(254.0 * (1.0 - np.nan_to_num(probability))).astype(np.uint8)
    shade[~np.isfinite(probability)] = 255
    image = Image.fromarray(shade).convert('P')
    greys = np.repeat(np.rint(np.linspace(0.0, 255.0, 255)).astype(np.uint8), 3)
    image.putpalette([*greys.tolist(), 190, 198, 208])
    return image


def save_map(
    grid_map: GridMap, folder: Path, output: OutputConfig, name: str = 'map'
) -> dict[str, Path]:
    """Write NAME.pgm, NAME.yaml and NAME.png; return their paths.

    The PGM is trinary, the PNG shows the probabilities. Raises OutputError.
    """
    pixels = trinary_pixels(grid_map, output)
    spec = grid_map.spec
    description = {
        'image': f'{name}.pgm',
        'mode': 'trinary',
        'resolution': spec.resolution_m,
        'origin': [spec.origin_x_m, spec.origin_y_m, 0.0],
        'negate': 0,
        **YAML_THRESHOLDS,
    }
    checked_name(name)
    paths = {kind: writable_folder(folder) / f'{name}.{kind}' for kind in ('pgm', 'yaml', 'png')}
    for path in paths.values():
        if path.is_dir():
            raise OutputError(f'{path}: is a folder; expected a name for a file')
    # The last to be opened is the first in place: the YAML, which names the image, comes last.
    with (
        replacing(paths['yaml']) as yaml_file,
        replacing(paths['png']) as png,
        replacing(paths['pgm']) as pgm,
    ):
        Image.fromarray(pixels).save(pgm, format='PPM')
        picture(grid_map).save(png, format='PNG', compress_level=3)
        yaml_file.write_text(
            yaml.safe_dump(description, sort_keys=False, default_flow_style=None),
            encoding='utf-8',
        )
    return paths


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


def load_grid(path: Path) -> GridMap:
    """Read a map by its suffix: NPZ with probabilities, or map YAML. Raises MapFileError."""
    if path.suffix == '.npz':
        return load_npz(path)
    if path.suffix in ('.yaml', '.yml'):
        return load_map(path)
    raise MapFileError(f'{path}: expected a map YAML (.yaml) or probabilities (.npz)')


def load_npz(path: Path) -> GridMap:
    """Read the probabilities `save_npz` wrote. Raises MapFileError with the field at fault."""
    try:
        with np.load(path) as data:
            probability = np.array(data['probability'], np.float32)
            resolution, origin = float(data['resolution']), data['origin'].astype(np.float64)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        reason = ' '.join(str(error).split())
        raise MapFileError(
            f'{path}: expected an NPZ with probability, resolution and origin ({reason})'
        ) from error
    if probability.ndim != 2 or origin.shape != (3,):
        raise MapFileError(
            f'{path}: probability has shape {probability.shape}, origin {origin.shape}: '
            'expected (height, width) and (3,)'
        )
    if np.nanmin(probability, initial=0.0) < 0.0 or np.nanmax(probability, initial=1.0) > 1.0:
        raise MapFileError(f'{path}: probability: expected values from 0 to 1, or nan')
    height, width = probability.shape
    try:
        x, y = float(origin[0]), float(origin[1])
        spec = GridSpec(resolution, width, height, anchor_x_m=x, anchor_y_m=y)
    except ValueError as error:
        raise MapFileError(f'{path}: {error}') from error
    return GridMap(spec, probability)


def load_map(path: Path) -> GridMap:
    """Read a trinary map YAML as nav2_map_server does: probability 1, 0 or nan.

    Raises MapFileError with the field at fault.
    """
    try:
        fields = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise MapFileError(f'{path}: expected a readable map YAML') from error
    needed = ('image', 'resolution', 'origin', 'negate', 'occupied_thresh', 'free_thresh')
    if not isinstance(fields, dict) or any(key not in fields for key in needed):
        raise MapFileError(f'{path}: expected a map YAML with {", ".join(needed)}')
    if fields.get('mode', 'trinary') != 'trinary':
        raise MapFileError(f'{path}: mode is {fields["mode"]!r}: expected trinary')
    image_path = path.parent / str(fields['image'])
    try:
        with Image.open(image_path) as image:
            pixels = np.asarray(image.convert('L'), np.float64)[::-1]
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        reason = ' '.join(str(error).split())
        raise MapFileError(f'{image_path}: expected a readable image ({reason})') from error
    try:
        origin = [float(value) for value in fields['origin']]
        resolution = float(fields['resolution'])
        free, occupied = float(fields['free_thresh']), float(fields['occupied_thresh'])
        if not free < occupied:
            raise ValueError(f'free_thresh {free}, occupied_thresh {occupied}: expected one below')
        spec = GridSpec(
            resolution,
            pixels.shape[1],
            pixels.shape[0],
            anchor_x_m=origin[0],
            anchor_y_m=origin[1],
        )
    except (TypeError, ValueError, IndexError) as error:
        raise MapFileError(f'{path}: {error}') from error
    darkness = (pixels if fields['negate'] else 255.0 - pixels) / 255.0
    probability = np.full(pixels.shape, np.nan, np.float32)
    probability[darkness < free] = 0.0
    probability[darkness > occupied] = 1.0
    return GridMap(spec, probability)
