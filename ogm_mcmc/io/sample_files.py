"""Whole maps drawn from the posterior, one bit a cell.

NPZ: `maps` (S, ceil(H W / 8)) uint8, each row the cells of one map as `numpy.packbits` packs
them, row-major from the lower left, 1 occupied; `touched` (ceil(H W / 8),) uint8, packed alike,
1 where a ray came: all other cells are free in every map and say nothing; `known`, alike, 1 where
data moved the cell, elsewhere the maps draw what the prior says; `prior`, the probability of an
unknown cell; `shape` (H, W), `resolution`, `origin` and `settings` as in a map's NPZ; `thin`,
sweeps between maps of one chain. Files of before have neither `known` nor `prior`.
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
    """Maps (S, H, W) uint8 of 0 and 1 on a grid.

    touched  (H, W): cells that a ray came to
    known    (H, W): those of them that data moved; where a file does not say, all of them
    prior    probability that an unknown cell is occupied; None where a file does not say
    """

    spec: GridSpec
    maps: UInt8Array
    touched: BoolArray
    known: BoolArray
    prior: float | None = None

    def grid_maps(self) -> Iterator[GridMap]:
        """Yield the maps one by one, nan where no ray came."""
        for cells in self.maps:
            probability: Float32Array = np.where(self.touched, cells, np.nan).astype(np.float32)
            yield GridMap(self.spec, probability)


def save_samples(samples: MapSamples, path: Path, thin: int, settings: dict[str, Any]) -> Path:
    """Write maps, a bit a cell. Raises OutputError."""
    spec = samples.spec
    perhaps: dict[str, Any] = {} if samples.prior is None else {'prior': samples.prior}
    with replacing(path) as temporary, temporary.open('wb') as stream:
        np.savez_compressed(
            stream,
            maps=np.packbits(samples.maps.reshape(len(samples.maps), -1), axis=1),
            touched=np.packbits(samples.touched),
            known=np.packbits(samples.known),
            **perhaps,
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
        a_bit_each = Field('u', (n_bytes,))
        touched = held.read('touched', a_bit_each)
        known = held.read('known', a_bit_each) if 'known' in held.names else touched
        maps = held.read('maps', Field('u', (None, n_bytes)))
        if len(maps) * n_cells > MOST_BYTES:
            raise ValueError(f'{len(maps)} maps of {n_cells} cells: more than {MOST_BYTES} bytes')
        for name, bits in (('maps', maps), ('touched', touched), ('known', known)):
            if bits.dtype != np.uint8:
                raise ValueError(f'{name} is {bits.dtype}: expected uint8')
        prior = float(held.read('prior', NUMBER)) if 'prior' in held.names else None
        if prior is not None and not 0.0 <= prior <= 1.0:
            raise ValueError(f'prior is {prior}: expected 0 to 1')
        x, y = float(origin[0]), float(origin[1])
        spec = GridSpec(float(resolution), width, height, anchor_x_m=x, anchor_y_m=y)
    cells = np.unpackbits(maps, axis=1, count=n_cells).reshape(-1, height, width)
    came, moved = (
        np.unpackbits(bits, count=n_cells).astype(bool).reshape(height, width)
        for bits in (touched, known)
    )
    return MapSamples(spec, cells, came, moved, prior)
