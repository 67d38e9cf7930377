"""How far readings scatter, from pairs of beams that should have met the same place.

Design note: sigma without the lattice
--------------------------------------
Context. The share of beams that passed the cell of a reading (`ogm_mcmc.engine.range_spread`)
holds more than noise and poses: a wall that does not follow the lattice fills cells in part, and
beams pass the rest of them. And where beams are few, most pairs are of cells that many beams come
to: corners and edges, which more pass. A map image turned by 40 degrees, noise 0.2 of a cell,
shares of all beams, a quarter and one of 20: .37, .45, .51, which mean 0.67, 0.8, 0.92 cells.
Walls then stay in doubt: of the solid cells that were met 0.14 were shown as such; by pairs 0.30.

Decision. A beam that passes the cell of a reading of another scan, within half a cell of it and
from the same side, should have ended beside it. How far before or behind it ended does not depend
on the lattice, nor on how many beams there are, and poses that err show in it. Of these distances
the one that four in five do not exceed, over 1.28 and the root of two, is the standard deviation
of a Gaussian; logs, whose errors have long tails, have more by it than by the median:

cells               | 0.5  | 0.68 | 0.8  | 0.9
noise 0.2           | 0.24 | 0.24 | 0.25 | 0.26
noise 1.0           | 1.08 | 1.08 | 1.07 | 1.08
noise 0.2, poses 2 cm, 0.3 degrees | 0.58 | 0.54 | 0.53 | 0.54
Intel, 910 scans    | 0.53 | 0.60 | 0.70 | 0.97
Intel, every tenth  | 0.61 | 0.67 | 0.79 | 1.04

Distances are looked for within 0.4 m (`REACH_M`): of a Gaussian that is wider only the middle is
seen, and four in five of what is seen are nearer. So what is looked up is the deviation by which
four in five of those within reach are so near (`_deviation`): with a noise of 0.2 and 0.3 m in
cells of 5 cm, 0.22 and 0.37 m are found, without 0.16 and 0.17. Nothing changes below 0.1 m.

To it comes where in its cell a wall may be, `IN_CELL`. What is found this way and by shares is
each an upper bound: shares take rims of walls for noise, and pairs do not know that the cells of
a drawn world are solid. The smaller one is taken. On Intel both are alike (0.041 and 0.042 m).

Tried: 0.4 for `IN_CELL`, by which Intel, even beams mapped, loses 0.0035 +- 0.0006 nats a beam to
shares (every tenth scan gains 0.0050 +- 0.0020); with 0.45 it gains 0.0025 +- 0.0006. Runs differ
by as much, so these are alike. With all even beams pairs would say as much as shares with .55 on
Intel, .56, .60 and .66 in Belgioioso, Freiburg and CSAIL, on which nothing was chosen. 0.5 and
0.55 are no better there: CSAIL with 5 % of the beams gains 0.018, 0.017 and 0.012 +- 0.004 nats
with 0.45, 0.5 and 0.55, Belgioioso 0.013, 0.011 and 0.010 +- 0.003; with all beams they differ by
no more than runs do. A reading anywhere in a cell, along and across, has .41 at most. Shares
weighted by how likely a cell was to be met by another beam: .46 instead of .51 with one of 20,
about half of what is wrong. Beams from both sides: two faces of a wall of 10 cm make 0.7 cells of
a noise of 0.2.

Of many scans some are taken, any of them: while it was every second, third or so on, scans of two
sensors that take turns told of one of the two alone.

Consequence. `docs/results.md`, sigma and away from the lattice. It takes 0.02 to 0.15 s, with 0.8
million beams 0.3 s. The interval tells of chance alone, as if no two pairs erred alike: the mean
of Belgioioso, CSAIL and Freiburg varies by 0.0014, 0.0014 and 0.0013 m where parts of a twentieth
of the drive are drawn anew, twice what the interval says, and over its quarters by more (Freiburg
0.037 to 0.052). Scans in a row share errors of their poses: every tenth scan of Freiburg has
0.050 instead of 0.046, of the others no more than all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array
from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.engine.range_spread import SEEN_BEFORE, SETTING, Spread
from ogm_mcmc.geometry import PlacedScan

__all__ = ['narrower', 'spread_of_pairs']

# The line of a beam passes a reading within so many cells, and they look the same way within
# 60 degrees.
ASIDE, SAME_WAY = 0.5, 0.5

# How far before or behind a reading beams are looked for: so many cells, so many m where that is
# less, and two cells at least. In steps, cells.
REACH, REACH_M, LEAST_REACH, STEP = 8.0, 0.4, 2.0, 0.5

# This share of the distances tells; of a Gaussian up to so many times as wide as they reach.
TOLD, WIDEST = 0.8, 2.0
GAUSS = NormalDist()

# Standard deviation of where in its cell a wall is, along a beam, cells.
IN_CELL = 0.45

# So many readings are kept at most, so many in each cell, and so many beams are looked at.
MOST_READINGS, MOST_IN_CELL, MOST_BEAMS = 400_000, 16, 5000

# Cells are named by one number.
ROWS = 2**31


class _Readings(NamedTuple):
    """Readings (N,): the scan each is of, where it ends (2, N), cells, and which way it looks."""

    scan: Int64Array
    ends: Float64Array
    ways: Float64Array
    ranges: Float64Array

    @classmethod
    def of(cls, scans: Sequence[PlacedScan], resolution_m: float, reach_m: float) -> _Readings:
        found: list[tuple[AnyArray, ...]] = []
        for number, placed in enumerate(scans):
            scan = placed.scan
            which = scan.measured()
            if reach_m > 0.0:
                which &= scan.ranges_m <= reach_m
            ranges = scan.ranges_m[which].astype(np.float64)
            ends = placed.along(which, ranges) / resolution_m
            ways = placed.ways(which)
            found.append((np.full(ranges.size, number), ends, ways, ranges / resolution_m))
        joined = [np.concatenate(one, axis=-1) for one in zip(*found, strict=True)]
        return cls._make(joined)

    def at(self, which: Int64Array | BoolArray) -> _Readings:
        return _Readings._make(one[..., which] for one in self)


def narrower(shares: Spread, pairs: Spread | None) -> Spread:
    """Return which of the two says less; pairs where nothing else was told."""
    if pairs is None or (shares.beams > 0 and shares.mean <= pairs.mean):
        return shares
    return pairs


def spread_of_pairs(
    scans: Sequence[PlacedScan], resolution_m: float, reach_m: float = 0.0
) -> Spread | None:
    """Return sigma from what beams of other scans say of the places where readings end.

    reach_m  readings up to this range count, m; 0: all
    Returns None where no beam came where a reading of another scan is.
    """
    reach = min(REACH, max(LEAST_REACH, REACH_M / resolution_m))
    off = np.sort(np.abs(_distances(scans, resolution_m, reach_m, reach)))
    n = off.size
    if n == 0:
        return None
    ranks = TOLD * n + 1.96 * math.sqrt(TOLD * (1.0 - TOLD) * n) * np.array([0.0, -1.0, 1.0])
    told = reach * _deviation(off[np.clip(ranks, 0, n - 1).astype(np.int64)] / reach)
    known = n / (n + SEEN_BEFORE)
    default = ForwardModelConfig.sigma / resolution_m
    variance = known * (0.5 * told**2 + IN_CELL**2) + (1.0 - known) * default**2
    found_m = np.clip(resolution_m * np.sqrt(variance), SETTING.low, SETTING.high)
    mean, low, high = found_m.tolist()
    return Spread(mean, (high - low) / 3.92, n, low, high)


def _deviation(nearest: Float64Array) -> Float64Array:
    """Return the deviation of a Gaussian of which four in five values within 1 are within these.

    nearest  (N,): `TOLD` of 1 and more of it are told by no deviation; then the largest, `WIDEST`
    """
    deviations = np.linspace(0.1, WIDEST, 60)
    within = [
        deviation * GAUSS.inv_cdf(0.5 + TOLD * (GAUSS.cdf(1.0 / deviation) - 0.5))
        for deviation in deviations.tolist()
    ]
    found = np.interp(nearest, [0.0, *within], [0.0, *deviations.tolist()])
    return np.asarray(found, np.float64)


def _distances(
    scans: Sequence[PlacedScan], resolution_m: float, reach_m: float, reach: float
) -> Float64Array:
    """Return how far beams ended behind readings that they should have met, cells (N,)."""
    rng = np.random.default_rng(0)
    total = sum(scan.scan.ranges_m.size for scan in scans)
    if total > MOST_READINGS:
        # Any of them: every second one may be of the same sensor.
        some = rng.permutation(len(scans))[: max(2, len(scans) * MOST_READINGS // total)]
        scans = [scans[k] for k in np.sort(some)]
    readings = _Readings.of(scans, resolution_m, reach_m)
    order = rng.permutation(readings.scan.size)
    beams = readings.at(order[:MOST_BEAMS])
    # A few of each cell, any of them.
    names = _names(readings.ends)[order]
    by_cell = np.argsort(names, kind='stable')
    names = names[by_cell]
    first = np.searchsorted(names, names)
    few = np.arange(names.size) - first < MOST_IN_CELL
    names, others = names[few], readings.at(order[by_cell[few]])
    beam, other = _near(beams, names, reach)
    apart = others.ends[:, other] - beams.ends[:, beam]
    way = beams.ways[:, beam]
    along = (apart * way).sum(axis=0)
    aside = np.abs(apart[1] * way[0] - apart[0] * way[1])
    same_way = (others.ways[:, other] * way).sum(axis=0) > SAME_WAY
    of_others = others.scan[other] != beams.scan[beam]
    pair = of_others & same_way & (aside <= ASIDE) & (np.abs(along) <= reach)
    # One of each beam, the reading that its line passes nearest.
    nearest = np.lexsort((aside[pair], beam[pair]))
    _, one = np.unique(beam[pair][nearest], return_index=True)
    return np.asarray(-along[pair][nearest][one], np.float64)


def _near(beams: _Readings, names: Int64Array, reach: float) -> tuple[Int64Array, Int64Array]:
    """Return pairs (P,) of a beam and a reading, sorted by cells `names`, in a cell near its end.

    `reach`: along the beam, cells.
    """
    steps = np.arange(-reach, reach + STEP / 2.0, STEP)
    passed = _names(beams.ends[:, :, None] + steps * beams.ways[:, :, None])
    passed[beams.ranges[:, None] + steps <= 0.0] = np.iinfo(np.int64).min
    passed.sort(axis=1)
    passed[:, 1:][passed[:, 1:] == passed[:, :-1]] = np.iinfo(np.int64).min
    start = np.searchsorted(names, passed.ravel())
    count = np.searchsorted(names, passed.ravel(), side='right') - start
    visit = np.repeat(np.arange(count.size), count)
    within = np.arange(visit.size) - np.repeat(np.cumsum(count) - count, count)
    return visit // steps.size, start[visit] + within


def _names(points: Float64Array) -> Int64Array:
    """Return the number of the cell of points (2, ...), cells."""
    column, row = np.floor(points).astype(np.int64)
    return np.asarray(column * ROWS + row, np.int64)
