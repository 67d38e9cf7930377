"""How far surfaces are off across themselves: what beams that graze them err by along the beam.

Design note: an error that grows as beams graze
-----------------------------------------------
Context. A cell that a wall fills in part stops beams that meet it square, and lets pass those
that graze the wall, up to half a cell / tan(angle) before their readings. With a sigma found in
the scans, which is small where poses are right, the sampler then calls the cell free: in the
demo's office walls that beams only graze were dotted (F1 at 0.5 below that of the live map).

Decision. The standard deviation of a reading is hypot(sigma, grazing / tan(angle)), up to
four cells more, the angle from the readings beside it (`ogm_mcmc.geometry.slants`). As the
index holds a log-likelihood for each pair of a ray and a cell, that is exact, merged rays
included. `grazing` is found, for it is not of the sensor but of how walls lie on the lattice:
where many beams ended, and half or more of those that came, a cell is solid. How far before its
reading does a beam meet the first one? The median of that distance, cells, by the tangent:

1 / tan              | 0.1 | 0.7 | 1.3 | 2.4 | 3.7 | 5.9
office, all beams    | .19 | .25 | .50 | 1.0 | 1.6 | 2.8
`uma_236_237`, all   | .19 | .19 | .19 | .19 | .19 | .12
building 9, all      | .06 | .12 | .12 | .12 | .06 | .12
Intel                | .31 | .44 | .56 | .94 | 1.3 | 1.9

Worlds made of cells of the lattice have nothing of it, and lose if it is forced on them (0.6 of a
cell: F1 at 0.5 of `uma_236_237` .992 -> .972, building 9 .9998 -> .9976). Intel has it by its
poses, which sigma there is of already: with half a cell 1.284 nats a beam instead of 1.288, 1.266
with sigma lowered to 0.035 m (1.271 without grazing). So it counts as far as readings are of the
cell that they end in (`blur_of`), and is not looked for where they are not; nor does it count
where its 95 % interval begins at 0.

Neighbours on a wall err alike, in one scan and in all that see it: the counts below the median
vary 5 to 14 times as much from place to place as those of readings on their own. So the interval
takes walls within `ALIKE_M` for one (1 to 8 m: much the same). It tells of chance alone. With one
beam of 20 fewer cells are known to be solid, and angles are told worse by neighbours that are
farther away: 0.019 m is found instead of 0.031, and neither interval holds the other value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array, Int64Array
from ogm_mcmc.config import WindowConfig
from ogm_mcmc.engine.range_spread import SHARP_CELLS, Spread
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.geometry.rays import on_lattice
from ogm_mcmc.geometry.slants import slants_of

__all__ = ['Grazing', 'filled_in_part', 'grazing_of']

# So many beams ended in a cell that is solid, at least, and more than passed it.
ENDED = 2

# Readings that graze, and such that do not, by the slant of what they met.
GRAZED, SQUARE = (1.5, 5.0), 0.5

# Cells before and behind a reading in which the first solid one is looked for, and in what steps.
REACH, STEP = 6.0, 0.125

# So many readings, and so many scans, are looked at, about.
MOST_READINGS, MOST_SCANS = 20_000, 400

# As if so many readings had been seen before that err no more for grazing.
SEEN_BEFORE = 50.0

# Readings of walls within so much err alike, for their interval, m.
ALIKE_M = 2.0

# Half of a Gaussian lies within so many standard deviations.
HALF = 0.6745


class Grazing(NamedTuple):
    """How far surfaces are off, m, as `found`, and what is `used` of it, m."""

    found: Spread
    used: float

    @classmethod
    def of(cls, found: Spread, sharp: float) -> Grazing:
        """Return what was found, and what counts of it where readings are sharp: 1, or not: 0.

        Nothing counts where chance alone may have made it: where its interval begins at 0.
        """
        return cls(found, sharp * found.mean if _sure(found) else 0.0)

    @classmethod
    def of_dict(cls, values: Mapping[str, Any]) -> Grazing:
        """Return what `as_dict` gave; raises KeyError, TypeError or ValueError if it did not."""
        found = dict(values)
        used = found.pop('used')
        return cls(Spread(**found), used)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, those found and `used` side by side."""
        return {**self.found._asdict(), 'used': self.used}

    def __str__(self) -> str:
        """Return `0.0300 m (0.0200 to 0.0400)`, and why less than that counts if so."""
        if self.used == self.found.mean:
            return str(self.found)
        if self.used == 0.0:
            begins = 'its interval begins at 0'
            why = 'the index would be too large' if _sure(self.found) else begins
            return f'{self.found}, found but not counted, since {why}'
        why = f'since sigma is above {SHARP_CELLS:g} cells'
        return f'{self.found}, of which {self.used:.4f} m counts, {why}'


