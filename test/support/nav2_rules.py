"""How Nav2 reads an OccupancyGrid, written anew from its published behaviour.

static layer  with its defaults (`track_unknown_space`, `trinary_costmap`, `lethal_cost_threshold`
              100): -1 is unknown, 100 and more lethal, everything else free
amcl          100 is occupied, 0 is free, everything else unknown
"""

from __future__ import annotations

import numpy as np

__all__ = ['FREE', 'UNKNOWN', 'WALL', 'amcl_cells', 'static_layer_cells']

UNKNOWN, FREE, WALL = -1, 0, 1


def static_layer_cells(values: np.ndarray, lethal: int = 100) -> np.ndarray:
    """Return WALL, FREE or UNKNOWN of each value as the static layer takes it."""
    cells = np.full(values.shape, FREE, int)
    cells[values == -1] = UNKNOWN
    cells[values >= lethal] = WALL
    return cells


def amcl_cells(values: np.ndarray) -> np.ndarray:
    """Return WALL, FREE or UNKNOWN of each value as amcl takes it."""
    cells = np.full(values.shape, UNKNOWN, int)
    cells[values == 0] = FREE
    cells[values == 100] = WALL
    return cells
