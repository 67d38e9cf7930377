"""Sigma, clutter and missing returns of a sensor, from what its beams say of each other.

Design note: shares from the data
---------------------------------
Context. With 5 % clutter a lone beam through unknown space is cheaply explained away, reading and
all, in favour of a solid block, which the learned prior likes: a sensor that never errs is
disbelieved where it measured little. Drawn in turn with maps, the share feeds on itself: of a
sparse building, where few readings have a second one beside them, chains that began with 0.005
came to 0.1 to 0.4 (true: 0), with the learned prior and with single cells.

Decision. Beams judge beams. A reading is confirmed by another one that ends beside it, and
contradicted when others passed through its cell and none, or few of many, ended near; lone
readings, which say nothing of it, are left out. A beam without a return that passes a cell in
which many beams ended and hardly any passed is missing. Both shares are binomial, with a Beta
prior as if a hundred beams were seen before, one of them wrong. Sigma is found from the same
counts where it is 0: `ogm_mcmc.engine.range_spread`.

Consequence. Generated buildings, 5 % of the beams: `docs/results.md`. Intel (odd beams held out,
40 sweeps): clutter 0.002, so 0.005; 1.012 nats a beam (live 0.912).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Int64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig, SamplerConfig, WindowConfig
from ogm_mcmc.engine.grazing import Grazing, grazing_of
from ogm_mcmc.engine.range_pairs import narrower, spread_of_pairs
from ogm_mcmc.engine.range_spread import Spread, blur_of, contradicted, spread_of
from ogm_mcmc.geometry import CellBox, HeldRays, PlacedScan, Rays, cast_rays
from ogm_mcmc.mapping.counting import CountingMapper

__all__ = [
    'SensorNumbers',
    'Share',
    'fit_sensor',
]

# A cell is solid if so many scans ended there for each that passed, and at least so many.
ENDED_PER_PASSED, ENDED = 4, 3

# Beams without a return that are looked at, and how far from their end they may be solid, cells.
MOST_MISSING = 4000
END_CELLS = 2.0

# As if so many beams had been seen before, one of them wrong.
SEEN_BEFORE = 100.0

# For the ends of intervals: a thousandth of a deviation matters to nobody.
INTERVAL_DRAWS = 20_000

# Cells are no walls: a beam past the corner of one contradicts it. Shares are no smaller.
LEAST_SHARE = 0.005


class Share(NamedTuple):
    """A share and its standard deviation, from so many beams, and the ends of its 95 % interval.

    The ends are those of draws from its posterior, a Beta distribution.
    """

    mean: float
    deviation: float
    beams: int
    low_95: float
    high_95: float

    @classmethod
    def of(cls, wrong: float, beams: float) -> Share:
        """Return the posterior of a binomial share."""
        a, b = wrong + 1.0, beams - wrong + SEEN_BEFORE - 1.0
        mean = a / (a + b)
        drawn = np.random.default_rng(0).beta(a, b, INTERVAL_DRAWS)
        low, high = (float(end) for end in np.quantile(drawn, (0.025, 0.975)))
        deviation = math.sqrt(mean * (1.0 - mean) / (a + b + 1.0))
        return cls(mean, deviation, round(beams), low, high)

    def __str__(self) -> str:
        """Return `0.0123 (0.0090 to 0.0160)`."""
        return f'{self.mean:.4f} ({self.low_95:.4f} to {self.high_95:.4f})'


class SensorNumbers(NamedTuple):
    """Shares of readings from anywhere and of lost returns, and the spread of ranges.

    None where it was given, or, a share, where beams do not tell. A sigma that no beam told of is
    one of 0 beams.
    """

    clutter: Share | None
    missing: Share | None
    sigma: Spread | None = None
    grazing: Grazing | None = None

    def __str__(self) -> str:
        """Return `clutter 0.0123 (0.0090 to 0.0160), sigma 0.0168 m (0.0150 to 0.0190)`."""
        return ', '.join(
            f'{name} {found}' for name, found in self._asdict().items() if found is not None
        )

    @classmethod
    def of_dict(cls, values: Mapping[str, Any]) -> SensorNumbers:
        """Return what `as_dict` gave; raises KeyError, TypeError or ValueError if it did not."""
        clutter, missing, sigma, grazing = (values[name] for name in cls._fields)
        return cls(
            None if clutter is None else Share(**clutter),
            None if missing is None else Share(**missing),
            None if sigma is None else Spread(**sigma),
            None if grazing is None else Grazing.of_dict(grazing),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON: by name a mean, its deviation, beams and interval."""
        plain = {
            name: None if found is None else found._asdict()
            for name, found in self._asdict().items()
        }
        if self.grazing is not None:
            plain['grazing'] = self.grazing.as_dict()
        return plain


