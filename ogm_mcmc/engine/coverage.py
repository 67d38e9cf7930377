"""Which scans cover a building: so many of every place and heading, and no more.

Places and headings are cells of a lattice (the heading does not matter where a sensor looks all
around). While there is room everything is kept. When the window is full it is thinned: of every
cell at most so many scans stay, spread over the time they were taken, so many as the limit
allows. If that were fewer than a few the cells become twice as large: a window that is too small
for a building holds it more and more coarsely, but all of it. From then on a scan of a cell that
has its share does not come in: nothing is computed of it, and a robot that stands still costs
nothing. Only the first one of a new visit does, in place of the oldest: the window shows the
building as it is now.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence

import numpy as np

from ogm_mcmc.arrays import Int64Array
from ogm_mcmc.geometry import PlacedScan

__all__ = ['Coverage']

FINEST_M = 0.1
FINEST_RAD = 0.1
COARSEST = 10  # doublings

# Of a cell, before cells are doubled.
ENOUGH = 3

# A sensor that sees more than this sees the same whatever its heading.
ALL_AROUND_RAD = math.radians(330.0)

VISIT_NS = 60_000_000_000
"""A cell that was left alone for so long is visited anew."""


class Coverage:
    """How many scans of each cell are kept, and whether one more may come.

    `most` is how many each cell may have, None while there is room; `doublings` how often the
    cells became larger.
    """

    def __init__(self) -> None:
        self.doublings = 0
        self.most: int | None = None
        self._counts: Counter[Hashable] = Counter()
        self._newest_ns: dict[Hashable, int] = {}

    def copy(self) -> Coverage:
        """Return the same counts, which go their own way from here."""
        copy = Coverage()
        copy.doublings, copy.most = self.doublings, self.most
        copy._counts, copy._newest_ns = self._counts.copy(), self._newest_ns.copy()
        return copy

    @property
    def cell_m(self) -> float:
        """Side of a cell, m."""
        return float(FINEST_M * 2**self.doublings)

    @property
    def cell_rad(self) -> float:
        """Headings that a cell spans, rad."""
        return float(min(FINEST_RAD * 2**self.doublings, 2.0 * math.pi))

    def cell_of(self, placed: PlacedScan) -> Hashable:
        """Return the place and heading of a scan, of each sensor by itself."""
        scan, pose = placed.scan, placed.pose
        seen_rad = abs(scan.angle_increment_rad) * scan.ranges_m.size
        heading = 0
        if seen_rad < ALL_AROUND_RAD:
            heading = math.floor(pose.yaw_rad % (2.0 * math.pi) / self.cell_rad)
        column, row = math.floor(pose.x_m / self.cell_m), math.floor(pose.y_m / self.cell_m)
        return scan.frame_id, column, row, heading

    def add(self, placed: PlacedScan) -> None:
        """Count a scan that is kept."""
        cell = self.cell_of(placed)
        self._counts[cell] += 1
        self._newest_ns[cell] = placed.scan.stamp_ns

    def remove(self, placed: PlacedScan) -> None:
        """Count a scan no more."""
        cell = self.cell_of(placed)
        self._counts[cell] -= 1
        if self._counts[cell] <= 0:
            del self._counts[cell], self._newest_ns[cell]

    def is_full(self, placed: PlacedScan) -> bool:
        """Whether the cell of a scan has its share."""
        return self.most is not None and self._counts[self.cell_of(placed)] >= self.most

    def is_visit(self, placed: PlacedScan) -> bool:
        """Whether a cell was left alone before this scan."""
        newest_ns = self._newest_ns.get(self.cell_of(placed))
        return newest_ns is None or placed.scan.stamp_ns - newest_ns >= VISIT_NS

    def count_anew(self, kept: Iterable[PlacedScan]) -> None:
        """Count what is kept now."""
        self._counts.clear()
        self._newest_ns.clear()
        for placed in kept:
            self.add(placed)

    def thinned(self, kept: Sequence[PlacedScan], count: int) -> list[int]:
        """Choose at most `count` of the scans (at least one), in their order; return which.

        Sets `most`, and doubles the cells where that is needed.
        """
        while True:
            cells: dict[Hashable, list[int]] = {}
            for index, placed in enumerate(kept):
                cells.setdefault(self.cell_of(placed), []).append(index)
            most = _share(np.array([len(held) for held in cells.values()]), count)
            if most >= ENOUGH or self.doublings == COARSEST:
                break
            self.doublings += 1
        self.most = max(most, 1)
        chosen = sorted(index for held in cells.values() for index in _spread(held, self.most))
        return chosen[-max(count, 1) :]  # more cells than scans: the latest ones

    def forget(self) -> None:
        """Begin anew: there is room."""
        self.doublings, self.most = 0, None


def _share(counts: Int64Array, total: int) -> int:
    """Return the most that each cell may have so that all together have at most `total`."""
    low, high = 0, int(counts.max(initial=1))
    while low < high:
        middle = (low + high + 1) // 2
        if int(np.minimum(counts, middle).sum()) <= total:
            low = middle
        else:
            high = middle - 1
    return low


def _spread(held: list[int], most: int) -> list[int]:
    """Return at most so many of a list, evenly spread; the last one always."""
    if len(held) <= most:
        return held
    if most == 1:
        return held[-1:]
    return [held[round(k * (len(held) - 1) / (most - 1))] for k in range(most)]
