"""How Nav2 reads an OccupancyGrid, written anew from its published behaviour (branch jazzy).

static layer  -1 (255 as an unsigned byte, `unknown_cost_value`) is unknown; with
              `track_unknown_space` false, the default of a costmap, it is free. Values from
              `lethal_cost_threshold` (100) on are lethal. All others are free, or with
              `trinary_costmap` false something between. `StaticLayer` follows a topic.
amcl          100 is occupied, 0 is free, everything else unknown.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

__all__ = ['FREE', 'UNKNOWN', 'WALL', 'StaticLayer', 'amcl_cells', 'static_layer_cells']

# Costs of a costmap.
FREE, WALL, UNKNOWN = 0, 254, 255

MOST_CELLS_A_SIDE = 32_767


def static_layer_cells(
    values: np.ndarray,
    lethal: int = 100,
    *,
    track_unknown: bool = True,
    unknown: int = 255,
    trinary: bool = True,
) -> np.ndarray:
    """Return the cost of each value: WALL, FREE, UNKNOWN, or between if it is not trinary."""
    values = values.astype(np.int8).view(np.uint8)
    between = np.zeros(values.shape) if trinary else values / lethal * WALL
    costs = np.where(values >= lethal, WALL, between).astype(np.uint8)
    costs[values == unknown] = UNKNOWN if track_unknown else FREE
    return costs


def amcl_cells(values: np.ndarray) -> np.ndarray:
    """Return WALL, FREE or UNKNOWN of each value as amcl takes it."""
    cells = np.full(values.shape, UNKNOWN, np.uint8)
    cells[values == 0] = FREE
    cells[values == 100] = WALL
    return cells


class StaticLayer:
    """A static layer that subscribes to a map and its updates; `costs` is what planners read.

    The first map counts at once. A later one is held back until the next `cycle`, and replaces
    what updates have changed meanwhile. The orientation of the origin is not looked at.
    """

    def __init__(self) -> None:
        self.costs = np.zeros((0, 0), np.uint8)
        self.refused: list[str] = []
        self._frame = ''
        self._held: tuple[np.ndarray, str] | None = None

    def take_map(self, msg: Any) -> None:
        """Take a whole map."""
        fault = _fault(msg)
        if fault:
            self.refused.append(fault)
            return
        values = np.array(msg.data, np.int8).reshape(msg.info.height, msg.info.width)
        first, self._held = not self.costs.size, (values, msg.header.frame_id)
        if first:
            self.cycle()

    def take_update(self, msg: Any) -> None:
        """Take what changed."""
        height, width = self.costs.shape
        outside = msg.y + msg.height > height or msg.x + msg.width > width
        if outside or min(msg.x, msg.y) < 0 or msg.header.frame_id != self._frame:
            self.refused.append('update')
            return
        values = np.array(msg.data, np.int8).reshape(msg.height, msg.width)
        box = slice(msg.y, msg.y + msg.height), slice(msg.x, msg.x + msg.width)
        self.costs[box] = static_layer_cells(values)

    def cycle(self) -> None:
        """Bring the costmap up to date, as it is done at its update frequency."""
        if self._held is not None:
            values, self._frame = self._held
            self.costs, self._held = static_layer_cells(values), None


def _fault(msg: Any) -> str:
    """Return why the layer refuses a map; empty if it takes it."""
    info, turn = msg.info, msg.info.origin.orientation
    numbers = [info.resolution, info.origin.position.x, info.origin.position.y]
    sides = info.width, info.height
    for wrong, what in (
        (not msg.header.frame_id, 'frame'),
        (not all(map(math.isfinite, numbers)) or info.resolution <= 1e-6, 'numbers'),
        (abs(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 - 1.0) >= 1e-4, 'orientation'),
        (min(sides) == 0 or max(sides) > MOST_CELLS_A_SIDE, 'size'),
        (len(msg.data) != info.width * info.height, 'cells'),
    ):
        if wrong:
            return what
    return ''
