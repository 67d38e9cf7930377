"""Whole maps drawn from the posterior, one bit a cell.

NPZ: `maps` (S, ceil(H W / 8)) uint8, each row the cells of one map as `numpy.packbits` packs
them, row-major from the lower left, 1 occupied; `touched` (ceil(H W / 8),) uint8, packed alike,
1 where a ray came: all other cells are free in every map and say nothing; `shape` (H, W),
`resolution`, `origin` and `settings` as in a map's NPZ; `thin`, sweeps between maps of one chain.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from ogm_mcmc.arrays import BoolArray, Float32Array, UInt8Array
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.npz_files import MOST_BYTES, NUMBER, Field, npz_file
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_images import MOST_CELLS

__all__ = ['MapSamples', 'load_samples', 'save_samples']

ORIGIN = Field('fiu', (3,))


class MapSamples(NamedTuple):
    """Maps (S, H, W) uint8 of 0 and 1 on a grid; `touched` (H, W): cells a ray came to."""

    spec: GridSpec
    maps: UInt8Array
    touched: BoolArray

    def grid_maps(self) -> Iterator[GridMap]:
        """Yield the maps one by one, nan where no ray came."""
        for cells in self.maps:
            probability: Float32Array = np.where(self.touched, cells, np.nan).astype(np.float32)
            yield GridMap(self.spec, probability)


def save_samples(samples: MapSamples, path: Path, thin: int, settings: dict[str, Any]) -> Path:
    """Write maps, a bit a cell. Raises OutputError."""
    spec = samples.spec
    with replacing(path) as temporary, temporary.open('wb') as stream:
        np.savez_compressed(
            stream,
            maps=np.packbits(samples.maps.reshape(len(samples.maps), -1), axis=1),
            touched=np.packbits(samples.touched),
            shape=np.array([spec.height, spec.width]),
            resolution=spec.resolution_m,
            origin=np.array([spec.origin_x_m, spec.origin_y_m, 0.0]),
            thin=thin,
            settings=np.array(yaml.safe_dump(settings, sort_keys=False)),
        )
    return path


def load_samples(path: Path, most_cells: int = MOST_CELLS) -> MapSamples:
    """Read what `save_samples` wrote, of at most `most_cells` each. Raises MapFileError."""
    with npz_file(path, 'an NPZ with map samples', MapFileError) as held:
        height, width = map(int, held.read('shape', Field('iu', (2,))))
        resolution, origin = held.read('resolution', NUMBER), held.read('origin', ORIGIN)
        n_cells = height * width
        if min(height, width) < 1 or n_cells > most_cells:
            raise ValueError(f'shape ({height}, {width}): expected 1 to {most_cells} cells')
        n_bytes = -(-n_cells // 8)
        touched = held.read('touched', Field('u', (n_bytes,)))
        maps = held.read('maps', Field('u', (None, n_bytes)))
        if len(maps) * n_cells > MOST_BYTES:
            raise ValueError(f'{len(maps)} maps of {n_cells} cells: more than {MOST_BYTES} bytes')
        if not maps.dtype == touched.dtype == np.uint8:
            raise ValueError(f'maps is {maps.dtype}, touched {touched.dtype}: expected uint8')
        x, y = float(origin[0]), float(origin[1])
        spec = GridSpec(float(resolution), width, height, anchor_x_m=x, anchor_y_m=y)
    cells = np.unpackbits(maps, axis=1, count=n_cells)
    known = np.unpackbits(touched, count=n_cells).astype(bool)
    return MapSamples(spec, cells.reshape(-1, height, width), known.reshape(height, width))
