"""Maps that go with their scans when these are placed anew, so that chains start warm."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan

__all__ = ['cells_before', 'warped']

BLOCK_CELLS = 16
"""Cells of a block go with the same scan."""

MOST_SCANS = 2000
"""More are thinned out: the next one is near."""


def warped(grid: GridMap, before: Int64Array, spec: GridSpec) -> GridMap:
    """Return a map on `spec` whose cells are those of `grid` at `before` (see `cells_before`)."""
    values = grid.probability.reshape(-1)[np.maximum(before, 0)]
    return GridMap(spec, np.where(before >= 0, values, np.float32(np.nan)))


def cells_before(
    old: GridSpec, new: GridSpec, taken: Sequence[PlacedScan], placed: Sequence[PlacedScan]
) -> Int64Array | None:
    """Return (height, width) where in `old` each cell of `new` was, -1: outside.

    A cell goes with the nearest scan that is in both lists (the same one, at another pose). None
    when no scan was placed anew: nothing moved.
    """
    by_scan = {id(one.scan): one for one in taken}
    pairs = [(by_scan[id(one.scan)], one) for one in placed if id(one.scan) in by_scan]
    if all(a.pose == b.pose for a, b in pairs):
        return None
    pairs = pairs[:: max(1, math.ceil(len(pairs) / MOST_SCANS))]
    before = np.full((new.height, new.width), -1, np.int64)
    here = np.array([(b.pose.x_m, b.pose.y_m) for _, b in pairs])
    moves = np.array([_move(a, b) for a, b in pairs])
    x = new.origin_x_m + (np.arange(new.width) + 0.5) * new.resolution_m
    for row in range(0, new.height, BLOCK_CELLS):
        y = (
            new.origin_y_m
            + (np.arange(row, min(row + BLOCK_CELLS, new.height)) + 0.5) * new.resolution_m
        )
        centres = x[min(BLOCK_CELLS // 2, new.width - 1) :: BLOCK_CELLS]
        distance = np.hypot(here[:, :1] - centres, here[:, 1:] - y[y.size // 2])
        nearest = np.repeat(distance.argmin(axis=0), BLOCK_CELLS)
        nearest = np.pad(nearest, (0, max(0, new.width - nearest.size)), mode='edge')[: new.width]
        turn, shift_x, shift_y = moves[nearest].T
        was_x = np.cos(turn) * x - np.sin(turn) * y[:, None] + shift_x
        was_y = np.sin(turn) * x + np.cos(turn) * y[:, None] + shift_y
        before[row : row + BLOCK_CELLS] = _indices(old, was_x, was_y)
    return before


def _move(old: PlacedScan, new: PlacedScan) -> tuple[float, float, float]:
    """Return turn, x and y of old o new^-1: from where things are to where they were."""
    step = old.pose.compose(new.pose.inverse())
    return step.yaw_rad, step.x_m, step.y_m


def _indices(spec: GridSpec, x: Float64Array, y: Float64Array) -> Int64Array:
    column = np.floor((x - spec.origin_x_m) / spec.resolution_m)
    row = np.floor((y - spec.origin_y_m) / spec.resolution_m)
    inside = (column >= 0) & (column < spec.width) & (row >= 0) & (row < spec.height)
    index: Int64Array = np.where(inside, row * spec.width + column, -1.0).astype(np.int64)
    return index
