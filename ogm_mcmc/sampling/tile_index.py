"""The part of a ray index that one tile of a map needs, made without ever having the whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array
from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.sampling.beam_rays import BeamRays, rays_of_scan
from ogm_mcmc.sampling.informed_kernels import mark_arrivals
from ogm_mcmc.sampling.ray_batch import Batch, Part
from ogm_mcmc.sampling.ray_filing import Said, assembled, extended
from ogm_mcmc.sampling.ray_filing_kernels import lay_rays
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import NEAR, WIDTH
from ogm_mcmc.sampling.ray_line_kernels import (
    RAY_WORDS,
    RIGHTWARDS,
    SHAPE,
    START,
    UNSEEN,
    UPWARDS,
)
from ogm_mcmc.sampling.ray_merging import Joining
from ogm_mcmc.sampling.ray_stands import Stands, settled
from ogm_mcmc.sampling.ray_window import RayWindow
from ogm_mcmc.sampling.tile_kernels import cut_rays
from ogm_mcmc.sampling.tiles import Tiling
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['TileRays', 'arrivals', 'batch_of', 'tile_rays']

# Rays that are indexed at a time, on their way to what is kept of them.
BLOCK = 20_000


class TileRays(NamedTuple):
    """The n rays that cross a tile's box, cut to it, and their V visits to its pieces.

    `local`: their index of the cells of the box; `numbers` (n,) int32: which rays of the window;
    `begins` (n + 1,) int32: the first visit of each; `along` (V,) int32: how many places behind
    the first one of the whole ray a visit begins, and `entered` (V,) int32 at which place of the
    box; `unseen` (n,) float32 and `telling` (n,) int32 of whole rays: log p(z | nothing on it),
    and how many places it tells anything of.
    """

    local: RayIndex
    numbers: AnyArray
    begins: AnyArray
    along: AnyArray
    entered: AnyArray
    unseen: Float32Array
    telling: AnyArray

    @property
    def n_bytes(self) -> int:
        """Memory of all arrays."""
        return self.local.n_bytes + sum(int(array.nbytes) for array in self[1:])

    def told(self) -> BoolArray:
        """Cells of the box (K,) that a ray with something to tell would come to, were all free."""
        told = np.zeros(self.local.n_cells, np.float32)
        nothing = np.zeros(self.local.n_cells, np.float32)
        here = (self.telling - self.along[self.begins[:-1]]).astype(np.int32)
        mark_arrivals(
            here, nothing, np.float32(0.0), self.local.rays, self.local.grid[WIDTH], told
        )
        found: BoolArray = told > 0.0
        return found


class _Part(NamedTuple):
    """What a block of rays leaves in a tile; `near` (T, 2) lie in `cells`, `counts` in each."""

    rays: AnyArray
    numbers: AnyArray
    visits: AnyArray
    along: AnyArray
    unseen: Float32Array
    telling: AnyArray
    cells: AnyArray
    counts: AnyArray
    gain: Float32Array
    near: AnyArray


def tile_rays(
    scans: Sequence[PlacedScan],
    config: WindowConfig,
    model: ForwardModelConfig,
    tiling: Tiling,
    tile: int,
) -> TileRays:
    """Return what a tile of the window of these scans holds.

    Raises WindowError when that takes more than `max_memory_mb`; while it is made there is about
    twice as much for a moment.
    """

    def check(n_bytes: int) -> None:
        if n_bytes > config.max_memory_mb * 1e6:
            raise WindowError(
                f'tile {tile + 1} of {len(tiling.tiles)} needs more than max_memory_mb = '
                f'{config.max_memory_mb:g}: expected more tiles, or fewer scans'
            )

    box, parts, held = tiling.tiles[tile].box, [], 0
    forward = ForwardModel.from_config(model)
    batch = batch_of(scans, config, model)
    nothing = RayWindow(config, model).index
    for part in batch.parts(BLOCK):
        crossing = _may_cross(part.rays, box)
        if not crossing.any():
            continue
        chosen = BeamRays(*(array[crossing] for array in part.rays))
        said = partial(_said, batch, part, crossing, tiling.tiles[tile].core)
        indexed = _indexed(nothing, chosen, said, config, forward)
        parts.append(_part(indexed, part.first + np.flatnonzero(crossing), tiling, tile))
        held += sum(int(array.nbytes) for array in parts[-1])
        check(held)
    rays = _joined(nothing, parts, tiling.spec.windowed(box))
    check(rays.n_bytes)
    return rays


def batch_of(
    scans: Sequence[PlacedScan], config: WindowConfig, model: ForwardModelConfig
) -> Batch:
    """Return the rays of scans as a window has them that merges beams which run along together.

    Raises GridError for a ray that is too long.
    """
    forward = ForwardModel.from_config(model)

    def cast(placed: PlacedScan) -> BeamRays:
        return rays_of_scan(placed, config, forward.sigma_m, model.grazing_m)

    taken, _ = settled(scans, Stands(), config)
    return Batch(taken, cast, Joining({}, 0, taken, cast, forward, config.resolution))


def arrivals(
    batch: Batch,
    model: ForwardModelConfig,
    spec: GridSpec,
    telling: AnyArray,
    probability: Float32Array,
    least: float,
) -> Float32Array:
    """Return what `informed.arrival` does, without an index: rays are laid and forgotten."""
    found = np.zeros(spec.width * spec.height, np.float32)
    scratch = np.zeros(found.size, np.int32)
    forward = ForwardModel.from_config(model)
    for first, beams, _ in batch.parts(BLOCK):
        here = beams._replace(column=beams.column - spec.column0, row=beams.row - spec.row0)
        rays = np.empty((here.length.size, RAY_WORDS), np.int64)
        lay_rays(here, forward, spec.resolution_m, spec.width, rays, scratch)
        mine = telling[first : first + len(rays)]
        mark_arrivals(mine, probability, np.float32(least), rays, spec.width, found)
    return found


def _said(batch: Batch, part: Part, chosen: BoolArray, core: CellBox) -> Iterator[Said]:
    """Yield what beams say more of the `chosen` rays (n,) of a part.

    What their log-likelihoods leave out (see `RayIndex`) counts where they come from within
    `core`: no two tiles count it.
    """
    number = np.cumsum(chosen) - 1
    for beams, rays in batch.more_of(part):
        mine = chosen[rays - part.first]
        if not mine.any():
            continue
        column, row = beams.column[0], beams.row[0]
        yield Said(
            BeamRays(*(array[mine] for array in beams)),
            number[rays[mine] - part.first],
            bool(core.column0 <= column < core.column1 and core.row0 <= row < core.row1),
        )


def _ends(beams: BeamRays) -> tuple[AnyArray, AnyArray]:
    return (
        beams.column + np.floor(beams.x + beams.length * beams.ux).astype(np.int64),
        beams.row + np.floor(beams.y + beams.length * beams.uy).astype(np.int64),
    )


def _may_cross(beams: BeamRays, box: CellBox) -> BoolArray:
    """Which rays come near to a box: one cell more, for rounding."""
    column, row = _ends(beams)
    near: BoolArray = (
        (np.maximum(beams.column, column) >= box.column0 - 1)
        & (np.minimum(beams.column, column) <= box.column1)
        & (np.maximum(beams.row, row) >= box.row0 - 1)
        & (np.minimum(beams.row, row) <= box.row1)
    )
    return near


def _indexed(
    nothing: RayIndex,
    beams: BeamRays,
    said: Callable[[], Iterator[Said]],
    config: WindowConfig,
    model: ForwardModel,
) -> tuple[RayIndex, GridSpec]:
    """Return the index of a few whole rays, with all that is `said` of them, in its own window."""
    column, row = _ends(beams)
    box = CellBox(
        int(min(beams.column.min(), column.min())) - 1,
        int(min(beams.row.min(), row.min())) - 1,
        int(max(beams.column.max(), column.max())) + 2,
        int(max(beams.row.max(), row.max())) + 2,
    )
    one = GridSpec(config.resolution, 1, 1)
    spec = one.windowed(box)

    def here(rays: BeamRays) -> BeamRays:
        return rays._replace(column=rays.column - spec.column0, row=rays.row - spec.row0)

    new, n = here(beams), beams.length.size
    more = lambda: (some._replace(beams=here(some.beams)) for some in said())  # noqa: E731
    return extended(nothing, one, spec, [lambda: iter([new])], n, model, more), spec


def _part(
    indexed: tuple[RayIndex, GridSpec], numbers: AnyArray, tiling: Tiling, tile: int
) -> _Part:
    index, spec = indexed
    box = tiling.tiles[tile].box
    columns, rows, in_row = tiling.pieces(box)
    across, up = spec.column0 - box.column0, spec.row0 - box.row0
    n, visits = index.n_rays, int(columns[-1] - columns[0] + rows[-1] - rows[0]) + 1
    cut, kept = np.empty((n, RAY_WORDS), np.int64), np.empty(n, np.int32)
    piece, along = np.empty(n * visits, np.int32), np.empty(n * visits, np.int32)
    begins = np.empty(n + 1, np.int32)
    count = cut_rays(
        index.rays, across, up, columns, rows, in_row, cut, kept, piece, along, begins
    )
    kept, begins = kept[:count], begins[: count + 1]
    listed = index.listed().astype(np.int64)
    row, column = np.divmod(listed, spec.width)
    column, row = column + across, row + up
    inside = (column >= 0) & (column < columns.size) & (row >= 0) & (row < rows.size)
    counts = np.diff(index.lists[:, NEAR])
    near = index.near[np.repeat(inside, counts)]
    mine = np.full(n, -1, np.int32)
    mine[kept] = np.arange(count, dtype=np.int32)
    near[:, 0] = (mine[near[:, 0] >> 2] << 2) | (near[:, 0] & 3)
    return _Part(
        cut[:count].copy(),
        numbers[kept].astype(np.int32),
        np.diff(begins),
        along[: begins[-1]].copy(),
        index.rays.view(np.float32)[kept, UNSEEN],
        index.telling[kept],
        (row * columns.size + column)[inside].astype(np.int32),
        counts[inside],
        index.gain[inside],
        near,
    )


def _joined(nothing: RayIndex, parts: list[_Part], spec: GridSpec) -> TileRays:
    """Return parts as one; `parts` is used up."""
    n_cells = spec.width * spec.height
    totals, gain = np.zeros(n_cells, np.int32), np.zeros(n_cells)
    for part in parts:
        totals[part.cells] += part.counts
        gain[part.cells] += part.gain
    cells = np.flatnonzero(totals).astype(np.int32)
    following = np.zeros(n_cells, np.int64)
    following[cells[1:]] = np.cumsum(totals[cells[:-1]], dtype=np.int64)
    near = np.empty((int(totals.sum(dtype=np.int64)), 2), np.int32)
    names = 'rays', 'numbers', 'visits', 'along', 'unseen', 'telling'
    kept: dict[str, list[AnyArray]] = {name: [getattr(p, name) for p in parts] for name in names}
    before, parts[:] = 0, parts[::-1]
    while parts:
        part = parts.pop()
        own = np.cumsum(part.counts) - part.counts
        places = np.repeat(following[part.cells] - own, part.counts) + np.arange(len(part.near))
        near[places, 0] = part.near[:, 0] + np.int32(before << 2)
        near[places, 1] = part.near[:, 1]
        following[part.cells] += part.counts
        before += part.numbers.size
    del following
    joined = {
        name: np.concatenate(arrays) if arrays else np.empty(0, np.int32)
        for name, arrays in kept.items()
    }
    rays = joined['rays'].reshape(-1, RAY_WORDS).astype(np.int64, copy=False)
    kept.clear()
    # Sums of bounds, rounded upwards.
    most = (gain[cells] * (1.0 + 2.0**-22)).astype(np.float32)
    index = assembled(nothing, spec, rays, cells, totals[cells], near, most)
    begins = np.zeros(len(rays) + 1, np.int32)
    np.cumsum(joined['visits'], out=begins[1:])
    along = joined['along'].astype(np.int32, copy=False)
    starts = _first_places(rays) - along[begins[:-1]] if len(rays) else np.empty(0, np.int32)
    entered = along + np.repeat(starts, np.diff(begins)).astype(np.int32)
    return TileRays(
        index,
        joined['numbers'],
        begins,
        along,
        entered.astype(np.int32),
        joined['unseen'].astype(np.float32, copy=False),
        joined['telling'],
    )


def _first_places(rays: AnyArray) -> AnyArray:
    """Return the places of the first cells of rays; see `ray_line_kernels.place_of`."""
    shape, start = rays[:, SHAPE], rays[:, START]
    flags, column, row = shape >> 48, start & 0xFFFFFFFF, start >> 32
    places: AnyArray = np.where(flags & RIGHTWARDS, column, -column) + np.where(
        flags & UPWARDS, row, -row
    )
    return places
