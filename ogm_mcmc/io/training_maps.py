"""Images of maps to learn from: which cells are occupied, free and unknown, and how large.

The resolution comes from a nav2 YAML beside the image (same name), else from a list of sources,
a CSV with at least the columns `file` and `resolution_m`, else from the caller.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float32Array, Int8Array
from ogm_mcmc.errors import MapFileError, PriorError
from ogm_mcmc.files.image_files import MOST_PIXELS, read_greys
from ogm_mcmc.files.input_files import reason_of, text_of
from ogm_mcmc.io.map_images import load_map, probability_of_greys

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
        rows = list(csv.DictReader(io.StringIO(text_of(path, 'utf-8'), newline='')))
    except (OSError, ValueError, csv.Error) as error:
        reason = reason_of(error)
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
    path: Path,
    sources: dict[str, MapSource],
    resolution_m: float = 0.0,
    most_cells: int = MOST_PIXELS,
) -> TrainingMap:
    """Read an image (PNG, PGM, ...) or the YAML of a map.

    resolution_m  of images for which neither a YAML nor the sources say it; 0: not known
    most_cells    larger images are refused before they take memory
    Raises PriorError, in one line, for what is not a map.
    """
    source = sources.get(path.name, MapSource(path.name))
    described = path if path.suffix in ('.yaml', '.yml') else path.with_suffix('.yaml')
    if described.exists() or described == path:
        states, resolution = _described(described, most_cells)
    else:
        states = _states(path, most_cells)
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


def _described(path: Path, most_cells: int) -> tuple[Int8Array, float]:
    """Read states and resolution as nav2_map_server does."""
    try:
        grid_map = load_map(path, most_cells)
    except MapFileError as error:
        raise PriorError(str(error)) from error
    return _states_of(grid_map.probability), grid_map.spec.resolution_m


def _states_of(probability: Float32Array) -> Int8Array:
    states = (probability > 0.5).astype(np.int8)
    states[np.isnan(probability)] = -1
    return states


def _states(path: Path, most_cells: int) -> Int8Array:
    """Occupied, free and unknown by nav2's own thresholds; refuses photographs."""
    greys = read_greys(path, PriorError, most_cells)
    if greys.deep:
        raise PriorError(f'{path}: pixels of 16 bits: expected 8 bits of grey')
    if greys.opaque is not None:
        raise PriorError(f'{path}: has transparent pixels: expected black, white and grey')
    if greys.coloured:
        raise PriorError(f'{path}: has colours: expected a map of black, white and grey')
    counts = np.zeros(256, np.int64)
    for row in greys.grey:  # all at once would take eight bytes a pixel
        counts += np.bincount(row, minlength=256)
    share = np.sort(counts)[-GREYS:].sum() / greys.grey.size
    if share < LEAST_SHARE:
        raise PriorError(
            f'{path}: its {GREYS} most frequent greys make up {share:.0%} of the pixels: '
            f'expected a map of black, white and grey ({LEAST_SHARE:.0%} or more)'
        )
    return _states_of(probability_of_greys(greys))
