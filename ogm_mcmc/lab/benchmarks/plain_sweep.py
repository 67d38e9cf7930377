"""A sweep beside a plain loop over all pairs, in turn, from the same map and the same numbers."""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

from ogm_mcmc.arrays import AnyArray, UInt8Array
from ogm_mcmc.lab.benchmarks.plain_sweep_kernels import find_hits, sweep_plainly
from ogm_mcmc.sampling import CellModel
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import NEAR, WIDTH
from ogm_mcmc.sampling.ray_line_kernels import LOW_32, START, UNSEEN

__all__ = ['PlainSweeps', 'time_beside_plain']


class PlainSweeps:
    """Flat lists of all pairs of an index whose rays are level nowhere, and one chain on them."""

    def __init__(self, model: CellModel, start: UInt8Array) -> None:
        self._order, self._prior = model.touched, model.prior_log_odds
        self.cells = start.copy()
        pairs, along = _lists(model.index)
        hits = np.zeros((model.index.n_rays, 2), np.int32)
        rays = (*along, hits, hits.view(np.float32))
        find_hits(self.cells, *rays)
        self._listed = (*pairs, *rays)

    def advance(self, rng: np.random.Generator) -> int:
        """Draw every cell once, in place; return the number of flips."""
        numbers = rng.random(self._order.size)
        return int(
            sweep_plainly(
                numbers, self._order, self.cells, self._prior, *self._listed
            )
        )  # fmt: skip


def _lists(index: RayIndex) -> tuple[tuple[AnyArray, ...], tuple[AnyArray, ...]]:
    """Return pairs by cell (begin, ray, place, value) and by ray (starts, cells, said, unseen)."""
    begin = index.lists[:, NEAR].astype(np.int64)
    cell = np.repeat(index.listed(), np.diff(begin))
    ray, value = index.near[:, 0] >> 2, index.near.view(np.float32)[:, 1].copy()
    row, column = np.divmod(cell.astype(np.int64), index.grid[WIDTH])
    first = index.rays[ray, START]
    steps = np.abs(column - (first & LOW_32)) + np.abs(row - (first >> 32))
    in_turn = np.lexsort((steps, ray))
    starts = np.zeros(index.n_rays + 1, np.int64)
    np.cumsum(np.bincount(ray, minlength=index.n_rays), out=starts[1:])
    place = np.empty(ray.size, np.int32)
    place[in_turn] = np.arange(ray.size) - starts[ray[in_turn]]
    unseen = index.rays.view(np.float32)[:, UNSEEN].copy()
    return (begin, ray, place, value), (starts, cell[in_turn], value[in_turn], unseen)


def time_beside_plain(
    model: CellModel, start: UInt8Array, seed: int, warm_up: int, sweeps: int
) -> dict[str, Any]:
    """Return ms of the processor of a plain sweep, the ratio of ours to it, and if draws agree.

    The ratio is of the medians of sweeps in turn, after others that warm up.
    """
    ours, plain = model.start(start), PlainSweeps(model, start)
    rngs = [np.random.default_rng(seed) for _ in range(2)]
    times: list[tuple[float, float]] = []
    same = True
    for _ in range(warm_up + sweeps):
        began = time.process_time()
        model.advance(rngs[0], ours)
        between = time.process_time()
        plain.advance(rngs[1])
        times.append((between - began, time.process_time() - between))
        same = same and np.array_equal(ours.cells, plain.cells)
    mine, other = (1e3 * statistics.median(one) for one in zip(*times[warm_up:], strict=True))
    return {
        'median_cpu_ms_per_sweep': round(other, 4),
        'cpu_ratio_to_plain': round(mine / other, 4),
        'same_draws': same,
    }
