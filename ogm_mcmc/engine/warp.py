"""Maps that go with their scans when these are placed anew, so that chains start warm."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ogm_mcmc.arrays import AnyArray, UInt8Array
from ogm_mcmc.engine.warp_kernels import find_before, take_before
from ogm_mcmc.geometry import GridSpec, PlacedScan

__all__ = ['cells_before', 'laid_on', 'warped']

BLOCK_CELLS = 16
"""Cells of a block go with the same scan."""

MOST_SCANS = 2000
"""More are thinned out: the next one is near."""


def warped(cells: UInt8Array, before: AnyArray, elsewhere: int) -> UInt8Array:
    """Return a map (K,) whose cells are those at `before` (see `cells_before`) of an old one."""
    found = np.empty(before.size, np.uint8)
    take_before(before, cells, np.uint8(elsewhere), found)
    return found


def laid_on(cells: UInt8Array, old: GridSpec, new: GridSpec, elsewhere: int) -> UInt8Array:
    """Return a map (K,) of a window on another window of the same lattice."""
    if old == new:
        return cells.copy()
    found = np.full((new.height, new.width), elsewhere, np.uint8)
    common = old.box.intersection(new.box)
    if not common.empty:
        found[new.slices(common)] = cells.reshape(old.height, old.width)[old.slices(common)]
    return found.reshape(-1)


def cells_before(
    old: GridSpec, new: GridSpec, taken: Sequence[PlacedScan], placed: Sequence[PlacedScan]
) -> AnyArray | None:
    """Return (height, width) int32 where in `old` each cell of `new` was, -1: outside.

    A cell goes with the nearest scan that is in both lists (the same one, at another pose). None
    when no scan was placed anew: nothing moved.
    """
    by_scan = {id(one.scan): one for one in taken}
    pairs = [(by_scan[id(one.scan)], one) for one in placed if id(one.scan) in by_scan]
    if all(a.pose == b.pose for a, b in pairs):
        return None
    pairs = pairs[:: max(1, math.ceil(len(pairs) / MOST_SCANS))]
    here = np.array([(b.pose.x_m, b.pose.y_m) for _, b in pairs])
    moves = np.array([_move(a, b) for a, b in pairs])
    before = np.empty((new.height, new.width), np.int32)
    find_before(_place(old), _place(new), here, moves, BLOCK_CELLS, before)
    return before


def _place(spec: GridSpec) -> tuple[float, float, float, float, float]:
    size = float(spec.width), float(spec.height)
    return spec.origin_x_m, spec.origin_y_m, spec.resolution_m, *size


def _move(old: PlacedScan, new: PlacedScan) -> tuple[float, float, float]:
    """Return turn, x and y of old o new^-1: from where things are to where they were."""
    step = old.pose.compose(new.pose.inverse())
    return step.yaw_rad, step.x_m, step.y_m
