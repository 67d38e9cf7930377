"""Extends a ray index by more rays, in place, with next to no memory but what is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.sampling.beam_rays import BeamRays
from ogm_mcmc.sampling.list_growth import grown, next_places, side_by_side, sums
from ogm_mcmc.sampling.ray_filing_kernels import file_near, lay_rays, spread
from ogm_mcmc.sampling.ray_fronts import with_fronts
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import (
    CELLS,
    FRONT,
    GRID_SIZE,
    MOST_IN_TILE,
    NEAR,
    PAIRS,
    TILE_BITS,
    TILE_COLUMNS,
    TILE_X,
    TILE_Y,
    WIDTH,
)
from ogm_mcmc.sampling.ray_line_kernels import BORDER, START
from ogm_mcmc.sampling.ray_merging_kernels import add_beams
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['Said', 'assembled', 'extended', 'marks_of', 'moved']

FULL_FROM = 1.0
"""Nats: lists of cells that rays can lift by more than this are full."""

MOST_RAYS = 2**29

# Sums in float64 take eight bytes a list.
GAINS_AT_ONCE = 8192

Blocks = Callable[[], Iterator[BeamRays]]


class Said(NamedTuple):
    """Beams that say more of rays, and the numbers (n,) of these.

    What their log-likelihoods leave out counts in this index unless another one counts it.
    """

    beams: BeamRays
    rays: AnyArray
    counts: bool = True


def extended(
    index: RayIndex,
    old: GridSpec,
    new: GridSpec,
    parts: Sequence[Blocks],
    n_more: int,
    model: ForwardModel,
    added: Callable[[], Iterator[Said]] = lambda: iter(()),
) -> RayIndex:
    """Return the index with `n_more` rays in a window that covers the old one; uses up `index`.

    `parts` yield the new rays, one after the other, a block at a time, in cells of the new window;
    each is called twice, the second time in a thread of its own.
    `added` yields what beams say more of rays, new or old.
    """
    if n_more == 0 and old == new:
        index = _with_more_said(index, added, new, model)
        if not ((index.gain > FULL_FROM) & (index.full == 0)).any():
            return index
        added = lambda: iter(())  # noqa: E731
    n_old, n_cells = index.n_rays, new.width * new.height
    if n_old + n_more >= MOST_RAYS:
        raise WindowError(f'{n_old + n_more} rays: expected fewer than {MOST_RAYS}')
    old_cells = _moved_cells(index.listed(), old, new)
    grid = _grid(new)
    grid[PAIRS] = index.grid[PAIRS]
    rays = grown(_moved_rays(index.rays, old, new), n_old + n_more)
    counts = np.zeros(n_cells, np.int32)
    begins, counted = _lay_parts(parts, n_old, rays, counts, new, model)
    listed = counts > 0
    listed[old_cells] = True
    marks = marks_of(listed)
    cells = np.flatnonzero(listed).astype(np.int32)
    where_old = np.searchsorted(cells, old_cells)
    more = counts[cells].astype(np.int64)
    del counts, listed

    lists = np.zeros((cells.size + 1, 2), np.int32)
    before = index.lists[:, NEAR].astype(np.int64)
    more[where_old] += np.diff(before)
    lists[1:, NEAR] = sums(more)
    del more
    next_near = next_places(before, where_old, lists[:, NEAR])
    following = _following(next_near, cells, counted)
    n_lists = cells.size
    del next_near, counted, cells
    near = grown(index.near, int(lists[-1, NEAR]))
    if where_old.size:
        spread(before, where_old, lists[:, NEAR].astype(np.int64), near)
    gain = _at(index.gain, where_old, n_lists)
    telling = grown(index.telling, n_old + n_more)
    filed = index._replace(
        rays=rays, marks=marks, lists=lists, gain=gain, near=near, telling=telling, grid=grid
    )
    _file_parts(filed, parts, begins, following, new, model)
    del following
    _with_more_said(filed, added, new, model)
    full = _at(index.full, where_old, n_lists)
    becoming = np.flatnonzero((gain > FULL_FROM) & (full == 0))
    full[becoming] = 1
    kept = filed._replace(
        full=full,
        tiles=_moved_tiles(index.tiles, old, new),
        crossed=_moved_bits(index, old, new),
    )  # fmt: skip
    before = index.lists[:, FRONT].astype(np.int64)
    return with_fronts(kept, n_old, before, where_old, becoming)


def _lay_parts(
    parts: Sequence[Blocks],
    n_old: int,
    rays: AnyArray,
    counts: AnyArray,
    spec: GridSpec,
    model: ForwardModel,
) -> tuple[list[int], list[tuple[AnyArray, AnyArray]]]:
    """Fill `rays` from number `n_old` on, and count in `counts` (K,) int32 their near cells.

    Returns of each part its first number, and cells that rays of those before it are near to and
    how many are.
    """
    at = n_old
    begins: list[int] = []
    counted: list[tuple[AnyArray, AnyArray]] = []
    for part in parts:
        begins.append(at)
        earlier = np.flatnonzero(counts).astype(np.int32) if counted else np.empty(0, np.int32)
        counted.append((earlier, counts[earlier]))
        for block in part():
            n = block.length.size
            lay_rays(block, model, spec.resolution_m, spec.width, rays[at : at + n], counts)
            at += n
    return begins, counted


def _following(
    first: AnyArray, cells: AnyArray, counted: Sequence[tuple[AnyArray, AnyArray]]
) -> list[AnyArray]:
    """Return where the next entry of each list goes, of each part; takes over `first`, (S,) int32.

    cells (S,): of the lists; counted: as `_lay_parts` tells it
    """
    following = [first]
    for earlier, n_earlier in counted[1:]:
        later = first.copy()
        later[np.searchsorted(cells, earlier)] += n_earlier
        following.append(later)
    return following


def _file_parts(
    index: RayIndex,
    parts: Sequence[Blocks],
    begins: Sequence[int],
    following: Sequence[AnyArray],
    spec: GridSpec,
    model: ForwardModel,
) -> None:
    """Enter the rays of each part, from these numbers on, in the near lists of an index.

    following  of each part: where the next entry of each list goes, (S,) int32; used up
    """

    def one(number: int, gain: AnyArray) -> None:
        at = begins[number]
        for block in parts[number]():
            file_near(
                block, model, spec.resolution_m, at, index.rays, index.marks, following[number],
                index.near, gain, index.telling, index.grid,
            )  # fmt: skip
            at += block.length.size

    gains = [index.gain, *(np.zeros_like(index.gain) for _ in parts[1:])]
    side_by_side(one, list(enumerate(gains)))
    for more in gains[1:]:
        for at in range(0, more.size, GAINS_AT_ONCE):
            gain, added = index.gain[at : at + GAINS_AT_ONCE], more[at : at + GAINS_AT_ONCE]
            exact = gain + added.astype(np.float64)
            gain[:] = exact
            # A bound must not be rounded down.
            np.nextafter(gain, np.float32(np.inf), out=gain, where=gain < exact)


def _with_more_said(
    index: RayIndex,
    added: Callable[[], Iterator[Said]],
    spec: GridSpec,
    model: ForwardModel,
) -> RayIndex:
    """Add beams to rays, in place; return the same index."""
    for said in added():
        left_out = add_beams(
            said.beams, said.rays, model, spec.resolution_m, index.rays, index.marks, index.lists,
            index.near, index.gain, index.telling, index.grid,
        )  # fmt: skip
        if said.counts:
            index.left_out[0] += left_out
    return index


def assembled(
    nothing: RayIndex,
    spec: GridSpec,
    rays: AnyArray,
    cells: AnyArray,
    counts: AnyArray,
    near: AnyArray,
    gain: AnyArray,
) -> RayIndex:
    """Return the index of rays that are laid and whose near pairs are known.

    nothing  an index without rays; spec: of the window; rays (N, 5) int64: their lines
    cells, counts, gain  (S,) of each list, in rising order; near (T, 2) int32: all near pairs
    """
    lists = np.zeros((cells.size + 1, 2), np.int32)
    lists[1:, NEAR] = sums(counts.astype(np.int64))
    n_cells, (up, across) = spec.width * spec.height, _tile_shape(spec)
    listed = np.zeros(n_cells, np.bool_)
    listed[cells] = True
    index = nothing._replace(
        rays=rays, marks=marks_of(listed), lists=lists, full=(gain > FULL_FROM).astype(np.uint8),
        gain=gain, near=near, tiles=np.zeros(up * across + 1, np.int32), grid=_grid(spec),
        crossed=np.zeros((n_cells + 7) // 8, np.uint8),
    )  # fmt: skip
    none = np.empty(0, np.int64)
    return with_fronts(index, 0, np.zeros(1, np.int64), none, none)


def _grid(spec: GridSpec) -> AnyArray:
    side = 1 << TILE_BITS
    grid = np.zeros(GRID_SIZE, np.int64)
    grid[WIDTH], grid[CELLS] = spec.width, spec.width * spec.height
    grid[TILE_X], grid[TILE_Y] = spec.column0 % side, spec.row0 % side
    grid[TILE_COLUMNS] = _tile_shape(spec)[1]
    return grid


def _tile_shape(spec: GridSpec) -> tuple[int, int]:
    """Return how many tiles, anchored on the lattice, a window has up and across."""
    box = spec.box
    return (
        ((box.row1 - 1) >> TILE_BITS) - (box.row0 >> TILE_BITS) + 1,
        ((box.column1 - 1) >> TILE_BITS) - (box.column0 >> TILE_BITS) + 1,
    )


def _at(values: AnyArray, where: AnyArray, size: int) -> AnyArray:
    result = np.zeros(size, values.dtype)
    result[where] = values
    return result


def marks_of(listed: BoolArray) -> AnyArray:
    """Return bits of which cells have a list, and how many lists there are before each word."""
    words = (listed.size + 63) // 64
    marks = np.zeros((words, 2), np.uint64)
    packed = np.zeros(8 * words, np.uint8)
    bits = np.packbits(listed, bitorder='little')
    packed[: bits.size] = bits
    marks[:, 0] = packed.view(np.uint64)
    marks[1:, 1] = np.cumsum(np.bitwise_count(marks[:-1, 0]), dtype=np.uint64)
    return marks


def moved(index: RayIndex, old: GridSpec, new: GridSpec) -> RayIndex:
    """Return an index on another window, in which all its rays lie; uses up `index`."""
    if old == new:
        return index
    listed, grid = np.zeros(new.width * new.height, np.bool_), _grid(new)
    listed[_moved_cells(index.listed(), old, new)] = True
    grid[[PAIRS, MOST_IN_TILE]] = index.grid[[PAIRS, MOST_IN_TILE]]
    return index._replace(
        rays=_moved_rays(index.rays, old, new), marks=marks_of(listed), grid=grid,
        tiles=_moved_tiles(index.tiles, old, new), crossed=_moved_bits(index, old, new),
    )  # fmt: skip


def _moved_cells(cells: AnyArray, old: GridSpec, new: GridSpec) -> AnyArray:
    row, column = np.divmod(cells.astype(np.int64), old.width)
    moved: AnyArray = (row + (old.row0 - new.row0)) * new.width
    return moved + column + (old.column0 - new.column0)


def _moved_rays(rays: AnyArray, old: GridSpec, new: GridSpec) -> AnyArray:
    if rays.size:
        across, up = old.column0 - new.column0, old.row0 - new.row0
        rays[:, BORDER] += across << 40
        rays[:, START] += across + (up << 32)
    return rays


def _moved_bits(index: RayIndex, old: GridSpec, new: GridSpec) -> AnyArray:
    crossed = np.zeros((new.height, new.width), np.bool_)
    if index.n_rays:
        box = old.box.intersection(new.box)
        touched = index.is_touched().reshape(old.height, old.width)
        crossed[new.slices(box)] = touched[old.slices(box)]
    bits: AnyArray = np.packbits(crossed.reshape(-1), bitorder='little')
    return bits


def _moved_tiles(tiles: AnyArray, old: GridSpec, new: GridSpec) -> AnyArray:
    """Return where the runs of each tile begin in another window; tiles keep their order."""
    shape, old_shape = _tile_shape(new), _tile_shape(old)
    up = (old.row0 >> TILE_BITS) - (new.row0 >> TILE_BITS)
    across = (old.column0 >> TILE_BITS) - (new.column0 >> TILE_BITS)
    counts = np.zeros(shape, np.int32)
    if tiles[-1]:
        rows, columns = (
            _overlap(up, old_shape[0], shape[0]),
            _overlap(across, old_shape[1], shape[1]),
        )
        here, there = zip(rows, columns, strict=True)
        counts[there] = np.diff(tiles).reshape(old_shape)[here]
    moved_tiles = np.zeros(counts.size + 1, np.int32)
    np.cumsum(counts, out=moved_tiles[1:])
    return moved_tiles


def _overlap(shift: int, old: int, new: int) -> tuple[slice, slice]:
    """Return which of `old` places in a row, moved by `shift`, are among `new` ones, and where."""
    first, end = max(0, -shift), min(old, new - shift)
    return slice(first, end), slice(first + shift, end + shift)
