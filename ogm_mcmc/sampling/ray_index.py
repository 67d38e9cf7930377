"""Which rays touch which cell, and what each ray would say if it ended there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, Float64Array
from ogm_mcmc.sampling.ray_index_kernels import CELLS, GRID_SIZE, NEAR, PAIRS, WIDTH, list_of
from ogm_mcmc.sampling.ray_line_kernels import (
    LEVEL,
    RAY_WORDS,
    SHAPE,
    UNSEEN,
    cells_of_ray,
    places_of,
)

__all__ = ['RayIndex', 'empty_index']


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

    def to_power(self, power: float) -> RayIndex:
        """Return the index of the same rays with each likelihood raised to a power."""
        scale, near, rays = np.float32(power), self.near.copy(), self.rays.copy()
        near.view(np.float32)[:, 1] *= scale
        levels = rays.view(np.float32)
        levels[:, [LEVEL, UNSEEN]] *= scale
        gain, left_out = self.gain * scale, self.left_out * power
        return self._replace(near=near, rays=rays, gain=gain, left_out=left_out)

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


def empty_index() -> RayIndex:
    """Return the index of no ray in a window of one cell."""
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