def _sure(found: Spread) -> bool:
    return found.low_95 is not None and found.low_95 > 0.0


def filled_in_part(grazing: Grazing | None, blur: float, resolution_m: float) -> float:
    """Return how far walls fill cells in part: 0 where cells are walls or free, 1 walls anywhere.

    grazing  what beams told of it, None where nobody asked them; blur: see `blur_of`

    Design note. What a cell reflected corrects draws that are sure of cells which a wall fills in
    part. Where cells are walls, as in images of maps and generated buildings, there are none, and
    free cells beside walls that one beam of three seems to have ended in, by its noise, were said
    to be occupied with .13. Surfaces that lie anywhere in their cells are off by 1 / sqrt(12) of a
    cell. So 1 from there on, less below, 0 where chance may have made it; and as if `SEEN_BEFORE`
    readings had said before that they do. Where readings are blurred, too, draws are sure of what
    they cannot know. In doubt draws know less than beams, whatever walls are like: what a cell
    reflected always weighs there (`with_share_of`).

    The same draws, F1 at 0.5, Brier score, calibration error: without any weight for reflections,
    with the same weight for all cells (before), with 0 here and with 1, which is as before:

    ============================  ===================  ===================  ===================
    map                           no weight            before               0 here
    ============================  ===================  ===================  ===================
    `home_ex3`, all beams         .9960 .00068 .00148  .9965 .00135 .00574  .9968 .00063 .00165
    `home_ex1`, all               .9948 .00102 .00218  .9939 .00170 .00691  .9943 .00086 .00220
    `uma_236_237`, all            .9907 .00092 .00113  .9923 .00121 .00356  .9923 .00083 .00128
    building 1, all               .9999 .00004 .00038  1.000 .00029 .00208  1.000 .00003 .00047
    building 9, all               .9996 .00002 .00015  .9999 .00009 .00059  .9999 .00002 .00017
    `home_ex3`, one of 20         .9523 .00398 .00884  .9645 .00340 .00840  .9644 .00340 .00858
    `uma_236_237`, one of 20      .9594 .00213 .00491  .9601 .00202 .00440  .9602 .00200 .00454
    building 9, one of 20         .9780 .00087 .00321  .9855 .00068 .00276  .9863 .00068 .00288
    office, all (1 is found)      .9632 .00228 .00300  .9729 .00120 .00218  .9663 .00217 .00288
    ============================  ===================  ===================  ===================

    (The last cell with 4 p (1 - p) in place of its root.) Freiburg and Intel have a blur of 1 and
    are as before: without any weight Freiburg loses 0.274 of 1.077 nats a held-out beam.
    Tried on these: a weight of 0.05 or 0.1 for all cells; 20 or 50 more beams that passed for the
    least; the share with 2 or 5 beams more that said what draws say. All lose F1 or calibration
    somewhere. A weight of 0.3 in doubt: F1 .0015 lower in the mean of 18 maps.
    """
    if grazing is None:
        return 1.0
    found = grazing.found
    off = min(1.0, math.sqrt(12.0) * found.mean / resolution_m) if _sure(found) else 0.0
    known = found.beams / (found.beams + SEEN_BEFORE)
    return max(blur, known * off + 1.0 - known)


