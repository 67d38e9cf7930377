"""Takes rays out of a ray index, in place: what is left is the index of the other rays.

Design note: a window at its limit
----------------------------------
Context. A window that is full lets scans go when others come. An index that can only grow was
then built anew: Intel, 870 scans, ten let go for ten others, 1.9 s of processor time where ten
scans more took .27.

Decision. Rays that go are not marked and skipped, which every sweep would pay for, and memory
would hold them. One pass over the index closes up behind them: rays that stay move down and keep
their order, so each list, run of a tile and code is what it would be had the others never come.
What else they leave behind is looked at where they were: only cells that they crossed can have
become uncrossed, or such that no ray tells of them any more, and one or two rays of a cell mostly
say that neither is so. The most that rays can add to a cell is less by what those that go could:
it is counted in grains, so that nothing is left of them, as whether it is 0 decides how often a
cell is drawn (`GRAIN_OF_GAIN`). To add it up anew took .17 of .22 s, Intel.

A ray of several beams holds their sum. Where one of its scans goes, all rays from there go, and
the scans that stay come in once more with those that are new (see `RayWindow.drop`).

Consequence. The arrays are those of an index that was built of the remaining scans, bit for bit
(a test); so are the draws. Save for gains of cells that rays could add more than 1024 nats to,
where a robot stood for hundreds of scans: grains are lost there in float32, upwards, so gains may
be a little higher than anew, never lower (a test). That is a bound as well, and draws of single
cells are the same; a patch may count as near readings that is far in front of them, and be drawn
as often. With 300 scans of a pose dropped 3 of 272 gains are higher, by 2e-4 nats at most, none of
which is 0 anew. Figures: docs/whole_drive.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.sampling.list_growth import sums
from ogm_mcmc.sampling.ray_dropping_kernels import (
    TOLD,
    UNCROSSED,
    drop_entries,
    drop_runs,
    look_again,
    take_gains,
)
from ogm_mcmc.sampling.ray_filing import FULL_FROM, marks_of, moved
from ogm_mcmc.sampling.ray_filing_kernels import walk_front
from ogm_mcmc.sampling.ray_fronts import most_in_tile
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import FRONT, MOST_IN_TILE, NEAR, PAIRS

__all__ = ['Thinned', 'without']


class Thinned(NamedTuple):
    """A ray index without some rays, and the cells (height, width) that no ray tells of any more.

    Of these only such that rays which went had crossed.
    """

    rays: RayIndex
    untold: BoolArray


def without(index: RayIndex, staying: BoolArray, old: GridSpec, new: GridSpec) -> Thinned:
    """Return the index of the rays (N,) that stay, in a window around these; uses up `index`."""
    going = np.flatnonzero(~staying)
    crossed, pairs = _crossed_by(index, going)
    take_gains(going, index.marks, index.lists, index.near, index.rays, index.grid, index.gain)
    before = np.zeros(staying.size + 1, np.int32)
    np.cumsum(staying, out=before[1:])
    number = np.where(staying, before[:-1], np.int32(-1))
    cells, grid = index.listed(), index.grid
    rays, telling = index.rays[staying], index.telling[staying]

    begins, kept = index.lists[:, NEAR].copy(), np.empty(cells.size, np.int32)
    drop_entries(number, begins, np.ones(cells.size, np.uint8), index.near, kept)
    some = np.flatnonzero(kept)
    listed = np.zeros(index.n_cells, np.bool_)
    listed[cells[some]] = True
    marks, gain = marks_of(listed), index.gain[some]
    lists = np.zeros((some.size + 1, 2), np.int32)
    lists[1:, NEAR] = sums(kept[some])
    near = _shrunk(index.near, int(lists[-1, NEAR]))

    full = index.full[some] & (gain > FULL_FROM)
    wanted = np.zeros(cells.size, np.uint8)
    wanted[some] = full
    begins[:] = index.lists[:, FRONT]
    drop_entries(number, begins, wanted, index.front[:, None], kept)
    lists[1:, FRONT] = sums(kept[some])
    drop_runs(before, index.tiles, index.runs, index.run_lengths)
    n_runs = int(index.tiles[-1])
    thinned = index._replace(
        rays=rays, marks=marks, lists=lists, full=full.astype(np.uint8), gain=gain, near=near,
        front=_shrunk(index.front, int(lists[-1, FRONT])), runs=_shrunk(index.runs, n_runs),
        run_lengths=_shrunk(index.run_lengths, n_runs), telling=telling,
    )  # fmt: skip
    grid[PAIRS] -= pairs
    grid[MOST_IN_TILE] = most_in_tile(index.tiles, thinned.run_lengths)
    untold = np.zeros(index.n_cells, np.bool_)
    said = _said_of(thinned, crossed)
    untold[crossed[said < TOLD]] = True
    gone = crossed[said == UNCROSSED]
    np.bitwise_and.at(index.crossed, gone >> 3, ~(np.uint8(1) << (gone & 7).astype(np.uint8)))
    box = old.box.intersection(new.box)
    return Thinned(
        moved(thinned, old, new), untold.reshape(old.height, old.width)[old.slices(box)]
    )


def _crossed_by(index: RayIndex, gone: AnyArray) -> tuple[AnyArray, int]:
    """Return the cells (n,) int32 that some rays cross, and with how many pairs."""
    crossed, n_tiles = np.zeros_like(index.crossed), index.tiles.size - 1
    last, run, n_runs = np.full(n_tiles, -2, np.int32), *np.zeros((2, n_tiles), np.int32)
    pairs = walk_front(
        0, gone.size, index.rays[gone], index.marks, index.full, index.grid, crossed, last, run,
        n_runs, np.zeros(index.full.size, np.int32), index.runs, index.run_lengths,
        np.empty(0, np.int32), False,
    )  # fmt: skip
    return index._replace(crossed=crossed).touched(), int(pairs)


def _said_of(index: RayIndex, cells: AnyArray) -> AnyArray:
    said = np.empty(cells.size, np.uint8)
    look_again(
        cells, index.telling, index.marks, index.lists, index.full, index.near, index.front,
        index.tiles, index.runs, index.run_lengths, index.rays, index.grid, said,
    )  # fmt: skip
    return said


def _shrunk(array: AnyArray, size: int) -> AnyArray:
    """Give the end of an array back where it lies."""
    array.resize((size, *array.shape[1:]), refcheck=False)
    return array
