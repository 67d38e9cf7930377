"""Enters rays of an index where they are level: in tiles, and in the lists that are full."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.sampling.list_growth import grown, in_turn, next_places, side_by_side, sums
from ogm_mcmc.sampling.ray_filing_kernels import fill_fronts, spread, walk_front
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import FRONT, MOST_IN_TILE, PAIRS

__all__ = ['most_in_tile', 'parts_of', 'with_fronts']

SHARED_FROM = 20_000
"""So many rays and more are entered by two threads, half of them each."""

# Sums take eight bytes a run.
TILES_AT_ONCE = 256


def parts_of(n_rays: int) -> int:
    """Return by how many threads so many rays are entered."""
    return 2 if n_rays >= SHARED_FROM else 1


def with_fronts(
    index: RayIndex,
    n_old: int,
    before: AnyArray,
    where_old: AnyArray,
    becoming: AnyArray,
) -> RayIndex:
    """Enter the rays from `n_old` on where they are level: in tiles and in full lists.

    before, where_old  where the front rays of lists began, and what number these have now
    becoming           lists that are full from now on
    """
    rays, marks, grid, full = index.rays, index.marks, index.grid, index.full
    runs, run_lengths, front, tiles = index.runs, index.run_lengths, index.front, index.tiles
    places = index.listed()[becoming].astype(np.int64)
    n_lists = full.size
    walks = _walks(index, n_old, n_lists)
    nothing = np.empty(0, np.int32)
    old_tiles = tiles, runs, run_lengths
    fill_fronts(becoming, places, n_old, *old_tiles, rays, grid, walks[0].n_front, nothing)

    def count(walk: _Walk) -> None:
        walk.pairs[0] = walk_front(
            walk.begin, walk.end, rays, marks, full, grid, walk.crossed, walk.last.copy(),
            walk.run.copy(), walk.n_runs, walk.n_front, runs, run_lengths, nothing, False,
        )  # fmt: skip

    side_by_side(count, [(walk,) for walk in walks])
    for walk in walks:
        grid[PAIRS] += walk.pairs[0]
        index.crossed[:] |= walk.crossed
    more = np.zeros(n_lists, np.int64)
    for walk in walks:
        more += walk.n_front
    more[where_old] += np.diff(before)
    index.lists[1:, FRONT] = sums(more)
    del more
    next_front = next_places(before, where_old, index.lists[:, FRONT])
    front = grown(front, int(index.lists[-1, FRONT]))
    if where_old.size:
        spread(before, where_old, index.lists[:, FRONT].astype(np.int64), front[:, None])
    next_fronts = in_turn(next_front, [walk.n_front for walk in walks])
    del next_front
    fill_fronts(becoming, places, n_old, *old_tiles, rays, grid, next_fronts[0], front)
    del places

    begins = tiles.astype(np.int64)
    after = np.zeros_like(tiles)
    after[1:] = sums(np.diff(begins) + sum(walk.n_runs for walk in walks))
    every = np.arange(tiles.size - 1)
    next_run = next_places(begins, every, after)
    runs, run_lengths = grown(runs, int(after[-1])), grown(run_lengths, int(after[-1]))
    spread(begins, every, after.astype(np.int64), runs[:, None])
    spread(begins, every, after.astype(np.int64), run_lengths[:, None])
    next_runs = in_turn(next_run, [walk.n_runs for walk in walks])

    def enter(walk: _Walk, next_run: AnyArray, next_front: AnyArray) -> None:
        walk_front(
            walk.begin, walk.end, rays, marks, full, grid, walk.crossed, walk.last, walk.run,
            next_run, next_front, runs, run_lengths, front, True,
        )  # fmt: skip

    side_by_side(enter, list(zip(walks, next_runs, next_fronts, strict=True)))
    grid[MOST_IN_TILE] = most_in_tile(after, run_lengths)
    return index._replace(front=front, tiles=after, runs=runs, run_lengths=run_lengths)


class _Walk(NamedTuple):
    """Rays that are followed in turn, and what is met: see `walk_front`.

    crossed  bits of the cells that they cross; last, run: of each tile, where they begin
    n_runs, n_front, pairs  how many runs (Q,), front rays of lists (S,) and pairs (1,) they add
    """

    begin: int
    end: int
    crossed: AnyArray
    last: AnyArray
    run: AnyArray
    n_runs: AnyArray
    n_front: AnyArray
    pairs: AnyArray

    @classmethod
    def of(
        cls, rays: tuple[int, int], crossed: AnyArray, last: tuple[AnyArray, AnyArray], lists: int
    ) -> _Walk:
        n_runs, n_front = np.zeros_like(last[0]), np.zeros(lists, np.int32)
        return cls(*rays, crossed, *last, n_runs, n_front, np.zeros(1, np.int64))


def _walks(index: RayIndex, n_old: int, n_lists: int) -> list[_Walk]:
    """Return the walks along the rays from `n_old` on: two if they are many."""
    last, run = _last_runs(index)
    end = index.n_rays
    if parts_of(end - n_old) == 1:
        return [_Walk.of((n_old, end), index.crossed, (last, run), n_lists)]
    middle = (n_old + end) // 2
    nothing = np.full_like(last, -2), np.zeros_like(run)
    return [
        _Walk.of((n_old, middle), index.crossed, (last, run), n_lists),
        _Walk.of((middle, end), np.zeros_like(index.crossed), nothing, n_lists),
    ]


def _last_runs(index: RayIndex) -> tuple[AnyArray, AnyArray]:
    """Return the last ray of each tile, and how long its last run is, (Q,) int32."""
    last = np.full(index.tiles.size - 1, -2, np.int32)
    run = np.zeros(index.tiles.size - 1, np.int32)
    some = np.flatnonzero(np.diff(index.tiles))
    at = index.tiles[some + 1] - 1
    run[some] = index.run_lengths[at]
    last[some] = index.runs[at] + run[some] - 1
    return last, run


def most_in_tile(tiles: AnyArray, run_lengths: AnyArray) -> int:
    """Return how many rays the fullest tile has."""
    some, most = np.flatnonzero(np.diff(tiles)), 0
    for at in range(0, some.size, TILES_AT_ONCE):
        begins = tiles[some[at : at + TILES_AT_ONCE]]
        end = tiles[some[min(at + TILES_AT_ONCE, some.size) - 1] + 1]
        here = run_lengths[begins[0] : end]
        most = max(most, int(np.add.reduceat(here, begins - begins[0], dtype=np.int64).max()))
    return most
