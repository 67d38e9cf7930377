"""Whether beams without a return may clear: how many of them cross what other beams hit.

A beam without a return says that there is nothing up to range_max (REP 117), or that its light
came back too weak: from glass, dark or distant walls. The recording tells which: in the first case
such beams go where nothing is, in the second straight through walls that other beams see.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int64Array
from ogm_mcmc.geometry import PlacedScan

__all__ = ['NoReturnWatch', 'NoReturns']

# Scans looked at, spread over all of them, and beams without a return, spread over those.
KEPT = 100
MOST_BEAMS = 1500

# A cell counts as hit when so many beams of other scans ended in it.
HITS = 2

# From this share on such beams are taken to have lost what they met; fewer than so many beams
# tell nothing.
MOST = 0.5
FEWEST_BEAMS = 20

# Cells are named by one number.
ROWS = 2**31


class NoReturns(NamedTuple):
    """Beams without a return that were looked at, and how many of them cross cells hit."""

    beams: int
    crossing: int

    @property
    def share(self) -> float:
        """Share of the beams that cross what others hit; 0 without any."""
        return self.crossing / self.beams if self.beams else 0.0

    @property
    def doubtful(self) -> bool:
        """Whether most of them do."""
        return self.beams >= FEWEST_BEAMS and self.share > MOST

    def __str__(self) -> str:
        """Return one line for the user."""
        return (
            f'{self.share:.0%} of the beams without a return cross cells that other beams hit: '
            'they clear walls; no_return: ignore keeps those'
        )


class NoReturnWatch:
    """Sees scans go by, keeps some, and judges at the end; `reach_m` bounds beams, 0 does not."""

    def __init__(self, resolution_m: float, reach_m: float = 0.0) -> None:
        self.resolution_m = resolution_m
        self.reach_m = reach_m
        self._kept: list[PlacedScan] = []
        self._every = 1
        self._seen = 0

    def see(self, placed: PlacedScan) -> None:
        """Take note of a scan."""
        if self._seen % self._every == 0:
            self._kept.append(placed)
            if len(self._kept) >= 2 * KEPT:
                del self._kept[1::2]
                self._every *= 2
        self._seen += 1

    def judge(self) -> NoReturns:
        """Return what the scans kept say."""
        hit = [self._hit_cells(placed) for placed in self._kept]
        every = np.concatenate([np.zeros(0, np.int64), *hit])
        cells, counts = np.unique(every, return_counts=True)
        beams = crossing = 0
        for own, placed in zip(hit, self._kept, strict=True):
            by_others = counts - np.isin(cells, own, assume_unique=True)
            crossed = self._crossed_cells(placed)
            beams += crossed.shape[0]
            crossing += int(np.isin(crossed, cells[by_others >= HITS]).any(axis=1).sum())
        return NoReturns(beams, crossing)

    def _hit_cells(self, placed: PlacedScan) -> Int64Array:
        scan = placed.scan
        ranges = scan.ranges_m.astype(np.float64)
        hit = (ranges >= scan.range_min_m) & (ranges <= scan.range_max_m)
        ends = _ends(placed, hit, ranges[hit])
        return np.unique(self._names(ends))

    def _crossed_cells(self, placed: PlacedScan) -> Int64Array:
        """Return the cells along some beams without a return, a row for each."""
        scan = placed.scan
        reach = scan.range_max_m if self.reach_m == 0.0 else min(scan.range_max_m, self.reach_m)
        missing = np.flatnonzero(scan.ranges_m == np.inf)
        if not missing.size or not math.isfinite(reach):
            return np.zeros((0, 1), np.int64)
        most = max(1, MOST_BEAMS // len(self._kept))
        some = missing[:: -(-missing.size // most)]
        along = np.arange(self.resolution_m, reach, self.resolution_m)
        ends = _ends(placed, np.repeat(some, along.size), np.tile(along, some.size))
        return self._names(ends).reshape(some.size, along.size)

    def _names(self, points: Float64Array) -> Int64Array:
        column, row = np.floor(points / self.resolution_m).astype(np.int64)
        return np.asarray(column * ROWS + row, np.int64)


def _ends(placed: PlacedScan, beams: AnyArray, lengths: Float64Array) -> Float64Array:
    """Return the points (2, N) at so many metres along beams, m."""
    angles = placed.pose.yaw_rad + placed.scan.bearings()[beams]
    return np.stack(
        (
            placed.pose.x_m + lengths * np.cos(angles),
            placed.pose.y_m + lengths * np.sin(angles),
        )
    )
