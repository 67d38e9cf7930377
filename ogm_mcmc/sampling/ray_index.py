"""Which rays touch which cell, and what each ray would say if it ended there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, Float64Array
from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.sampling.beam_rays import (
    BeamRays,
    limited,
    most_cells,
    most_near_cells,
    rays_of_scan,
)
from ogm_mcmc.sampling.ray_batch import Batch, in_blocks
from ogm_mcmc.sampling.ray_filing import extended
from ogm_mcmc.sampling.ray_index_kernels import CELLS, GRID_SIZE, NEAR, PAIRS, WIDTH, list_of
from ogm_mcmc.sampling.ray_line_kernels import (
    LEVEL,
    RAY_WORDS,
    SHAPE,
    UNSEEN,
    cells_of_ray,
    places_of,
)
from ogm_mcmc.sampling.ray_merging import Joining, Places
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['BeamRays', 'RayIndex', 'RayWindow', 'WindowSize']


class RayIndex(NamedTuple):
    """N rays and the K cells of a window; see the design note of the package.

    Rays: `rays` (N, 5) int64, their lines; see `ogm_mcmc.sampling.ray_line_kernels`.
    Lists: a cell has one if a ray is near to it, which means that the ray's likelihood is not
    level there. `marks` (ceil(K / 64), 2) uint64: bits that say which cells have one, and how
    many lists there are before; `lists` (S + 1, 2) int32: where the near pairs and the front rays
    of each list begin; `near` (T, 2) int32: code of the ray and, as the bits of a float32,
    log p(z | this cell is its first hit); `front` (F,) int32: codes of the rays that cross the
    cell where their likelihood is level, in lists that are `full` (S,) uint8. Codes rise.
    `gain` (S,) float32: the most that its rays can add to a cell's log-odds; 0 without a list.
    Tiles of 8 x 8 cells, on the lattice: tile q owns `runs` (R,) int32 from `tiles[q]` to
    `tiles[q + 1]` (Q + 1,) int32, the first of `run_lengths` (R,) uint8 rays with numbers one
    after the other, that cross it where they are level. In cells without a full list these have
    to be looked through.
    `crossed` (ceil(K / 8),) uint8: a bit for each cell that a ray crosses. `grid` (7,) int64: the
    width and other numbers, see `ogm_mcmc.sampling.ray_index_kernels`.
    `telling` (N,) int32: how many places of each ray, from its first on, it tells anything of; to
    end at the others is as good as not to end at all. `left_out` (1,) float64: nats that the
    log-likelihoods of rays of several beams leave out (see `ogm_mcmc.sampling.ray_merging`).
    """

    rays: AnyArray
    marks: AnyArray
    lists: AnyArray
    full: AnyArray
    gain: AnyArray
    near: AnyArray
    front: AnyArray
    tiles: AnyArray
    runs: AnyArray
    run_lengths: AnyArray
    crossed: AnyArray
    grid: AnyArray
    telling: AnyArray
    left_out: Float64Array

    @property
    def n_rays(self) -> int:
        """Number of rays, N."""
        return int(self.rays.shape[0])

    @property
    def n_pairs(self) -> int:
        """Number of pairs of a ray and a cell it crosses."""
        return int(self.grid[PAIRS])

    @property
    def n_cells(self) -> int:
        """K, cells that no ray crosses included."""
        return int(self.grid[CELLS])

    @property
    def n_bytes(self) -> int:
        """Memory of all arrays."""
        return sum(int(array.nbytes) for array in self)

    def arrays(self) -> tuple[AnyArray, ...]:
        """Return the arrays that kernels take one by one, in their order, with views as float32.

        marks, lists, full, gain, near, near_bits, front, tiles, runs, run_lengths, rays,
        ray_bits, grid
        """
        near_bits, ray_bits = self.near.view(np.float32), self.rays.view(np.float32)
        return (
            *(self.marks, self.lists, self.full, self.gain, self.near, near_bits, self.front),
            *(self.tiles, self.runs, self.run_lengths, self.rays, ray_bits, self.grid),
        )

    def ray(self, number: int) -> tuple[AnyArray, Float32Array, float]:
        """Return the cells of a ray in order, log p(z | each is its first hit), and none is."""
        ray = self.rays[number]
        shape = int(ray[SHAPE])
        columns, rows = np.empty((2, places_of(shape)), np.int64)
        count = cells_of_ray(ray, columns, rows)
        columns, rows = columns[:count], rows[:count]
        cells: AnyArray = rows * self.grid[WIDTH] + columns
        level, unseen = self.rays.view(np.float32)[number, [LEVEL, UNSEEN]]
        values = np.full(count, level, np.float32)
        code = number << 2 | shape >> 48 & 3
        places = np.abs(columns - columns[0]) + np.abs(rows - rows[0])
        for i in np.flatnonzero(places >= (shape >> 32 & 0xFFFF)):
            which = list_of(int(cells[i]), self.marks)
            begin, end = self.lists[which : which + 2, NEAR]
            at = begin + np.searchsorted(self.near[begin:end, 0], code)
            values[i] = self.near.view(np.float32)[at, 1]
        return cells, values, float(unseen)

    def listed(self) -> AnyArray:
        """Cells (S,) int32 that have a list, in rising order."""
        return _set_bits(self.marks[:, 0].copy().view(np.uint8), self.n_cells)

    def touched(self) -> AnyArray:
        """Cells (C,) int32 that a ray crosses, in rising order."""
        return _set_bits(self.crossed, self.n_cells)

    def is_touched(self) -> BoolArray:
        """Whether a ray crosses each cell (K,)."""
        bits = np.unpackbits(self.crossed, count=self.n_cells, bitorder='little')
        touched: BoolArray = bits.view(np.bool_)
        return touched

    def gains(self) -> Float32Array:
        """Return (K,) the most that its rays can add to the log-odds of each cell."""
        gains = np.zeros(self.n_cells, np.float32)
        gains[self.listed()] = self.gain
        return gains


def _set_bits(bits: AnyArray, count: int) -> AnyArray:
    numbers: AnyArray = np.flatnonzero(np.unpackbits(bits, count=count, bitorder='little')).astype(
        np.int32
    )
    return numbers


class WindowSize(NamedTuple):
    """Rays, the most pairs of a ray and a cell, a box around all cells, pairs that are near."""

    rays: int
    pairs: int
    box: CellBox
    near: int = 0

    def with_more(self, other: WindowSize) -> WindowSize:
        """Return the size of a window of both."""
        return WindowSize(
            self.rays + other.rays,
            self.pairs + other.pairs,
            self.box.union(other.box),
            self.near + other.near,
        )

    def without(self, other: WindowSize, box: CellBox) -> WindowSize:
        """Return the size of a window without a part of it; `box` is around the others."""
        return WindowSize(
            self.rays - other.rays, self.pairs - other.pairs, box, self.near - other.near
        )

    @property
    def n_bytes(self) -> int:
        """Memory that an index of this size takes, about; measured windows took less."""
        lists = 13 * min(self.near, self.box.n_cells)
        in_front = self.pairs - self.near
        return 40 * self.rays + 8 * self.near + lists + in_front + self.box.n_cells // 2


class RayWindow:
    """Recorded scans as an index of rays that can grow.

    Adding scans changes the arrays of `index` in place and replaces the tuple: whoever samples
    from an index must stop before more is added.

    With `limits`, a box of lattice cells, the window is that box. A beam that leaves it says that
    nothing is on its way up to there, like one that is longer than the sensor reaches; sensors
    outside are left out.

    With `merge` beams that run along together are one ray, see `ogm_mcmc.sampling.ray_merging`;
    without it each beam is a ray, in the order of scans and beams.
    """

    def __init__(
        self,
        config: WindowConfig,
        model: ForwardModelConfig,
        *,
        margin: int = 0,
        limits: CellBox | None = None,
        merge: bool = False,
    ) -> None:
        self.config = config
        self.margin = margin  # cells beyond all rays that belong to the window, too
        self.limits = limits
        self.model_config = model
        self.model = ForwardModel.from_config(model)
        self.spec = GridSpec(config.resolution, 1, 1)
        self.index = _empty_index()
        self.n_beams = 0  # of all rays
        self._size = WindowSize(0, 0, CellBox(0, 0, 0, 0))
        self._merge = merge
        self._places: Places = {}

    @property
    def n_merged(self) -> int:
        """Beams that were added to the ray of another one."""
        return self.n_beams - self.index.n_rays

    def add(self, placed: Iterable[PlacedScan]) -> int:
        """Add scans, each at the mean of its belief; return the number of beams.

        Raises GridError for a ray that is too long, WindowError when the memory limit would be
        passed; nothing has changed then.
        """
        scans = list(placed)
        joining = self._joining(scans)
        batch = Batch(scans, self._cast, joining)
        if batch.n_beams == 0:
            return 0
        more = WindowSize(0, 0, CellBox(0, 0, 0, 0))
        for rays in batch.rays():
            more = more.with_more(self._size_of(rays))
        size = self._size.with_more(more)
        spec = self.spec.windowed(size.box if self.limits is None else self.limits)
        self._check_memory(size._replace(box=spec.box))

        def here(rays: BeamRays) -> BeamRays:
            return rays._replace(column=rays.column - spec.column0, row=rays.row - spec.row0)

        self.index = extended(
            self.index,
            self.spec,
            spec,
            lambda: map(here, in_blocks(batch.rays())),
            more.rays,
            self.model,
            lambda: ((here(rays), numbers) for rays, numbers in batch.more_said()),
        )
        self.spec, self._size = spec, size
        self.n_beams += batch.n_beams
        if joining is not None:
            self._places.update(joining.places)
        return batch.n_beams

    def _joining(self, scans: Sequence[PlacedScan]) -> Joining | None:
        if not self._merge:
            return None
        n_rays, resolution = self.index.n_rays, self.config.resolution
        return Joining(self._places, n_rays, scans, self._cast, self.model, resolution)

    def size_of(self, placed: PlacedScan) -> WindowSize:
        """Return what a scan adds to a window; raises GridError for a ray that is too long."""
        return self._size_of(rays_of_scan(placed, self.config, self.model.sigma_m))

    @property
    def most_bytes(self) -> float:
        """The memory that the index may take."""
        return self.config.max_memory_mb * 1e6

    def _cast(self, placed: PlacedScan) -> BeamRays:
        rays = rays_of_scan(placed, self.config, self.model.sigma_m)
        if self.limits is not None:
            rays = limited(rays, self.limits, self.config.resolution)
        return rays

    def sum_of_sizes(self, scans: Sequence[PlacedScan]) -> WindowSize:
        """Return what scans add at most to a window; raises GridError for a ray too long."""
        size = WindowSize(0, 0, CellBox(0, 0, 0, 0))
        for scan in scans:
            size = size.with_more(self._size_of(self._cast(scan)))
        return size

    def _size_of(self, rays: BeamRays) -> WindowSize:
        if rays.length.size == 0:
            return WindowSize(0, 0, CellBox(0, 0, 0, 0))
        cells = most_cells(rays)
        near = np.minimum(cells, most_near_cells(rays, self.model, self.config.resolution))
        box = self._box_around(rays)
        return WindowSize(rays.length.size, int(cells.sum()), box, int(near.sum()))

    def _box_around(self, rays: BeamRays) -> CellBox:
        end_x, end_y = rays.x + rays.length * rays.ux, rays.y + rays.length * rays.uy
        column, row, margin = int(rays.column[0]), int(rays.row[0]), self.margin
        return CellBox(
            column + int(np.floor(min(0.0, end_x.min()))) - margin,
            row + int(np.floor(min(0.0, end_y.min()))) - margin,
            column + int(np.floor(max(0.0, end_x.max()))) + 1 + margin,
            row + int(np.floor(max(0.0, end_y.max()))) + 1 + margin,
        )

    def _check_memory(self, size: WindowSize) -> None:
        if size.n_bytes > self.most_bytes:
            raise WindowError(
                f'{size.rays} rays need {size.n_bytes / 1e6:.0f} MB: expected at most '
                f'max_memory_mb = {self.config.max_memory_mb:g}; use fewer scans, a larger '
                'beam_stride, resolution or cut_sigma'
            )


def _empty_index() -> RayIndex:
    grid = np.zeros(GRID_SIZE, np.int64)
    grid[CELLS] = 1
    return RayIndex(
        rays=np.empty((0, RAY_WORDS), np.int64),
        marks=np.zeros((1, 2), np.uint64),
        lists=np.zeros((1, 2), np.int32),
        full=np.empty(0, np.uint8),
        gain=np.empty(0, np.float32),
        near=np.empty((0, 2), np.int32),
        front=np.empty(0, np.int32),
        tiles=np.zeros(2, np.int32),
        runs=np.empty(0, np.int32),
        run_lengths=np.empty(0, np.uint8),
        crossed=np.zeros(1, np.uint8),
        grid=grid,
        telling=np.empty(0, np.int32),
        left_out=np.zeros(1),
    )
