"""Scans that lead too far from where most are for one map to hold them all.

A localizer that jumps once puts a scan hundreds of metres away. The live map that chains begin at
is dense, so such a scan would keep all the others from being sampled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox
from ogm_mcmc.mapping.log_odds_grid import too_large

__all__ = ['around_most', 'too_far_apart']

MOST_CELLS = MapperConfig().max_cells


def too_far_apart(box: CellBox) -> str:
    """Return why no map holds a box of cells, empty where one does."""
    return too_large(box, MOST_CELLS)


def around_most(boxes: Sequence[CellBox]) -> list[int]:
    """Return which boxes one map holds, those nearest to the median first; of two, the later."""
    corners = np.array(boxes, np.float64).reshape(-1, 4)
    full = np.flatnonzero([not box.empty for box in boxes])
    middles = 0.5 * (corners[:, :2] + corners[:, 2:])
    away = np.zeros(len(boxes))
    if full.size:
        away[full] = np.abs(middles[full] - np.median(middles[full], axis=0)).max(axis=1)
    kept, around = [], CellBox(0, 0, 0, 0)
    for index in sorted(range(len(boxes)), key=lambda i: (away[i], -i)):
        wider = around.union(boxes[index])
        if not too_far_apart(wider):
            kept.append(index)
            around = wider
    return sorted(kept)
