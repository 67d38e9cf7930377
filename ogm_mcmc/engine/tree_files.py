"""Read adaptive maps from disk: every leaf, and the settings that made it, as NPZ.

Arrays `level`, `column`, `row` (lower left cell on the lattice of `resolution`), `log_odds`
(nats, nan where never measured), `hits`, `misses`, one entry per leaf; `settings` as YAML text,
with dotted names. How the tree was stored in memory leaves no trace. `io.map_files.write_tables`
writes it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ogm_mcmc.config import MapperConfig, build
from ogm_mcmc.errors import ConfigError, GridError, MapFileError
from ogm_mcmc.files.npz_files import TEXT, Field, npz_file
from ogm_mcmc.files.yaml_files import parse_yaml
from ogm_mcmc.mapping.adaptive import AdaptiveMapper
from ogm_mcmc.mapping.quadtree_arrays import Leaves

__all__ = ['load_tree']

TYPES = {
    'level': np.dtype(np.uint8),
    'column': np.dtype(np.int64),
    'row': np.dtype(np.int64),
    'log_odds': np.dtype(np.float32),
    'hits': np.dtype(np.float32),
    'misses': np.dtype(np.float32),
}

ANY_LENGTH = Field('fiu', (None,))
FURTHEST = 2.0**53


def load_tree(path: Path) -> AdaptiveMapper:
    """Return the map as it was when it was saved, ready for more scans.

    Draws from covariances start again at the seed. Raises MapFileError.
    """
    what = f'an adaptive map, an NPZ with {", ".join(Leaves._fields)} and settings'
    with npz_file(path, what, MapFileError) as held:
        settings = parse_yaml(str(held.read('settings', TEXT)))
        if not isinstance(settings, dict):
            raise ValueError('settings: expected names and values')
        arrays = {name: held.read(name, ANY_LENGTH) for name in Leaves._fields}
    try:
        config = build(MapperConfig, settings)
    except ConfigError as error:
        raise MapFileError(f'{path}: settings: {error}') from error
    if config.method != 'adaptive':
        raise MapFileError(f'{path}: method is {config.method!r}: expected adaptive')
    shape = arrays['level'].shape
    for name, kind in TYPES.items():
        array = arrays[name]
        if array.dtype != kind or array.shape != shape or array.ndim != 1:
            raise MapFileError(
                f'{path}: {name} is {array.dtype} {array.shape}: expected {kind}, one per leaf'
            )
    for name in ('column', 'row'):
        if (abs(arrays[name].astype(np.float64)) > FURTHEST).any():
            raise MapFileError(f'{path}: {name}: expected cells within {FURTHEST:g} of the origin')
    try:
        method = AdaptiveMapper(config)
        method.tree.plant(Leaves(**arrays))
    except (ConfigError, GridError) as error:
        raise MapFileError(f'{path}: {error}') from error
    return method