def fit_sensor(
    scans: Sequence[PlacedScan], config: SamplerConfig
) -> tuple[ForwardModelConfig, SensorNumbers | None]:
    """Return the sensor's model with the numbers that its beams ask for, and how sure they are.

    A sigma of 0 is found, and so is grazing below 0. Shares are where `config.chain.sensor` says
    so and the model is `beam` without short returns. Where nothing is to be found the model comes
    back as it is, and None.
    """
    given, window = config.model, config.window
    shares = config.chain.sensor == 'fitted' and given.kind == 'beam' and given.short == 0.0
    if given.sigma > 0.0 and given.grazing >= 0.0 and not shares:
        return given, None
    mapper, cast = _mapped(scans, window)
    sigma = given.sigma_m
    seen = _Seen.of(mapper, math.ceil(2.0 * sigma / window.resolution))
    spread = grazing = None
    if given.sigma == 0.0:
        by_shares = spread_of(seen.hits, seen.misses, seen.beside, window.resolution)
        by_pairs = spread_of_pairs(scans, window.resolution, window.max_range)
        spread = narrower(by_shares, by_pairs)
        given = replace(given, sigma=spread.mean)
    if given.grazing < 0.0:
        sharp = 1.0 - blur_of(given.sigma, window.resolution)
        if sharp > 0.0:
            found = grazing_of(scans, window, seen.hits, seen.misses, seen.box)
            grazing = Grazing.of(found, sharp)
        given = replace(given, grazing=0.0 if grazing is None else grazing.used)
    if not shares:
        return given, SensorNumbers(None, None, spread, grazing)
    if given.sigma > sigma:
        seen = _Seen.of(mapper, math.ceil(2.0 * given.sigma / window.resolution))
    clutter, missing = _shares(seen, cast, scans)
    clears = window.no_return == 'clear'
    model = replace(
        given,
        clutter=max(clutter.mean, LEAST_SHARE),
        missing=max(missing.mean, LEAST_SHARE) if clears else given.missing,
    )
    return model, SensorNumbers(clutter, missing if clears else None, spread, grazing)


