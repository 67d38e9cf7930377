"""Recorded scans as a window of rays that can grow, and what it takes of memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray
from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import WindowFullError, require
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.sampling.beam_rays import (
    BeamRays,
    limited,
    most_cells,
    most_near_cells,
    rays_of_scan,
)
from ogm_mcmc.sampling.kept_odds import PATH_BYTES, WAY_BYTES, ZONE_BYTES
from ogm_mcmc.sampling.ray_batch import Batch, in_blocks
from ogm_mcmc.sampling.ray_dropping import without
from ogm_mcmc.sampling.ray_filing import Said, extended
from ogm_mcmc.sampling.ray_fronts import parts_of
from ogm_mcmc.sampling.ray_index import empty_index
from ogm_mcmc.sampling.ray_merging import Joining, Places
from ogm_mcmc.sampling.ray_stands import Stands, settled
from ogm_mcmc.sampling.window_scans import NOTHING, WindowScans, WindowSize
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['Dropped', 'RayWindow']


class Dropped(NamedTuple):
    """What `RayWindow.drop` did: scans to add again, and which rays (N,) stayed.

    untold  cells (height, width) of the window then, `spec`, that no ray tells of any more
    """

    again: list[PlacedScan]
    staying: BoolArray
    spec: GridSpec
    untold: BoolArray


class RayWindow:
    """Recorded scans as an index of rays that can grow, and drop scans.

    Adding and dropping scans changes the arrays of `index` in place and replaces the tuple:
    whoever samples from an index must stop before.

    With `limits`, a box of lattice cells, the window is that box. A beam that leaves it says that
    nothing is on its way up to there, like one that is longer than the sensor reaches; sensors
    outside are left out.

    With `merge` beams that run along together are one ray, see `ogm_mcmc.sampling.ray_merging`,
    also those of a robot that stands and jitters, see `ray_stands`; without it each beam is a ray,
    in the order of scans and beams.

    `chains`: of a window of which so many chains draw single cells; what `kept_odds` needs of
    memory for the rays, beside the index, counts for them, too.
    """

    def __init__(
        self,
        config: WindowConfig,
        model: ForwardModelConfig,
        *,
        margin: int = 0,
        limits: CellBox | None = None,
        merge: bool = False,
        chains: int = 0,
    ) -> None:
        self.config = config
        self.margin = margin  # cells beyond all rays that belong to the window, too
        self.limits = limits
        self.model_config = model
        self.model = ForwardModel.from_config(model)
        self.spec = GridSpec(config.resolution, 1, 1)
        self.index = empty_index()
        self.n_beams = 0  # of all rays
        self._size = NOTHING
        self._merge = merge
        self._chains = chains
        self._places: Places = {}
        self._stands: Stands = {}
        self._scans = WindowScans()
        # Rays that the last scans said more of, of those that were there before.
        self.said_more: AnyArray = np.empty(0, np.int64)

    @property
    def n_merged(self) -> int:
        """Beams that were added to the ray of another one."""
        return self.n_beams - self.index.n_rays

    def add(
        self, placed: Iterable[PlacedScan], make_room: Callable[[], None] = lambda: None
    ) -> int:
        """Add scans, each at the mean of its belief; return the number of beams.

        Raises GridError for a ray that is too long, WindowFullError when the memory limit would
        be passed; nothing has changed then. `make_room` is called when neither is so, before
        memory is taken.
        """
        new, stands = list(placed), Stands()
        scans = new
        if self._merge:
            scans, stands = settled(new, self._stands, self.config)
        joining = self._joining(scans)
        batch = Batch(scans, self._cast, joining)
        self.said_more = np.empty(0, np.int64)
        if batch.n_beams == 0:
            nothing = [0.0] * len(new)
            if self._merge:
                self._scans.add(new, scans, [NOTHING] * len(new), batch.sizes, nothing)
            return 0
        sizes, more = [], NOTHING
        for i in range(len(scans)):
            rays = batch.new_of(i)
            sizes.append(NOTHING if rays is None else self._size_of(rays))
            more = more.with_more(sizes[-1])
        size = self._size.with_more(more)
        spec = self.spec.windowed(size.box if self.limits is None else self.limits)
        self._check_memory(size._replace(box=spec.box))
        make_room()

        def here(rays: BeamRays) -> BeamRays:
            return rays._replace(column=rays.column - spec.column0, row=rays.row - spec.row0)

        def blocks(part: Callable[[], Iterator[BeamRays]]) -> Iterator[BeamRays]:
            return map(here, in_blocks(part()))

        left_out, said_more = [0.0] * len(new), [np.empty(0, np.int64)]
        total, n_before = self.index.left_out, self.index.n_rays

        def said() -> Iterator[Said]:
            for i, rays, numbers in batch.more_said():
                before = float(total[0])
                yield Said(here(rays), numbers)
                left_out[i] = float(total[0]) - before
                said_more.append(numbers[numbers < n_before])

        self.index = extended(
            self.index,
            self.spec,
            spec,
            [partial(blocks, part) for part in batch.shares(parts_of(more.rays))],
            more.rays,
            self.model,
            said,
        )
        self.spec, self._size = spec, size
        self.n_beams += batch.n_beams
        self.said_more = np.unique(np.concatenate(said_more))
        if joining is not None:
            self._places.update(joining.places)
            self._stands.update(stands)
            self._scans.add(new, scans, sizes, batch.sizes, left_out)
        return batch.n_beams

    def drop(self, gone: Iterable[PlacedScan]) -> Dropped:
        """Take scans out, in place, as if they had never come; only of a window that merges.

        Where scans share rays all of them go: those that stay have to be added again. Raises
        KeyError, with nothing changed, for a scan that is not of the window; ConfigError where
        nothing is merged, as no scans are held there.
        """
        require(self._merge, 'merge', self._merge, 'expected True, to drop scans')
        leaving = self._scans.leave(gone, self._places, self._stands, self.index.n_rays)
        box = leaving.size.box if self.limits is None else self.limits
        spec = self.spec if box.empty else self.spec.windowed(box)
        thinned = without(self.index, leaving.staying, self.spec, spec)
        self.index, self.spec, self._size = thinned.rays, spec, leaving.size
        self.index.left_out[0] = leaving.left_out
        self.n_beams -= leaving.beams
        self.said_more = np.empty(0, np.int64)
        return Dropped(leaving.again, leaving.staying, spec, thinned.untold)

    def _joining(self, scans: Sequence[PlacedScan]) -> Joining | None:
        if not self._merge:
            return None
        n_rays, resolution = self.index.n_rays, self.config.resolution
        return Joining(self._places, n_rays, scans, self._cast, self.model, resolution)

    def size_of(self, placed: PlacedScan) -> WindowSize:
        """Return what a scan adds to a window; raises GridError for a ray that is too long."""
        return self._size_of(
            rays_of_scan(placed, self.config, self.model.sigma_m, self.model_config.grazing_m)
        )

    @property
    def most_bytes(self) -> float:
        """The memory that the index may take."""
        return self.config.max_memory_mb * 1e6

    def _cast(self, placed: PlacedScan) -> BeamRays:
        rays = rays_of_scan(placed, self.config, self.model.sigma_m, self.model_config.grazing_m)
        if self.limits is not None:
            rays = limited(rays, self.limits, self.config.resolution)
        return rays

    def sum_of_sizes(self, scans: Sequence[PlacedScan]) -> WindowSize:
        """Return what scans add at most to a window; raises GridError for a ray too long."""
        size = NOTHING
        for scan in scans:
            size = size.with_more(self._size_of(self._cast(scan)))
        return size

    def _size_of(self, rays: BeamRays) -> WindowSize:
        if rays.length.size == 0:
            return NOTHING
        cells = most_cells(rays)
        near = np.minimum(cells, most_near_cells(rays, self.model, self.config.resolution))
        box = self._box_around(rays)
        n_rays, pairs = rays.length.size, int(cells.sum())
        zones = 0
        if self._chains:
            zones = (ZONE_BYTES + self._chains * WAY_BYTES) * n_rays + PATH_BYTES * pairs
        return WindowSize(n_rays, pairs, box, int(near.sum()), zones)

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
            raise WindowFullError(
                f'{size.rays} rays need {size.n_bytes / 1e6:.0f} MB: expected at most '
                f'max_memory_mb = {self.config.max_memory_mb:g}; use fewer scans, a larger '
                'beam_stride, resolution or cut_sigma'
            )
