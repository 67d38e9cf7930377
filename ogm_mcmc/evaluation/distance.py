"""How far walls are from where they should be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array
from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation.distance_kernels import squared_distances

__all__ = ['DistanceError', 'distance_to', 'occupied_distance_error']


class DistanceError(NamedTuple):
    """From every occupied cell of one map to the nearest of the other; nan if either has none."""

    mean: float
    rms: float
    percentile_95: float
    largest: float
    cells: int


def distance_to(cells: BoolArray) -> Float64Array:
    """Distance of every cell to the nearest of `cells` between centres, cells; inf without any."""
    squared = np.empty(cells.shape)
    squared_distances(np.ascontiguousarray(cells, np.bool_), squared)
    return np.asarray(np.sqrt(squared, out=squared), np.float64)


def occupied_distance_error(
    of: BoolArray, to: BoolArray, resolution_m: float = 1.0
) -> DistanceError:
    """Distances from the occupied cells `of` one map `to` those of another, m.

    Of the estimate to the truth it tells how far off walls are drawn; the other way round, how
    far the nearest drawn wall is from each true one, which missing walls make large.
    """
    if of.shape != to.shape:
        raise GridError(f'maps of {of.shape} and {to.shape}: expected the same cells')
    if not of.any() or not to.any():
        nan = float('nan')
        return DistanceError(nan, nan, nan, nan, int(of.sum()))
    # The root of what is asked for alone: a whole map more would be the largest of all arrays.
    squared = np.empty(to.shape)
    squared_distances(np.ascontiguousarray(to, np.bool_), squared)
    distances = resolution_m * np.sqrt(squared[of])
    return DistanceError(
        float(distances.mean()),
        float(np.sqrt(np.mean(distances**2))),
        float(np.percentile(distances, 95.0)),
        float(distances.max()),
        int(distances.size),
    )
