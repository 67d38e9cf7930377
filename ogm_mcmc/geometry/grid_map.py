"""A finished map: probabilities on a grid."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, Float64Array, Int8Array
from ogm_mcmc.geometry.grid_spec import CellBox, GridSpec

__all__ = ['GridMap', 'entropy_bits', 'occupancy_values', 'trinary_values']

UNKNOWN = -1


def occupancy_values(probability: Float32Array) -> Int8Array:
    """Whole percents 0..100 as in nav_msgs/OccupancyGrid; nan (never measured) becomes -1."""
    percent = np.rint(np.nan_to_num(probability * np.float32(100.0), nan=-1.0))
    values: Int8Array = percent.astype(np.int8)
    return values


def trinary_values(
    probability: Float32Array, occupied_thresh: float, free_thresh: float
) -> Int8Array:
    """100 from `occupied_thresh` on, 0 up to `free_thresh`, -1 between them and for nan."""
    values = np.full(probability.shape, UNKNOWN, np.int8)
    values[probability <= free_thresh] = 0
    values[probability >= occupied_thresh] = 100
    return values


def entropy_bits(probability: Float32Array) -> Float64Array:
    """Entropy of each cell in bits ([gibbs] section IV); nan stays nan."""
    p = probability.astype(np.float64)
    with np.errstate(divide='ignore', invalid='ignore'):
        entropy = -(p * np.log2(p) + (1.0 - p) * np.log2(1.0 - p))
    entropy[(p == 0.0) | (p == 1.0)] = 0.0
    return entropy


class GridMap(NamedTuple):
    """Where the cells lie and `probability` (height, width) float32, nan where never measured."""

    spec: GridSpec
    probability: Float32Array

    @classmethod
    def of_cells(
        cls, spec: GridSpec, cells: AnyArray, values: AnyArray, elsewhere: float = math.nan
    ) -> GridMap:
        """Return a map of values (C,) at cells (C,), counted along the rows; else `elsewhere`."""
        whole: Float32Array = np.full(spec.height * spec.width, elsewhere, np.float32)
        whole[cells] = values
        return cls(spec, whole.reshape(spec.height, spec.width))

    def windowed(self, box: CellBox) -> GridMap:
        """Return another window of the same lattice; nan where this map has no cell."""
        spec = self.spec.windowed(box)
        values: Float32Array = np.full((spec.height, spec.width), np.nan, np.float32)
        both = box.intersection(self.spec.box)
        if not both.empty:
            values[spec.slices(both)] = self.probability[self.spec.slices(both)]
        return GridMap(spec, values)

    def cropped(self) -> GridMap:
        """Return the smallest window with every measured cell (one cell if there is none)."""
        measured = np.isfinite(self.probability)
        rows = np.flatnonzero(measured.any(axis=1))
        columns = np.flatnonzero(measured.any(axis=0))
        if rows.size == 0:
            rows = columns = np.zeros(1, dtype=np.intp)
        box = CellBox(
            self.spec.column0 + int(columns[0]),
            self.spec.row0 + int(rows[0]),
            self.spec.column0 + int(columns[-1]) + 1,
            self.spec.row0 + int(rows[-1]) + 1,
        )
        inside = np.ascontiguousarray(self.probability[self.spec.slices(box)])
        return GridMap(self.spec.windowed(box), inside)
