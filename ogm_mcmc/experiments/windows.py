"""Maps of one lattice cut and filled up to the same window, to compare them cell by cell."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.geometry import CellBox, GridMap
from ogm_mcmc.mapping import MappingMethod

__all__ = ['map_in', 'method_in']


def map_in(grid_map: GridMap, box: CellBox) -> Float32Array:
    """Probabilities of a box of cells, nan outside of the map."""
    out: Float32Array = np.full(
        (box.row1 - box.row0, box.column1 - box.column0), np.nan, np.float32
    )
    both = box.intersection(grid_map.spec.box)
    if not both.empty:
        target = grid_map.spec.windowed(box).slices(both)
        out[target] = grid_map.probability[grid_map.spec.slices(both)]
    return out


def method_in(method: MappingMethod, box: CellBox) -> Float32Array:
    """Probabilities of a box of cells as a method has them, nan outside of its map."""
    spec = method.spec
    return map_in(GridMap(spec, method.probabilities(spec.box)), box)
