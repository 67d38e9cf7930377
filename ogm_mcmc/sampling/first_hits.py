"""What every ray hits first on a map: looked for, or kept from a map that was nearly the same."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, UInt8Array
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.sampling.first_hit_kernels import find_first_hits, mark_through
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import NOTHING
from ogm_mcmc.sampling.ray_line_kernels import RIGHTWARDS, SHAPE, UPWARDS

__all__ = ['HitsBefore', 'first_hits']

MOST_CLOSED = 2_000
"""Where more cells became occupied all rays are looked at: that is less."""


class HitsBefore(NamedTuple):
    """Records (n, 4) of the first n rays of an index, on a map (K,) of another window, `spec`.

    here   the window of the index, which shares the lattice
    again  numbers (m,) of rays whose likelihoods are others now
    """

    cells: UInt8Array
    spec: GridSpec
    records: AnyArray
    here: GridSpec
    again: AnyArray

    def moved(self, index: RayIndex) -> AnyArray:
        """Return the records with places of the window of the index."""
        across = self.spec.column0 - self.here.column0
        up = self.spec.row0 - self.here.row0
        records = self.records.copy()
        if across or up:
            flags = index.rays[: len(records), SHAPE] >> 48
            shift = np.where(flags & RIGHTWARDS, across, -across)
            shift += np.where(flags & UPWARDS, up, -up)
            hit = records[:, 0] != NOTHING
            records[hit, 0] += shift[hit].astype(np.int32)
        return records

    def closed(self, cells: UInt8Array) -> AnyArray:
        """Return the cells (n,) that are occupied on a map (K,) and were not, where both lie."""
        box = self.spec.box.intersection(self.here.box)
        now, before = (
            one.reshape(spec.height, spec.width)[spec.slices(box)]
            for one, spec in ((cells, self.here), (self.cells, self.spec))
        )
        rows, columns = np.nonzero((now != 0) & (before == 0))
        first = self.here.slices(box)
        found: AnyArray = (rows + first[0].start) * self.here.width + columns + first[1].start
        return found


def first_hits(cells: UInt8Array, index: RayIndex, before: HitsBefore | None = None) -> AnyArray:
    """Return the records (N, 4) int32 of a map (K,), see `ogm_mcmc.sampling.gibbs_kernels`.

    With those of a map of `before` only rays are looked at whose way changed.
    """
    records = np.empty((index.n_rays, 4), np.int32)
    kept = np.zeros(0, np.uint8)
    if before is not None and (closed := before.closed(cells)).size <= MOST_CLOSED:
        known = before.moved(index)
        records[: len(known)] = known
        through = np.zeros(index.n_rays, np.bool_)
        through[before.again] = True
        mark_through(
            closed, index.marks, index.lists, index.full, index.near, index.front, index.tiles,
            index.runs, index.run_lengths, index.rays, index.grid, through,
        )  # fmt: skip
        kept = (~through[: len(known)]).view(np.uint8)
    find_first_hits(cells, kept, records, records.view(np.float32), *index.arrays())
    return records