def _shares(seen: _Seen, cast: HeldRays, scans: Sequence[PlacedScan]) -> tuple[Share, Share]:
    """Return the shares of readings from anywhere and of lost returns."""
    confirmed = contrary = met_solid = lost = without = 0
    every = max(1, sum(int(np.isinf(scan.scan.ranges_m).sum()) for scan in scans) // MOST_MISSING)
    for rays in cast:
        if rays.n_rays == 0:
            continue
        right, wrong, solid = seen.judged(rays)
        confirmed += right
        contrary += wrong
        met_solid += solid
        unseen = np.flatnonzero(rays.hit[: rays.n_rays] != 1)
        looked_at = unseen[(without + 1 + np.arange(unseen.size)) % every == 0]
        without += unseen.size
        lost += every * seen.met_by(rays, looked_at)
    return Share.of(contrary, confirmed + contrary), Share.of(lost, met_solid + lost)


class _Seen(NamedTuple):
    """What beams say of cells (height, width) of a box.

    hits    how many ended in it; misses: how many passed through; beside: how many ended in it
            or near; solid: whether it stops beams
    """

    box: CellBox
    hits: Int64Array
    misses: Int64Array
    beside: Int64Array
    solid: BoolArray

    @classmethod
    def of(cls, mapper: CountingMapper, reach: int) -> _Seen:
        """Return what was counted around all that was hit; near is within `reach` cells.

        Beams reach further than anything that they met, and most of what lies there is of no use.
        """
        box = _box_of_hits(mapper)
        hits, misses = (counts.astype(np.int64) for counts in mapper.counts(box))
        solid = (hits >= ENDED) & (hits >= ENDED_PER_PASSED * misses)
        return cls(box, hits, misses, _sum_around(hits, reach), solid)

    def corner(self, rays: Rays) -> tuple[int, int]:
        """Return where the cells of rays begin in the box."""
        return rays.column - self.box.column0, rays.row - self.box.row0

    def judged(self, rays: Rays) -> tuple[int, int, int]:
        """Count readings that others confirm, that others contradict, that end in solid cells."""
        ended = rays.hit[: rays.n_rays] == 1
        corner = self.corner(rays)
        column, row = (
            np.floor(rays.ends[axis, : rays.n_rays][ended]).astype(np.int64) + corner[axis]
            for axis in (0, 1)
        )
        others = self.beside[row, column] - 1
        against = contradicted(self.misses[row, column], others)
        confirmed = (others > 0) & ~against
        counts = (np.count_nonzero(one) for one in (confirmed, against, self.solid[row, column]))
        right, wrong, solid = map(int, counts)
        return right, wrong, solid

    def met_by(self, rays: Rays, which: Int64Array) -> int:
        """Count those rays `which` (N,) that pass a solid cell before their end."""
        met = _meets(self.solid, self.corner(rays), (rays.x, rays.y), rays.ends[:, which])
        return int(np.count_nonzero(met))


def _mapped(scans: Sequence[PlacedScan], window: WindowConfig) -> tuple[CountingMapper, HeldRays]:
    """Return a map that counts all beams, and their rays."""
    mapper = CountingMapper(
        MapperConfig(
            method='counting',
            resolution=window.resolution,
            max_range=window.max_range,
            no_return=window.no_return,
        )
    )
    clears = window.no_return == 'clear'
    cast = HeldRays(
        scans,
        lambda scan, sensor: cast_rays(
            scan, sensor, mapper.spec, max_range_m=window.max_range, no_return_clears=clears
        ),
    )
    _cover(mapper, cast)
    for rays in cast:
        if rays.n_rays:
            mapper.update_by(rays)
    return mapper, cast


def _sum_around(counts: Int64Array, reach: int) -> Int64Array:
    """Sum the cells (height, width) within `reach` of each, diagonals included."""
    for axis in (0, 1):
        padded = np.pad(counts, [(reach + 1, reach) if k == axis else (0, 0) for k in (0, 1)])
        total = np.cumsum(padded, axis=axis)
        size = counts.shape[axis]
        after = np.take(total, np.arange(size) + 2 * reach + 1, axis=axis)
        counts = after - np.take(total, np.arange(size), axis=axis)
    return counts


def _cover(mapper: CountingMapper, cast: Iterable[Rays]) -> None:
    """Make room for all rays at once: a map that grows is copied again and again."""
    box = CellBox(0, 0, 0, 0)
    for rays in cast:
        if rays.n_rays:
            box = box.union(rays.box)
    if not box.empty:
        mapper.grid.cover(box)


def _box_of_hits(mapper: CountingMapper) -> CellBox:
    """Return the cells around all that were hit, one cell where none was."""
    spec = mapper.spec
    hits, _ = mapper.counts(spec.box)
    rows, columns = (np.flatnonzero(hits.any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return CellBox(spec.column0, spec.row0, spec.column0 + 1, spec.row0 + 1)
    first, last = (int(columns[0]), int(rows[0])), (int(columns[-1]), int(rows[-1]))
    return CellBox(
        spec.column0 + first[0],
        spec.row0 + first[1],
        spec.column0 + last[0] + 1,
        spec.row0 + last[1] + 1,
    )


def _meets(
    solid: BoolArray, corner: tuple[int, int], start: tuple[float, float], ends: AnyArray
) -> BoolArray:
    """Whether rays, in cells from a corner to `ends` (2, N), pass a solid cell before it."""
    if not ends.size:
        return np.zeros(ends.shape[1], np.bool_)
    dx, dy = ends[0] - start[0], ends[1] - start[1]
    length = np.maximum(np.hypot(dx, dy), 1e-9)
    up_to = np.maximum(length - END_CELLS, 0.5)
    along = np.arange(0.25, up_to.max(), 0.5)
    share = along / length[:, None]
    column = np.floor(start[0] + share * dx[:, None]).astype(np.int64) + corner[0]
    row = np.floor(start[1] + share * dy[:, None]).astype(np.int64) + corner[1]
    height, width = solid.shape
    there = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    there &= along < up_to[:, None]
    met: BoolArray = (there & solid[np.where(there, row, 0), np.where(there, column, 0)]).any(1)
    return met
