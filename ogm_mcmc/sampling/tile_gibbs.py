"""What the process that holds a tile does: draws its cells given what lies outside.

Design note: first hits are kept
--------------------------------
A job says all that is to be known of a chain, so anybody who holds the tile can do it. But to look
for the first hits of all rays anew takes as long as to draw (a tenth of the stand-in for Stata, 2
x 2 tiles: 0.53 s beside 1.22 s in four sweeps). So a tile keeps the map that it drew last for each
chain, and goes on from there: cells that others changed since then, all in its rim, redirect their
rays as in a draw, and rays that are no longer stopped before the tile are looked at. The records
are those of a tile that kept nothing, bit for bit; that is a test. It costs a byte a cell of the
box and 16 a ray for each chain. `max_memory_mb` does not count that, here as in whole windows: it
is of the rays. Reports do.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, UInt8Array
from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.sampling.cell_gibbs import GibbsState, draw_cells, highest_probability
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_prior import PatchTable
from ogm_mcmc.sampling.tile_index import TileRays, tile_rays
from ogm_mcmc.sampling.tile_kernels import find_hits, go_on, look_again
from ogm_mcmc.sampling.tiles import Tiling

__all__ = ['Drawn', 'TileJob', 'TileReport', 'TileSampler']

# Of a ray in the state of a chain.
RECORD_BYTES = 16


class TileJob(NamedTuple):
    """What to draw given what: all that a tile knows of the rest of the map.

    cells     bits of the box's cells
    behind    (n,) float32 of its rays, see `tile_kernels`
    seed      of the draw
    corners   (P,) int32: patches, by their lower left cell in the box, to be drawn in turn; or
              None, and then the cells of `mask` are drawn one by one
    mask      bits of the box's cells, empty with patches
    number    log-odds of the prior of cells, or the `escape` of patches
    order     of cells, see `cell_gibbs.ORDERS`
    chain     a number of the chain, for what is kept of its last job; `chains`: of all there are
    whole_share  share of patches that are drawn as a whole; None: as `PatchModel` has it
    """

    cells: UInt8Array
    behind: Float32Array
    seed: int
    corners: AnyArray | None
    mask: UInt8Array
    number: float
    order: str = 'fixed'
    chain: int = 0
    chains: tuple[int, ...] = (0,)
    whole_share: float | None = None


class Drawn(NamedTuple):
    """Bits of the box's cells after a draw, the hits of its visits (V,), flips."""

    cells: UInt8Array
    hits: Float32Array
    flips: int


class TileReport(NamedTuple):
    """What those who hold the whole map have to know of a tile.

    numbers, begins, along, unseen, telling  as in `TileRays`
    touched, told, lifted  bits of the box's cells: a ray crosses them; tells something of them;
                           can make them more likely to be occupied
    n_pairs, n_bytes       of its rays; `n_bytes_of_chain`: kept of each chain besides
    left_out               as in `RayIndex`, of beams from within the tile's core
    """

    numbers: AnyArray
    begins: AnyArray
    along: AnyArray
    unseen: Float32Array
    telling: AnyArray
    touched: UInt8Array
    told: UInt8Array
    lifted: UInt8Array
    n_pairs: int
    n_bytes: int
    n_bytes_of_chain: int
    left_out: float


class TileSampler:
    """A tile's rays and the prior of its cells; without a `table` these are independent.

    May be asked by several threads, one after the other.
    """

    def __init__(
        self,
        scans: Sequence[PlacedScan],
        window: WindowConfig,
        model: ForwardModelConfig,
        table: PatchTable | None,
        tiling: Tiling,
        tile: int,
    ) -> None:
        self.rays: TileRays = tile_rays(scans, window, model, tiling, tile)
        box = tiling.tiles[tile].box
        self.width = box.column1 - box.column0
        self._patches: PatchModel | None = None
        if table is not None:
            self._patches = PatchModel(
                self.rays.local,
                self.width,
                table,
                flip_cells=True,
            )
        self._ceilings: dict[float, Float32Array] = {}
        self._every = np.arange(self.rays.local.n_rays)
        self._kept: dict[int, GibbsState] = {}  # by chain, as its last job left it
        self._lock = threading.Lock()

    def report(self) -> TileReport:
        """Return what is known of the rays and cells of the tile."""
        rays = self.rays
        index = rays.local
        return TileReport(
            rays.numbers,
            rays.begins,
            rays.along,
            rays.unseen,
            rays.telling,
            np.packbits(index.is_touched()),
            np.packbits(rays.told()),
            np.packbits(index.gains() > 0.0),
            index.n_pairs,
            rays.n_bytes,
            index.n_cells + RECORD_BYTES * index.n_rays,
            float(index.left_out[0]),
        )

    def draw(self, job: TileJob) -> Drawn:
        """Do a job; the same for the same job, whatever was done before."""
        index = self.rays.local
        with self._lock:
            state = self._given(job)
            cells = state.cells
            rng = np.random.default_rng(job.seed)
            if job.corners is None:
                flips = self._draw_cells(rng, job, state)
            else:
                assert self._patches is not None
                flips = self._patches.draw_patches(
                    rng, job.corners, state, job.number, whole_share=job.whole_share
                )
            hits = np.empty(self.rays.along.size, np.float32)
            find_hits(self.rays.begins, self.rays.entered, cells, index, state.records, hits)
        return Drawn(np.packbits(cells), hits, flips)

    def _given(self, job: TileJob) -> GibbsState:
        """Return the state that a job begins with; what is kept of its chain becomes that."""
        cells = np.unpackbits(job.cells, count=self.rays.local.n_cells)
        self._kept = {chain: of for chain, of in self._kept.items() if chain in job.chains}
        state = self._kept.get(job.chain)
        if state is None:
            state = GibbsState(cells, self.first_hits(cells, job.behind))
        else:
            self._go_on(state, cells, job.behind)
        self._kept[job.chain] = state
        return state

    def _go_on(self, state: GibbsState, cells: UInt8Array, behind: Float32Array) -> None:
        """Make a state that of other cells (K,) and of what lies outside now."""
        local, again = self.rays.local, np.empty(self.rays.local.n_rays, np.int64)
        changed = np.flatnonzero(state.cells != cells).astype(np.int32)
        bits = state.records.view(np.float32)
        count = go_on(behind, changed, state.cells, again, state.records, bits, *local.arrays())
        look_again(again[:count], behind, state.cells, local, state.records)

    def first_hits(self, cells: UInt8Array, behind: Float32Array) -> AnyArray:
        """Return records (n, 4) int32 of the box's cells, given what lies outside."""
        records = np.empty((self.rays.local.n_rays, 4), np.int32)
        look_again(self._every, behind, cells, self.rays.local, records)
        return records

    def _draw_cells(self, rng: np.random.Generator, job: TileJob, state: GibbsState) -> int:
        mask: BoolArray = np.unpackbits(job.mask, count=state.cells.size).view(np.bool_)
        order = np.flatnonzero(mask).astype(np.int32)
        if order.size == 0:
            return 0
        if job.order == 'random':
            order = rng.permutation(order)
        elif job.order == 'checkerboard':
            even = (order // self.width + order % self.width) % 2 == 0
            order = np.concatenate((order[even], order[~even]))
        ceiling = self._ceilings.get(job.number)
        if ceiling is None:
            ceiling = highest_probability(self.rays.local, job.number)
            self._ceilings = {job.number: ceiling}
        return draw_cells(rng, order, state, self.rays.local, ceiling, job.number)