def grazing_of(
    scans: Sequence[PlacedScan],
    window: WindowConfig,
    hits: Int64Array,
    misses: Int64Array,
    box: CellBox,
) -> Spread:
    """Return how far surfaces are off across themselves, m, by where beams meet solid cells.

    hits, misses  (height, width): how many ended in cells of `box`, and how many passed them
    """
    beams = sum(scan.scan.ranges_m.size for scan in scans)
    every = max(1, beams // MOST_READINGS, len(scans) // MOST_SCANS)
    solid = (hits >= ENDED) & (hits > misses)
    found = [_Misses.none()]
    found += [_misses(scan, window.resolution, solid, box) for scan in scans[::every]]
    return _spread(_Misses(*map(np.concatenate, zip(*found, strict=True))), window.resolution)


class _Misses(NamedTuple):
    """Readings near solid cells (N,): slants, how far off the first one is, cells, and its place.

    `place`: the square of `ALIKE_M` that it lies in
    """

    slant: Float64Array
    off: Float64Array
    place: Int64Array

    @classmethod
    def none(cls) -> _Misses:
        return cls(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))

    def at(self, which: BoolArray) -> _Misses:
        return _Misses(self.slant[which], self.off[which], self.place[which])


def _misses(placed: PlacedScan, resolution_m: float, solid: BoolArray, box: CellBox) -> _Misses:
    """Return the readings of a scan that end near solid cells."""
    scan, sensor = placed.scan, placed.pose
    slant = slants_of(scan, resolution_m)
    chosen = np.flatnonzero((slant > 0.0) & (slant <= GRAZED[1]))
    column, row, x, y = on_lattice(sensor, GridSpec(resolution_m, 1, 1))
    ahead, left = scan.directions()[:, chosen]
    cosine, sine = math.cos(sensor.yaw_rad), math.sin(sensor.yaw_rad)
    off = np.arange(-REACH, REACH + STEP / 2.0, STEP)
    along = np.maximum(scan.ranges_m[chosen, None] / resolution_m + off, 0.0)
    columns = np.floor(x + along * (ahead * cosine - left * sine)[:, None]).astype(np.int64)
    rows = np.floor(y + along * (ahead * sine + left * cosine)[:, None]).astype(np.int64)
    columns += column - box.column0
    rows += row - box.row0
    height, width = solid.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    cells = np.where(inside, rows * width + columns, 0)
    met = inside & solid.ravel()[cells]
    near = met.any(axis=1)
    first = met.argmax(axis=1)
    in_first = inside & (cells == cells[np.arange(first.size), first][:, None])
    last = off.size - 1 - in_first[:, ::-1].argmax(axis=1)
    middle = (off[first] + off[last]) / 2.0
    side = max(1, round(ALIKE_M / resolution_m))
    first_row, first_column = np.divmod(cells[np.arange(first.size), first], width)
    place = first_row // side * width + first_column // side
    return _Misses(slant[chosen], middle, place).at(near)


def _spread(misses: _Misses, resolution_m: float) -> Spread:
    """Return the standard deviation across that misses, cells, have where beams graze."""
    grazed, square = misses.at(misses.slant >= GRAZED[0]), misses.at(misses.slant < SQUARE)
    if grazed.off.size < 2 or square.off.size < 2:
        return Spread(0.0, None, 0, 0.0, 0.0)
    middle, low, high = _median(grazed) / HALF
    straight, least, most = _median(square) / HALF
    slant = float(np.median(grazed.slant))
    known = grazed.off.size / (grazed.off.size + SEEN_BEFORE)
    mean, low, high = (
        resolution_m * math.sqrt(known * max(one**2 - other**2, 0.0)) / slant
        for one, other in ((middle, straight), (low, most), (high, least))
    )
    return Spread(mean, (high - low) / 3.92, int(grazed.off.size), low, high)


def _median(misses: _Misses) -> Float64Array:
    """Return the median of distances, cells, and the ends (3,) of its 95 % interval.

    The ends are two of the distances, by how much the number of those below it varies from place
    to place, at least as if each reading were one of its own (n / 4). One place tells of none.
    """
    off = np.sort(np.abs(misses.off))
    n = off.size
    below = -0.5 * np.sign(np.abs(misses.off) - off[n // 2])
    _, place = np.unique(misses.place, return_inverse=True)
    counts = np.bincount(place, below - below.mean())
    ranks = float(n)
    if counts.size > 1:
        variance = float(counts @ counts) * counts.size / (counts.size - 1)
        ranks = 1.96 * math.sqrt(max(variance, n / 4.0))
    ends = 0.5 * n + ranks * np.array([0.0, -1.0, 1.0])
    found: Float64Array = off[np.clip(ends, 0, n - 1).astype(np.int64)]
    return found
