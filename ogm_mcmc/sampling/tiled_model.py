"""The posterior of a window of which no process holds all: tiles draw, here lies the map."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, UInt8Array
from ogm_mcmc.errors import GridError, WindowError
from ogm_mcmc.sampling.cell_gibbs import GibbsState
from ogm_mcmc.sampling.first_hits import HitsBefore
from ogm_mcmc.sampling.informed import near
from ogm_mcmc.sampling.patch_gibbs import (
    SETTLED_WHOLE_SHARE,
    SETTLING_ESCAPE,
    SURROUNDING,
)
from ogm_mcmc.sampling.patch_places import PatchPlaces, focused, places_among, turn
from ogm_mcmc.sampling.ray_summaries import summaries_of
from ogm_mcmc.sampling.tile_gibbs import Drawn, TileJob, TileReport
from ogm_mcmc.sampling.tiles import Tiling

__all__ = ['Arrivals', 'Pending', 'TilePrior', 'TiledModel', 'Tiles']

Arrivals = Callable[[AnyArray, Float32Array, float], Float32Array]
"""Of `telling` (N,), probabilities (K,) and the least chance: as `tile_index.arrivals` has it."""


class Pending(Protocol):
    """A job under way, such as a `Future`."""

    def result(self) -> Drawn:
        """Wait for what was drawn."""
        ...


class Tiles(Protocol):
    """Those who hold the tiles."""

    def draw(self, tile: int, job: TileJob) -> Pending:
        """Let a tile do a job."""
        ...


class TilePrior(NamedTuple):
    """What is known before any beam, as those who do not draw have to know it.

    log_odds, order        of independent cells; order as in `cell_gibbs.ORDERS`
    side, margin, escape   of patches, as in `PatchModel`; side 0: independent cells
    """

    log_odds: float = 0.0
    order: str = 'fixed'
    side: int = 0
    margin: int = 0
    escape: float = 0.0


class TiledModel:
    """A `PosteriorModel` whose rays are held, and whose cells are drawn, by tiles.

    A sweep is that of `CellModel` or `PatchModel` in another order: what lies in all tiles of one
    group, then of the next. Hits of visits (V,) take the place of the records of a state.
    """

    begins_cold = False
    """Windows of few rays are no work for several."""

    def __init__(
        self,
        tiling: Tiling,
        reports: Sequence[TileReport],
        tiles: Tiles,
        prior: TilePrior,
        arrivals: Arrivals,
    ) -> None:
        self.tiling, self._tiles, self._prior, self._arrivals = tiling, tiles, prior, arrivals
        self.summaries = summaries_of(tiling, reports)
        self._chains = _Chains()
        touched = self._put_together([report.touched for report in reports])
        self.touched: AnyArray = np.flatnonzero(touched).astype(np.int32)
        self._places: PatchPlaces | None = None
        if prior.side:
            told = self._put_together([report.told for report in reports])
            lifted = self._put_together([report.lifted for report in reports])
            self._places = places_among(near(told, prior.margin), touched & ~lifted, prior.side)
            self.touched = self._places.touched
            if self.touched.size == 0:
                raise WindowError(
                    f'no patch within {prior.margin} cells of what a beam tells of: expected a '
                    'larger margin'
                )
        sampled = np.zeros(self.n_cells, np.bool_)
        sampled[self.touched] = True
        self._masks = [self._of_core(sampled, tile) for tile in range(len(tiling.tiles))]

    @property
    def n_cells(self) -> int:
        """K, cells of the window."""
        return self.tiling.spec.width * self.tiling.spec.height

    def found(self) -> tuple[BoolArray, AnyArray] | None:
        """Return None: tiles are held anew when scans come in."""
        return None

    def start(self, cells: UInt8Array, before: HitsBefore | None = None) -> GibbsState:
        """Return the state of a map (K,); cells that are not sampled are set as in whole windows.

        What rays hit is looked for in the tiles, whatever was known `before`.
        Raises GridError when it is of another size.
        """
        if cells.shape != (self.n_cells,):
            raise GridError(
                f'start map of {cells.size} cells: expected the {self.n_cells} of the window'
            )
        mine = np.full(self.n_cells, SURROUNDING if self._prior.side else 0, np.uint8)
        mine[self.touched] = cells[self.touched] != 0
        state = GibbsState(mine, np.full(self.summaries.ray_of.size, np.nan, np.float32))
        self._do(state, {tile: self._look(state, tile) for tile in range(len(self._masks))})
        return state

    def advance(
        self,
        rng: Generator,
        state: GibbsState,
        *,
        settling: bool = False,
        focus: PatchPlaces | None = None,
        chances: UInt8Array | None = None,
        power: float = 1.0,
    ) -> int:
        """Do one sweep in place; return the number of flips."""
        prior = self._prior
        if self._places is None:
            return self._sweep_cells(rng, state, prior.log_odds, prior.order)
        corners = turn(rng, self._places if focus is None else focus)
        escape = max(prior.escape, SETTLING_ESCAPE) if settling else prior.escape
        # In tiles cells are always drawn by themselves, too.
        whole = None if settling or focus is None else SETTLED_WHOLE_SHARE
        tile_of = self.tiling.tile_of(corners)
        flips = 0
        for group in self._groups(rng):
            jobs = {}
            for tile in group:
                mine = self.tiling.in_box(tile, corners[tile_of == tile])
                seed = int(rng.integers(2**63))
                if mine.size:
                    none = np.empty(0, np.uint8)
                    jobs[tile] = self._job(
                        state, tile, seed, mine, none, escape, whole_share=whole
                    )
            flips += self._do(state, jobs)
        return flips

    def forget(
        self,
        rng: Generator,
        state: GibbsState,
        prior_log_odds: float,
        sweeps: int,
        only: BoolArray | None = None,
    ) -> None:
        """Draw all sampled cells one by one, as if they were independent with this prior."""
        del only  # tiles are drawn as a whole
        for _ in range(sweeps):
            self._sweep_cells(rng, state, prior_log_odds, 'fixed')

    def focus(self, in_doubt: BoolArray, moving: BoolArray) -> PatchPlaces | None:
        """Return where sweeps go that seldom come by patches without such a cell (K,)."""
        if self._places is None:
            return None
        return focused(self._places, in_doubt.reshape(self._shape), self._prior.side)

    def log_likelihood(self, state: GibbsState) -> float:
        """Log p(z | m, x), nats."""
        return self.summaries.log_likelihood(state.records)

    def arrival(self, probability: Float32Array, least: float) -> Float32Array:
        """Return (K,) the chance that a ray arrives at a cell; see `informed.arrival`."""
        return self._arrivals(self.summaries.telling, probability, least)

    def _sweep_cells(
        self, rng: Generator, state: GibbsState, prior_log_odds: float, order: str
    ) -> int:
        flips = 0
        for group in self._groups(rng):
            seeds = rng.integers(2**63, size=len(group))
            flips += self._do(
                state,
                {
                    tile: self._job(
                        state, tile, int(seed), None, self._masks[tile], prior_log_odds, order
                    )
                    for tile, seed in zip(group, seeds, strict=True)
                },
            )
        return flips

    def _groups(self, rng: Generator) -> list[list[int]]:
        """Return the groups in turn, from a random one on: chains keep out of each other's way."""
        groups = self.summaries.groups
        first = int(rng.integers(len(groups)))
        return groups[first:] + groups[:first]

    def _job(
        self,
        state: GibbsState,
        tile: int,
        seed: int,
        corners: AnyArray | None,
        mask: UInt8Array,
        number: float,
        order: str = 'fixed',
        whole_share: float | None = None,
    ) -> TileJob:
        place = self.tiling.spec.slices(self.tiling.tiles[tile].box)
        cells = np.packbits(state.cells.reshape(self._shape)[place])
        behind = self.summaries.outside(tile, state.records)
        chain, chains = self._chains.number_of(state)
        return TileJob(
            cells, behind, seed, corners, mask, number, order, chain, chains, whole_share
        )

    def _look(self, state: GibbsState, tile: int) -> TileJob:
        """Return a job that draws nothing: what is hit where."""
        nothing = np.zeros_like(self._masks[tile])
        return self._job(state, tile, 0, None, nothing, 0.0)

    def _do(self, state: GibbsState, jobs: dict[int, TileJob]) -> int:
        """Let tiles do jobs at the same time; enter what they have drawn, return the flips."""
        running = {tile: self._tiles.draw(tile, job) for tile, job in jobs.items()}
        flips = 0
        cells = state.cells.reshape(self._shape)
        for tile, future in running.items():
            drawn = future.result()
            box = self.tiling.tiles[tile].box
            place = self.tiling.spec.slices(box)
            cells[place] = np.unpackbits(drawn.cells, count=box.n_cells).reshape(
                cells[place].shape
            )
            state.records[self.summaries.visits[tile]] = drawn.hits
            flips += drawn.flips
        return flips

    def _put_together(self, bits: list[UInt8Array]) -> BoolArray:
        """Return cells (height, width) of the window from bits of the boxes of all tiles."""
        whole = np.zeros(self._shape, np.bool_)
        for tile, own in zip(self.tiling.tiles, bits, strict=True):
            place = self.tiling.spec.slices(tile.box)
            whole[place] |= (
                np.unpackbits(own, count=tile.box.n_cells)
                .view(np.bool_)
                .reshape(whole[place].shape)
            )
        return whole

    def _of_core(self, cells: BoolArray, tile: int) -> UInt8Array:
        """Return bits of a box's cells: those of these that lie in its core."""
        core, box = self.tiling.tiles[tile].core, self.tiling.tiles[tile].box
        spec = self.tiling.spec
        chosen = np.zeros(self._shape, np.bool_)
        chosen[spec.slices(core)] = cells.reshape(self._shape)[spec.slices(core)]
        return np.packbits(chosen[spec.slices(box)])

    @property
    def _shape(self) -> tuple[int, int]:
        return self.tiling.spec.height, self.tiling.spec.width


class _Chains:
    """Numbers of states, as long as anybody has them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: dict[int, weakref.ref[AnyArray]] = {}
        self._next = 0

    def number_of(self, state: GibbsState) -> tuple[int, tuple[int, ...]]:
        """Return the number of a state, and those of all states that there are."""
        with self._lock:
            alive = {number: ref for number, ref in self._known.items() if ref() is not None}
            mine = [number for number, ref in alive.items() if ref() is state.records]
            if not mine:
                alive[self._next] = weakref.ref(state.records)
                mine = [self._next]
                self._next += 1
            self._known = alive
            return mine[0], tuple(alive)
