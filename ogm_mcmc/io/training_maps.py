"""Images of maps to learn from: which cells are occupied, free and unknown, and how large.

The resolution comes from a nav2 YAML beside the image (same name), else from a list of sources,
a CSV with at least the columns `file` and `resolution_m`, else from the caller.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from ogm_mcmc.arrays import Int8Array, UInt8Array
from ogm_mcmc.errors import MapFileError, PriorError
from ogm_mcmc.io.map_files import YAML_THRESHOLDS, load_map

__all__ = ['MapSource', 'TrainingMap', 'read_sources', 'read_training_map']

# A map has three greys, a compressed or smoothed one a few more; a photograph has hundreds.
GREYS, LEAST_SHARE = 4, 0.8
LEAST_SIDE = 5


@dataclass(frozen=True)
class MapSource:
    """Where a training map comes from; `resolution_m` 0 where it is not said."""

    file: str
    resolution_m: float = 0.0
    source: str = ''
    commit: str = ''
    licence: str = ''


@dataclass(frozen=True)
class TrainingMap:
    """States (height, width) int8, row 0 lowest y: 1 occupied, 0 free, -1 unknown."""

    states: Int8Array
    resolution_m: float
    source: MapSource


def read_sources(path: Path) -> dict[str, MapSource]:
    """Read a list of sources by file name; raises PriorError with line and field."""
    try:
        with path.open(encoding='utf-8', newline='') as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, 'strerror', None) or error
        raise PriorError(f'{path}: expected a readable CSV of sources ({reason})') from error
    sources = {}
    for line, row in enumerate(rows, 2):
        if not row.get('file') or row.get('resolution_m') is None:
            raise PriorError(f'{path}: line {line}: expected columns file and resolution_m')
        sources[row['file']] = MapSource(
            row['file'],
            _resolution(row['resolution_m'], f'{path}: line {line}: resolution_m'),
            *(row.get(name) or '' for name in ('source', 'commit', 'licence')),
        )
    return sources


def _resolution(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-3 <= value <= 100.0:
        raise PriorError(f'{where} is {text!r}: expected metres per pixel, 0.001 to 100')
    return value


def read_training_map(
    path: Path, sources: dict[str, MapSource], resolution_m: float = 0.0
) -> TrainingMap:
    """Read an image (PNG, PGM, ...) or the YAML of a map.

    resolution_m  of images for which neither a YAML nor the sources say it; 0: not known
    Raises PriorError, in one line, for what is not a map.
    """
    source = sources.get(path.name, MapSource(path.name))
    described = path if path.suffix in ('.yaml', '.yml') else path.with_suffix('.yaml')
    if described.exists() or described == path:
        states, resolution = _described(described)
    else:
        states = _states(_greys(path), path)
        resolution = source.resolution_m or resolution_m
    height, width = states.shape
    if min(height, width) < LEAST_SIDE:
        raise PriorError(
            f'{path}: {width} x {height} pixels: expected a map of at least 5 x 5 cells'
        )
    for state, name in ((1, 'occupied'), (0, 'free')):
        if not (states == state).any():
            raise PriorError(
                f'{path}: no {name} cell: expected a map with free and occupied cells'
            )
    if not resolution:
        raise PriorError(
            f'{path}: resolution is not known: expected a YAML beside it, a line in the list of '
            'sources, or --image-resolution'
        )
    return TrainingMap(states, resolution, replace(source, resolution_m=resolution))


def _described(path: Path) -> tuple[Int8Array, float]:
    """Read states and resolution as nav2_map_server does."""
    try:
        grid_map = load_map(path)
    except MapFileError as error:
        raise PriorError(str(error)) from error
    occupied = grid_map.probability > 0.5
    states = np.where(np.isnan(grid_map.probability), -1, occupied).astype(np.int8)
    return states, grid_map.spec.resolution_m


def _greys(path: Path) -> UInt8Array:
    """Grey of each pixel, row 0 at the bottom."""
    try:
        with Image.open(path) as image:
            mode = image.mode
            pixels = np.asarray(image.convert('RGBA'))[::-1]
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        reason = ' '.join(str(getattr(error, 'strerror', None) or error).split())
        raise PriorError(f'{path}: expected a readable image ({reason})') from error
    if mode.startswith(('I', 'F')):
        raise PriorError(f'{path}: pixels of mode {mode}: expected 8 bits of grey')
    if (pixels[..., 3] != 255).any():
        raise PriorError(f'{path}: has transparent pixels: expected black, white and grey')
    if (pixels[..., :1] != pixels[..., :3]).any():
        raise PriorError(f'{path}: has colours: expected a map of black, white and grey')
    return np.ascontiguousarray(pixels[..., 0])


def _states(greys: UInt8Array, path: Path) -> Int8Array:
    """Occupied, free and unknown by nav2's own thresholds; refuses photographs."""
    counts = np.sort(np.bincount(greys.ravel(), minlength=256))[::-1]
    share = counts[:GREYS].sum() / greys.size
    if share < LEAST_SHARE:
        raise PriorError(
            f'{path}: its {GREYS} most frequent greys make up {share:.0%} of the pixels: '
            f'expected a map of black, white and grey ({LEAST_SHARE:.0%} or more)'
        )
    darkness = (255.0 - greys) / 255.0
    states = np.full(greys.shape, -1, np.int8)
    states[darkness < YAML_THRESHOLDS['free_thresh']] = 0
    states[darkness > YAML_THRESHOLDS['occupied_thresh']] = 1
    return states
