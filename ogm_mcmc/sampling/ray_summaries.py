"""What is known of every ray where the map is put together: what it hits in which piece."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array
from ogm_mcmc.sampling.tile_gibbs import TileReport
from ogm_mcmc.sampling.tile_kernels import see_outside, sum_of_hits
from ogm_mcmc.sampling.tiles import Tiling, colours

__all__ = ['RaySummaries', 'summaries_of']

# A ray has fewer places.
PLACE_BITS = 17


class RaySummaries(NamedTuple):
    """All V visits of N rays to pieces of the map, ray by ray, in order along each.

    ray_of  (V,) int32: the ray of each visit; unseen (N,) float32, telling (N,) int32 of rays, as
            in `TileRays`
    visits  of each tile: which of these its own are, (V_t,) int32
    first, last  of each tile: the first and last visit of each of its rays, (n_t,) int32
    groups  tiles that may be drawn at the same time, see `tiles.colours`
    left_out  nats that log-likelihoods leave out, see `RayIndex`
    """

    ray_of: AnyArray
    unseen: Float32Array
    telling: AnyArray
    visits: list[AnyArray]
    first: list[AnyArray]
    last: list[AnyArray]
    groups: list[list[int]]
    left_out: float

    def outside(self, tile: int, hits: Float32Array) -> Float32Array:
        """Return (n_t,) what lies outside for each ray of a tile, given the hits (V,)."""
        behind = np.empty(self.first[tile].size, np.float32)
        see_outside(self.first[tile], self.last[tile], self.ray_of, hits, self.unseen, behind)
        return behind

    def log_likelihood(self, hits: Float32Array) -> float:
        """Log p(z | m), nats."""
        return float(sum_of_hits(self.ray_of, hits, self.unseen)) + self.left_out

    @property
    def n_rays(self) -> int:
        """N."""
        return self.unseen.size

    @property
    def n_bytes(self) -> int:
        """Memory of all arrays."""
        of_tiles = (*self.visits, *self.first, *self.last)
        arrays = (self.ray_of, self.unseen, self.telling, *of_tiles)
        return sum(int(array.nbytes) for array in arrays)


def summaries_of(tiling: Tiling, reports: Sequence[TileReport]) -> RaySummaries:
    """Put together what the tiles have said of their rays."""
    n_rays = 1 + max((int(r.numbers[-1]) for r in reports if r.numbers.size), default=-1)
    unseen, telling = np.zeros(n_rays, np.float32), np.zeros(n_rays, np.int32)
    crossing = np.zeros((len(reports), n_rays), np.bool_)
    keys = []
    for tile, report in enumerate(reports):
        unseen[report.numbers], telling[report.numbers] = report.unseen, report.telling
        crossing[tile, report.numbers] = True
        rays = np.repeat(report.numbers.astype(np.int64), np.diff(report.begins))
        keys.append((rays << PLACE_BITS) | report.along)
    every = np.unique(np.concatenate(keys))
    visits = [np.searchsorted(every, own).astype(np.int32) for own in keys]
    sharing = np.array([(crossing & own).any(axis=1) for own in crossing])
    return RaySummaries(
        (every >> PLACE_BITS).astype(np.int32),
        unseen,
        telling,
        visits,
        [own[report.begins[:-1]] for own, report in zip(visits, reports, strict=True)],
        [own[report.begins[1:] - 1] for own, report in zip(visits, reports, strict=True)],
        colours(tiling.tiles, sharing),
        sum(report.left_out for report in reports),
    )
