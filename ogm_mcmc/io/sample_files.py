"""Whole maps drawn from the posterior, one bit a cell.

NPZ: `maps` (S, ceil(H W / 8)) uint8, each row the cells of one map as `numpy.packbits` packs
them, row-major from the lower left, 1 occupied; `touched` (ceil(H W / 8),) uint8, packed alike,
1 where a ray came: all other cells are free in every map and say nothing; `shape` (H, W),
`resolution`, `origin` and `settings` as in a map's NPZ; `thin`, sweeps between maps of one chain.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from ogm_mcmc.arrays import BoolArray, Float32Array, UInt8Array
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_files import replacing

__all__ = ['MapSamples', 'load_samples', 'save_samples']


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


def load_samples(path: Path) -> MapSamples:
    """Read what `save_samples` wrote. Raises MapFileError."""
    try:
        with np.load(path) as data:
            height, width = map(int, data['shape'])
            n_cells = height * width
            maps = np.unpackbits(data['maps'], axis=1, count=n_cells)
            touched = np.unpackbits(data['touched'], count=n_cells).astype(bool)
            x, y = map(float, data['origin'][:2])
            spec = GridSpec(float(data['resolution']), width, height, anchor_x_m=x, anchor_y_m=y)
            return MapSamples(
                spec, maps.reshape(-1, height, width), touched.reshape(height, width)
            )
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        reason = ' '.join(str(error).split())
        raise MapFileError(f'{path}: expected an NPZ with map samples ({reason})') from error
