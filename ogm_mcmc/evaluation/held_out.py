"""Which beams of a recording judge a map, and how sure the mean of what they say is.

Design note: beams that end outside of the map
----------------------------------------------
A map file ends where nothing more was measured, so a held-out beam may end beyond it. Cells out
there are cells that were never measured, as those inside: they are occupied with the same
probability (`unknown`). So every map is judged by the same beams, whatever its extent, and one
that covers less pays for it. `exclude` leaves such beams out instead: right where all maps have
one window that was chosen beforehand and cuts through the building, as in [patch] section IV.

Design note: the standard error
-------------------------------
Beams of one scan share cells and the error of its pose, so scans are what is independent, and
they have different numbers of beams: the mean per beam is a ratio of two sums over scans. Scans
taken close to each other are not quite independent either; the true error is rather larger.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D, Scan
from ogm_mcmc.geometry.rays import usable_range

__all__ = [
    'LEAVING',
    'HeldOutBeams',
    'Ratio',
    'cells_of_ends',
    'held_out_beams',
    'ratio_of_sums',
    'seen_from',
    'without_beams_that_leave',
]

LEAVING = ('unknown', 'exclude')


class Ratio(NamedTuple):
    """A ratio of two sums and its standard error; nan where there is too little for it."""

    value: float
    standard_error: float


def ratio_of_sums(sums: AnyArray, counts: AnyArray) -> Ratio:
    """Estimate the mean per member of groups (S,), of each the sum and the number of members.

    R = sum s / sum n; its variance S / (S - 1) sum (s - R n)^2 / (sum n)^2 takes the groups as
    independent draws.
    """
    s, n = np.asarray(sums, np.float64), np.asarray(counts, np.float64)
    total = float(n.sum())
    if total == 0.0:
        return Ratio(math.nan, math.nan)
    ratio = float(s.sum()) / total
    if s.size < 2:
        return Ratio(ratio, math.nan)
    spread = math.sqrt(s.size / (s.size - 1.0) * float(((s - ratio * n) ** 2).sum()))
    return Ratio(ratio, spread / total)


class HeldOutBeams(NamedTuple):
    """Scans that judge a map, at the means of their beliefs, and facts about their N beams.

    Of every informative beam, in order: `scan` (N,) int64, which of the scans it belongs to;
    `returned` (N,), something was measured; `cell` (N,) int64, the cell of the map it ends in,
    counted along the rows, -1 outside. `left_out`: how many do not count because they end there.
    """

    placed: list[PlacedScan]
    scan: Int64Array
    returned: BoolArray
    cell: Int64Array
    left_out: int

    @property
    def leaving(self) -> BoolArray:
        """Which beams (N,) end outside of the map."""
        return np.asarray(self.cell < 0, np.bool_)

    def seen_from(self, frame: Pose2D, spec: GridSpec) -> HeldOutBeams:
        """Return the same beams in a frame that lies in theirs, where a map has these cells."""
        placed = seen_from(frame, self.placed)
        return self._replace(placed=placed, cell=cells_of_ends(placed, spec))

    def per_scan(self, values: AnyArray) -> Float64Array:
        """Mean of values (N,) over the beams of each scan (S,)."""
        size = len(self.placed)
        counts = np.bincount(self.scan, minlength=size)
        return np.asarray(np.bincount(self.scan, values, minlength=size) / counts, np.float64)

    def per_cell(self, values: AnyArray, spec: GridSpec) -> Float64Array:
        """Mean of values (N,) over the beams that returned from each cell (H, W); nan: none."""
        chosen = self.returned & ~self.leaving
        cell, size = self.cell[chosen], spec.height * spec.width
        counts = np.bincount(cell, minlength=size)
        sums = np.bincount(cell, np.asarray(values)[chosen], minlength=size)
        means = np.full(size, np.nan)
        np.divide(sums, counts, out=means, where=counts > 0)
        return means.reshape(spec.height, spec.width)

    def mean(self, values: AnyArray, of: BoolArray | None = None) -> Ratio:
        """Mean per beam of values (N,), of all beams or of some; scans are independent."""
        chosen = np.ones(self.scan.size, np.bool_) if of is None else of
        scan = self.scan[chosen]
        counts = np.bincount(scan, minlength=len(self.placed))
        sums = np.bincount(scan, np.asarray(values)[chosen], minlength=len(self.placed))
        there = counts > 0
        return ratio_of_sums(sums[there], counts[there])


def held_out_beams(
    placed: Iterable[PlacedScan],
    spec: GridSpec,
    *,
    max_range_m: float = 0.0,
    no_return: str = 'clear',
    leaving: str = 'unknown',
    frame: Pose2D | None = None,
) -> HeldOutBeams:
    """Choose the beams that judge a map, whose `frame` lies in that of the scans, or is it.

    `max_range_m` above 0 limits how far beams are used: longer readings say that nothing is up
    to there. `no_return` ignore: +inf says nothing. `leaving` exclude: beams that end outside of
    the map do not count; one without a return ends at its range. Scans without a beam that
    counts are dropped. Raises GridError for a range of 2**18 cells or more.
    """
    require(leaving in LEAVING, 'leaving', leaving, f'one of {", ".join(LEAVING)}')
    used: list[PlacedScan] = []
    scans, returned, cells, left_out = [], [], [], 0
    back = None if frame is None or frame == Pose2D() else frame.inverse()
    for whole, belief in placed:
        scan = _limited(whole, usable_range(whole, spec, max_range_m), no_return)
        sensor = belief.mean if back is None else back.compose(belief.mean)
        if leaving == 'exclude':
            before = int(scan.informative().sum())
            scan = _without_leaving(scan, sensor, spec)
            left_out += before - int(scan.informative().sum())
        beams = scan.informative()
        if not beams.any():
            continue
        scans.append(np.full(int(beams.sum()), len(used), np.int64))
        returned.append(np.isfinite(scan.ranges_m[beams]))
        cells.append(_end_cells(scan, sensor, spec)[beams])
        used.append(PlacedScan(scan, belief))
    if not used:
        none = np.zeros(0, np.int64)
        return HeldOutBeams([], none, np.zeros(0, np.bool_), none, left_out)
    return HeldOutBeams(
        used, np.concatenate(scans), np.concatenate(returned), np.concatenate(cells), left_out
    )


def seen_from(frame: Pose2D, placed: Iterable[PlacedScan]) -> list[PlacedScan]:
    """Return scans, at the means of their beliefs, in a frame that lies in theirs."""
    if frame == Pose2D():
        return list(placed)
    back = frame.inverse()
    return [PlacedScan.at(scan, back.compose(belief.mean)) for scan, belief in placed]


def cells_of_ends(placed: Iterable[PlacedScan], spec: GridSpec) -> Int64Array:
    """Return the cells of a grid (N,) that informative beams end in, as `HeldOutBeams.cell`."""
    cells = [_end_cells(scan, belief.mean, spec)[scan.informative()] for scan, belief in placed]
    return np.concatenate([np.empty(0, np.int64), *cells])


def without_beams_that_leave(placed: Iterable[PlacedScan], spec: GridSpec) -> list[PlacedScan]:
    """Return the scans with those readings made invalid that end outside of a grid."""
    return [
        PlacedScan(_without_leaving(scan, belief.mean, spec), belief) for scan, belief in placed
    ]


def _without_leaving(scan: Scan, sensor: Pose2D, spec: GridSpec) -> Scan:
    return _invalid(scan, _end_cells(scan, sensor, spec) < 0)


def _end_cells(scan: Scan, sensor: Pose2D, spec: GridSpec) -> Int64Array:
    """Return the cell (B,) every beam ends in, along the rows; -1 outside, and for nan and -inf.

    A beam without a return ends at its range.
    """
    ranges = scan.ranges_m.astype(np.float64)
    lengths = np.where(ranges == np.inf, scan.range_max_m, ranges)
    angles = sensor.yaw_rad + scan.bearings()
    with np.errstate(invalid='ignore'):
        column = (sensor.x_m + lengths * np.cos(angles) - spec.origin_x_m) / spec.resolution_m
        row = (sensor.y_m + lengths * np.sin(angles) - spec.origin_y_m) / spec.resolution_m
    inside = (column >= 0.0) & (column < spec.width) & (row >= 0.0) & (row < spec.height)
    cells = np.full(ranges.size, -1, np.int64)
    cells[inside] = np.floor(row[inside]) * spec.width + np.floor(column[inside])
    return cells


def _limited(scan: Scan, reach_m: float, no_return: str) -> Scan:
    """Return a scan of a sensor that sees no further than `reach_m`."""
    if no_return == 'ignore':
        scan = _invalid(scan, scan.ranges_m == np.inf)
    if reach_m >= scan.range_max_m:
        return scan
    # Beyond its own range a sensor has said nothing.
    longer = (scan.ranges_m > reach_m) & (scan.ranges_m <= scan.range_max_m)
    ranges: Float32Array = np.where(longer, np.float32(np.inf), scan.ranges_m)
    return replace(scan, ranges_m=ranges, range_max_m=reach_m)


def _invalid(scan: Scan, beams: AnyArray) -> Scan:
    ranges: Float32Array = np.where(beams, np.float32(np.nan), scan.ranges_m)
    return replace(scan, ranges_m=ranges)
