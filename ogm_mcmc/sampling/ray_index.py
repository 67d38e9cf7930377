"""Which rays touch which cell, and what each ray would say if it ended there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.sampling.beam_rays import BeamRays, limited, most_cells, rays_of_scan
from ogm_mcmc.sampling.ray_index_kernels import file_rays, spread_pairs, trace_rays
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['BeamRays', 'RayIndex', 'RayWindow', 'WindowSize']


class RayIndex(NamedTuple):
    """N rays, K cells, T pairs of a ray and a cell it crosses, in two orders.

    By cell: cell k owns rows `cell_start[k]` to `cell_start[k + 1]` (K + 1,) int64 of `pairs`
    (T, 2) int32, the ray and, as the bits of a float32, log p(z | this cell is its first hit),
    and of `positions` (T,) uint16, the cell's place on the ray; rays come in rising order;
    `gain` (K,) float32 is the most that its rays can add to its log-odds.
    By ray: ray n owns `ray_start[n]` to `ray_start[n + 1]` (N + 1,) int64 of `steps` (T,) uint8
    and `ray_likelihood` (T,) float32; it begins in `first_cell` (N,) int32 and goes on by
    `across` and `up` (N,) int32; `nothing` (N,) float32, log p(z | no cell of the ray is hit).
    15 bytes a pair.
    """

    cell_start: AnyArray
    pairs: AnyArray
    positions: AnyArray
    gain: AnyArray
    ray_start: AnyArray
    steps: AnyArray
    ray_likelihood: AnyArray
    first_cell: AnyArray
    across: AnyArray
    up: AnyArray
    nothing: AnyArray

    @property
    def n_rays(self) -> int:
        """Number of rays, N."""
        return int(self.first_cell.size)

    @property
    def n_pairs(self) -> int:
        """Number of pairs of a ray and a cell it crosses, T."""
        return int(self.ray_start[-1])

    @property
    def n_cells(self) -> int:
        """K, cells that no ray crosses included."""
        return int(self.gain.size)

    @property
    def n_bytes(self) -> int:
        """Memory of all arrays."""
        return sum(int(array.nbytes) for array in self)

    def touched(self) -> AnyArray:
        """Cells (C,) int32 that a ray crosses, in rising order."""
        touched: AnyArray = np.flatnonzero(np.diff(self.cell_start)).astype(np.int32)
        return touched


class WindowSize(NamedTuple):
    """Rays, the most pairs of a ray and a cell, and a box around all cells."""

    rays: int
    pairs: int
    box: CellBox

    def with_more(self, other: WindowSize) -> WindowSize:
        """Return the size of a window of both."""
        return WindowSize(
            self.rays + other.rays, self.pairs + other.pairs, self.box.union(other.box)
        )

    @property
    def n_bytes(self) -> int:
        """Memory of an index of this size."""
        return 15 * self.pairs + 28 * self.rays + 12 * self.box.n_cells


class RayWindow:
    """Recorded scans as an index of rays that can grow.

    Adding scans changes the arrays of `index` in place and replaces the tuple: whoever samples
    from an index must stop before more is added.

    With `limits`, a box of lattice cells, the window is that box. A beam that leaves it says that
    nothing is on its way up to there, like one that is longer than the sensor reaches; sensors
    outside are left out.
    """

    def __init__(
        self,
        config: WindowConfig,
        model: ForwardModelConfig,
        *,
        margin: int = 0,
        limits: CellBox | None = None,
    ) -> None:
        self.config = config
        self.margin = margin  # cells beyond all rays that belong to the window, too
        self.limits = limits
        self.model_config = model
        self.model = ForwardModel.from_config(model)
        self.spec = GridSpec(config.resolution, 1, 1)
        self.index = _empty_index()

    def add(self, placed: Iterable[PlacedScan]) -> int:
        """Add scans, each at the mean of its belief; return the number of new rays.

        Raises GridError for a ray that is too long, WindowError when the memory limit would be
        passed; nothing has changed then.
        """
        rays, box = self._cast(placed)
        if rays is None:
            return 0
        first_ray = self.index.n_rays
        box = box if self.limits is None else self.limits
        spec = self.spec.windowed(self.spec.box.union(box) if first_ray else box)
        at_most = self.index.n_pairs + int(most_cells(rays).sum())
        self._check_memory(WindowSize(first_ray + rays.length.size, at_most, spec.box))
        rays = rays._replace(column=rays.column - spec.column0, row=rays.row - spec.row0)
        self.index = _extended(self.index, self.spec, spec, rays, self.model)
        self.spec = spec
        return int(rays.length.size)

    def size_of(self, placed: PlacedScan) -> WindowSize:
        """Return what a scan adds to a window; raises GridError for a ray that is too long."""
        rays = rays_of_scan(placed, self.config, self.model.sigma_m)
        if rays.length.size == 0:
            return WindowSize(0, 0, CellBox(0, 0, 0, 0))
        return WindowSize(rays.length.size, int(most_cells(rays).sum()), self._box_around(rays))

    @property
    def most_bytes(self) -> float:
        """The memory that the index may take."""
        return self.config.max_memory_mb * 1e6

    def _cast(self, placed: Iterable[PlacedScan]) -> tuple[BeamRays | None, CellBox]:
        """Return the rays in lattice cells, and a box around all of them and the margin."""
        parts, box = [], CellBox(0, 0, 0, 0)
        for one in placed:
            rays = rays_of_scan(one, self.config, self.model.sigma_m)
            if self.limits is not None:
                rays = limited(rays, self.limits, self.config.resolution)
            if rays.length.size:
                parts.append(rays)
                box = box.union(self._box_around(rays))
        if not parts:
            return None, box
        return BeamRays(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True))), box

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
    return RayIndex(
        cell_start=np.zeros(2, np.int64),
        pairs=np.empty((0, 2), np.int32),
        positions=np.empty(0, np.uint16),
        gain=np.zeros(1, np.float32),
        ray_start=np.zeros(1, np.int64),
        steps=np.empty(0, np.uint8),
        ray_likelihood=np.empty(0, np.float32),
        first_cell=np.empty(0, np.int32),
        across=np.empty(0, np.int32),
        up=np.empty(0, np.int32),
        nothing=np.empty(0, np.float32),
    )


def _grown(array: AnyArray, size: int) -> AnyArray:
    """Grow an array where it lies, if the allocator can: never twice the memory of a large one."""
    shape = (size, *array.shape[1:])
    if array.size == 0:
        return np.empty(shape, array.dtype)  # not cleared, unlike what `resize` adds
    array.resize(shape, refcheck=False)
    return array


def _extended(
    index: RayIndex, old: GridSpec, new: GridSpec, rays: BeamRays, model: ForwardModel
) -> RayIndex:
    """Return the index with more rays in a window that covers the old one; uses up `index`."""
    n_old, n_new = index.n_rays, index.n_rays + rays.length.size
    t_old, t_most = index.n_pairs, index.n_pairs + int(most_cells(rays).sum())
    counts, gain = _regridded(index, old, new)
    before = _beginnings(counts)

    ray_start = np.concatenate((index.ray_start, np.empty(n_new - n_old, np.int64)))
    first_cell = np.concatenate(
        (_moved_cells(index.first_cell, old, new), np.empty(n_new - n_old, np.int32))
    )
    across = np.concatenate((index.across, np.empty(n_new - n_old, np.int32)))
    up = np.concatenate((np.sign(index.up) * new.width, np.empty(n_new - n_old, np.int32)))
    up = up.astype(np.int32)
    nothing = np.concatenate((index.nothing, np.empty(n_new - n_old, np.float32)))
    steps = _grown(index.steps, t_most)
    likelihood = _grown(index.ray_likelihood, t_most)
    total = int(
        trace_rays(
            rays,
            new.width,
            new.resolution_m,
            model,
            ray_start[n_old:],
            first_cell[n_old:],
            across[n_old:],
            up[n_old:],
            steps,
            likelihood,
            nothing[n_old:],
            counts,
        )
    )
    after = _beginnings(counts)
    grown = RayIndex(
        cell_start=after,
        pairs=_grown(index.pairs, total),
        positions=_grown(index.positions, total),
        gain=gain,
        ray_start=ray_start,
        steps=_grown(steps, total),
        ray_likelihood=_grown(likelihood, total),
        first_cell=first_cell,
        across=across,
        up=up,
        nothing=nothing,
    )
    if t_old:
        spread_pairs(before, after, grown.pairs, grown.positions)
    # Where the next pair of each cell goes: behind those it had. There may be more cells than
    # pairs, so no array of them is made that is not needed.
    next_pair = counts
    np.subtract(before[1:], before[:-1], out=next_pair)
    next_pair += after[:-1]
    file_rays(
        n_old,
        next_pair,
        ray_start,
        first_cell,
        across,
        up,
        grown.steps,
        grown.ray_likelihood,
        nothing,
        grown.pairs,
        grown.positions,
        gain,
    )
    return grown


def _beginnings(counts: AnyArray) -> AnyArray:
    """Return where each cell's pairs begin and the last ones end, (K + 1,) int64."""
    beginnings = np.zeros(counts.size + 1, np.int64)
    np.cumsum(counts, out=beginnings[1:])
    return beginnings


def _regridded(index: RayIndex, old: GridSpec, new: GridSpec) -> tuple[AnyArray, AnyArray]:
    """Return pairs per cell and gain per cell on a larger window; cells keep their order."""
    counts = np.zeros((new.height, new.width), np.int64)
    gain = np.zeros((new.height, new.width), np.float32)
    if index.n_rays:
        place = new.slices(old.box)
        counts[place] = np.diff(index.cell_start).reshape(old.height, old.width)
        gain[place] = index.gain.reshape(old.height, old.width)
    return counts.reshape(-1), gain.reshape(-1)


def _moved_cells(cells: AnyArray, old: GridSpec, new: GridSpec) -> AnyArray:
    row, column = np.divmod(cells, old.width)
    moved = (row + (old.row0 - new.row0)) * new.width + column + (old.column0 - new.column0)
    result: AnyArray = moved.astype(np.int32)
    return result
