"""Scans on their way into an index of rays: cast when they are needed, a few of them held."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, Float64Array
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.sampling.beam_rays import BeamRays
from ogm_mcmc.sampling.ray_merging import Joining, Shared

__all__ = ['Batch', 'Part', 'in_blocks']

# Rays that are filed at a time.
BLOCK = 2_000

# Rays that are cast once and held while they are filed, 28 bytes each, 36 where sigma differs by
# beam; others are cast again.
MOST_HELD = 200_000


class _Held(NamedTuple):
    """The rays of a scan, what they share told once: exact, as ranges come as float32."""

    at: tuple[int, int, float, float]
    ux: Float64Array
    uy: Float64Array
    length: Float64Array
    reading: Float32Array
    reach: Float64Array  # one for all, if it is
    sigma: Float64Array  # as well

    @classmethod
    def of(cls, rays: BeamRays) -> _Held:
        column, row, x, y = (array[0] if array.size else 0 for array in rays[:4])
        at = int(column), int(row), float(x), float(y)
        return cls(
            at,
            rays.ux,
            rays.uy,
            rays.length,
            rays.reading.astype(np.float32),
            _told_once(rays.reach),
            _told_once(rays.sigma),
        )

    def rays(self) -> BeamRays:
        size = self.length.size
        column, row, x, y = (np.full(size, value) for value in self.at)
        reading = self.reading.astype(np.float64)
        reach, sigma = np.full(size, self.reach), np.full(size, self.sigma)
        return BeamRays(column, row, x, y, self.ux, self.uy, self.length, reading, reach, sigma)


class Part(NamedTuple):
    """Some rays, one after the other from number `first` on; `told`: scans that say more of some.

    Of these, see `Batch.more_of`.
    """

    first: int
    rays: BeamRays
    told: list[int]


class Batch:
    """The beams of scans, `n_beams` of them; those that run along together are joined."""

    def __init__(
        self,
        scans: Sequence[PlacedScan],
        cast: Callable[[PlacedScan], BeamRays],
        joining: Joining | None,
    ) -> None:
        self._scans, self._cast, self._joining = scans, cast, joining
        self._held: list[_Held] = []
        self._shared: list[Shared | None] = []
        self.sizes: list[int] = []  # beams of each scan
        self.n_beams = 0
        for scan in scans:
            rays = cast(scan)
            self.sizes.append(rays.length.size)
            self.n_beams += rays.length.size
            if self.n_beams <= MOST_HELD:
                self._held.append(_Held.of(rays))
            self._shared.append(None if joining is None else joining.take(scan, rays))

    def shares(self, count: int) -> list[Callable[[], Iterator[BeamRays]]]:
        """Return what yields the rays of so many shares of the scans, in turn."""
        ends = [len(self._scans) * share // count for share in range(count + 1)]
        return [partial(self.rays, *scans) for scans in pairwise(ends)]

    def rays(self, begin: int = 0, end: int | None = None) -> Iterator[BeamRays]:
        """Yield the new rays of each scan, or some: of its own beams, or lines alone."""
        for i in range(len(self._shared))[begin:end]:
            if (rays := self.new_of(i)) is not None:
                yield rays

    def more_said(self) -> Iterator[tuple[int, BeamRays, AnyArray]]:
        """Yield which scan says more of rays, its beams, and the number of the ray of each.

        Nobody asks for rays any more after this: they are no longer held then.
        """
        for i, shared in enumerate(self._shared):
            if shared is not None and shared.ray.size:
                yield i, self._of(i), shared.ray
        self._held.clear()

    def parts(self, size: int) -> Iterator[Part]:
        """Yield `rays` again, those of some scans at a time: `size`, or more by one scan.

        As often as one likes: for those who never have all rays at once.
        """
        own = [self._n_new(i) for i in range(len(self._shared))]
        cuts, held = [], 0
        for i, n_new in enumerate(own):
            held += n_new
            if held >= size or (held and i + 1 == len(own)):
                cuts.append(i + 1)
                held = 0
        ends = np.cumsum(own)[np.array(cuts, np.int64) - 1]
        told: list[list[int]] = [[] for _ in cuts]
        for i, shared in enumerate(self._shared):
            if shared is not None:
                for part in np.unique(np.searchsorted(ends, shared.ray, 'right')):
                    told[part].append(i)
        begin, first = 0, 0
        for end, last, scans in zip(cuts, ends, told, strict=True):
            new = [rays for i in range(begin, end) if (rays := self.new_of(i)) is not None]
            yield Part(first, _together(new), scans)
            begin, first = end, int(last)

    def more_of(self, part: Part) -> Iterator[tuple[BeamRays, AnyArray]]:
        """Yield beams that say more of a part's rays, and the number of the ray of each."""
        for i in part.told:
            shared = self._shared[i]
            assert shared is not None
            mine = (shared.ray >= part.first) & (shared.ray < part.first + part.rays.length.size)
            yield BeamRays(*(array[mine] for array in self._of(i))), shared.ray[mine]

    def _n_new(self, i: int) -> int:
        shared = self._shared[i]
        return self.sizes[i] if shared is None else int(shared.began.size)

    def new_of(self, i: int) -> BeamRays | None:
        """Return the rays that scan i adds, of its own beams or lines alone; None for none."""
        shared = self._shared[i]
        if shared is None:
            return self._of(i)
        if self._joining is None or not shared.began.size:
            return None
        return self._joining.lines_alone(shared, self._of(i))

    def _of(self, i: int) -> BeamRays:
        return self._held[i].rays() if i < len(self._held) else self._cast(self._scans[i])


def in_blocks(parts: Iterable[BeamRays]) -> Iterator[BeamRays]:
    """Yield the rays of a few scans at a time."""
    held: list[BeamRays] = []
    size = 0
    for part in parts:
        held.append(part)
        size += part.length.size
        if size >= BLOCK:
            yield _together(held)
            held, size = [], 0
    if held:
        yield _together(held)


def _together(parts: Sequence[BeamRays]) -> BeamRays:
    return BeamRays(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _told_once(values: Float64Array) -> Float64Array:
    """Return values (n,), one of them (1,) where they are all the same."""
    return values[:1].copy() if values.size and (values == values[0]).all() else values
