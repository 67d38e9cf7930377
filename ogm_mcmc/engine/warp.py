"""What of a map stays where scans are placed anew, so that chains start warm there.

Design note: maps do not go along with scans
--------------------------------------------
Maps of chains used to be carried along, each cell with the nearest scan. But a wall is seen from
many places, which move differently by centimetres, and rays end in front of a wall that is a cell
off. Intel, 910 scans moved by up to 5.9 m, readings up to 20 m: log-likelihood of the maps (in the
end 169 000), and mean difference of what the later half of the sweeps says from what 100 sweeps
say in the end, on the 217 600 informed cells; processor time of two chains without the index:

====================================  ============  ==============  ===============  ===========
start                                 at once       after 5 sweeps  after 16         s
====================================  ============  ==============  ===============  ===========
carried along                         -398 000      -10 200, .0204  80 000, .0136    1.0, 3.3
carried along, then forgotten         129 000       162 700, .0092  167 300, .0051   2.4, 4.4
the live map (both chains)            95 000        167 000, .0071  168 000, .0047   0.8, 2.8
**new starts, then forgotten**        156 000       167 200, .0074  168 400, .0045   2.2, 4.2
====================================  ============  ==============  ===============  ===========

The live map itself is .0176 off. So chains begin anew where scans moved, as at first, and go on
elsewhere; from the live map alone they would be as good sooner, but would agree by birth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ogm_mcmc.arrays import BoolArray, UInt8Array
from ogm_mcmc.engine.corrections import MOVED_CELLS, furthest_way
from ogm_mcmc.engine.warp_kernels import mark_moved
from ogm_mcmc.engine.window_changes import taken_before
from ogm_mcmc.geometry import GridSpec, PlacedScan

__all__ = ['laid_on', 'moved_cells']

BLOCK_CELLS = 16
"""Cells of a block go with the same place."""

MOST_PLACES = 2000
"""More are thinned out: the next one is near."""


def laid_on(cells: UInt8Array, old: GridSpec, new: GridSpec, elsewhere: int) -> UInt8Array:
    """Return a map (K,) of a window on another window of the same lattice."""
    if old == new:
        return cells.copy()
    found = np.full((new.height, new.width), elsewhere, np.uint8)
    common = old.box.intersection(new.box)
    if not common.empty:
        found[new.slices(common)] = cells.reshape(old.height, old.width)[old.slices(common)]
    return found.reshape(-1)


def moved_cells(
    spec: GridSpec, taken: Sequence[PlacedScan], placed: Sequence[PlacedScan]
) -> BoolArray | None:
    """Return which cells (K,) lie where scans were placed anew; None when none was.

    Cells go with the nearest place of a scan that is in both lists (the same one, at another
    pose): those where a scan came to, and those where it was before. No reading by more than a
    quarter of a cell, `MOVED_CELLS`, is no move: joint poses differ a little at every look.
    """
    olds = taken_before(taken, placed)
    pairs = [(old, new) for old, new in zip(olds, placed, strict=True) if old is not None]
    nearly = MOVED_CELLS * spec.resolution_m
    moved = [old.pose != new.pose and furthest_way(old, new.pose) > nearly for old, new in pairs]
    if not any(moved):
        return None
    places = [(new.pose, anew) for (_, new), anew in zip(pairs, moved, strict=True)]
    places += [(old.pose, True) for (old, _), anew in zip(pairs, moved, strict=True) if anew]
    places = places[:: max(1, math.ceil(len(places) / MOST_PLACES))]
    here = np.array([(pose.x_m, pose.y_m) for pose, _ in places])
    flags = np.array([anew for _, anew in places])
    found = np.empty((spec.height, spec.width), np.uint8)
    corner = spec.origin_x_m, spec.origin_y_m
    mark_moved(corner, spec.resolution_m, here, flags, BLOCK_CELLS, found)
    return found.reshape(-1).view(np.bool_)
