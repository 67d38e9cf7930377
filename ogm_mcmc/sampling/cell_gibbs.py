"""Gibbs sampling of single cells: State, Info and one sweep ([gibbs] Algorithm 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, UInt8Array
from ogm_mcmc.errors import GridError, require
from ogm_mcmc.sampling.first_hits import HitsBefore, first_hits
from ogm_mcmc.sampling.gibbs_kernels import sweep_cells
from ogm_mcmc.sampling.informed import arrival
from ogm_mcmc.sampling.kept_odds import (
    NOT_KEPT,
    draw_lists,
    forget_odds,
    odds_to_keep,
    zones_of,
)
from ogm_mcmc.sampling.ray_index import RayIndex

__all__ = [
    'ORDERS',
    'CellModel',
    'Draw',
    'GibbsState',
    'IndexedModel',
    'SweepInfo',
    'draw_cells',
    'highest_probability',
    'start',
    'sweep',
]

ORDERS = ('fixed', 'random', 'checkerboard')


class GibbsState(NamedTuple):
    """What the next sweep needs: `cells` (K,) uint8 and what each ray hits, `records`.

    `records` (N, 4) int32 follows from `cells`; see `ogm_mcmc.sampling.gibbs_kernels`. So do
    `odds` (K, 2) float32 and `ways` (N, 8) int32, where log-odds are kept
    (`ogm_mcmc.sampling.kept_odds`).
    """

    cells: UInt8Array
    records: AnyArray
    odds: Float32Array = NOT_KEPT.odds
    ways: AnyArray = NOT_KEPT.ways

    def copy(self) -> GibbsState:
        """Return a state that a kernel may change."""
        return GibbsState(
            self.cells.copy(), self.records.copy(), self.odds.copy(), self.ways.copy()
        )


class SweepInfo(NamedTuple):
    """What a plot needs: flipped and occupied cells, log p(z | m) and log p(m | z) + constant."""

    flips: int
    occupied: int
    log_likelihood: float
    log_posterior: float


Draw = tuple[GibbsState, SweepInfo]


def draw_cells(
    rng: Generator,
    order: AnyArray,
    state: GibbsState,
    index: RayIndex,
    ceiling: Float32Array,
    log_odds: float,
) -> int:
    """Draw the cells of `order` (C,) int32 in turn, in place; return the number of flips.

    ceiling  (K,) no map of the other cells gives a cell a higher probability (see
             `highest_probability`, of the same prior `log_odds`)
    """
    cells, records = state[:2]
    forget_odds(state.odds)
    bits = records.view(np.float32)
    arrays = index.arrays()
    return int(sweep_cells(rng, order, cells, records, bits, ceiling, log_odds, *arrays))


class IndexedModel:
    """What models share that have all rays of a window in one index.

    `touched` (C,) int32: the cells that are sampled; `telling`: see `RayIndex`.
    """

    index: RayIndex
    touched: AnyArray
    telling: AnyArray

    @property
    def begins_cold(self) -> bool:
        """Return False: independent cells forget in a few sweeps whatever they were."""
        return False

    @property
    def n_cells(self) -> int:
        """Number of cells of the window, K."""
        return self.index.n_cells

    def log_likelihood(self, state: GibbsState) -> float:
        """Log p(z | m, x), nats."""
        said = float(state.records.view(np.float32)[:, 1].sum(dtype=np.float64))
        return said + float(self.index.left_out[0])

    def arrival(self, probability: Float32Array, least: float) -> Float32Array:
        """Return (K,) the chance that a ray arrives at a cell; see `informed.arrival`."""
        return arrival(self.index, self.telling, probability, least)

    def found(self) -> tuple[BoolArray, AnyArray] | None:
        """Return None: nothing was looked for."""
        return None

    def forget(
        self,
        rng: Generator,
        state: GibbsState,
        prior_log_odds: float,
        sweeps: int,
        only: BoolArray | None = None,
    ) -> None:
        """Draw the sampled cells, or `only` some (K,), as if independent with this prior."""
        order = self.touched if only is None else self.touched[only[self.touched]]
        ceiling = highest_probability(self.index, prior_log_odds)
        for _ in range(sweeps):
            draw_cells(rng, order, state, self.index, ceiling, prior_log_odds)


class CellModel(IndexedModel):
    """p(m | z, x) of a window: its rays, and independent cells with one prior.

    `touched` (C,) int32: the cells that a ray crosses; all others keep their prior, independently.
    `zones`: what is kept of rays beside the index, see `kept_odds`.
    """

    def __init__(
        self, index: RayIndex, prior_log_odds: float, width: int, order: str = 'fixed'
    ) -> None:
        require(order in ORDERS, 'order', order, f'one of {", ".join(ORDERS)}')
        self.index = index
        self.prior_log_odds = float(prior_log_odds)
        self.order = order
        self.touched = index.touched()
        self.telling = index.telling
        self.ceiling = highest_probability(index, self.prior_log_odds)
        self.zones = zones_of(index)
        even = (self.touched // width + self.touched % width) % 2 == 0
        self._checkered = np.concatenate((self.touched[even], self.touched[~even]))

    def start(self, cells: UInt8Array, before: HitsBefore | None = None) -> GibbsState:
        """Return the state of a map (K,); cells that no ray crosses are set free.

        What rays hit is kept from `before`. Raises GridError when it is of another size.
        """
        if cells.shape != (self.n_cells,):
            raise GridError(
                f'start map of {cells.size} cells: expected the {self.n_cells} of the window'
            )
        mine = np.zeros(self.n_cells, np.uint8)
        mine[self.touched] = cells[self.touched] != 0
        hits = first_hits(mine, self.index, before)
        return GibbsState(mine, hits, *odds_to_keep(self.index, self.zones))

    def advance(
        self,
        rng: Generator,
        state: GibbsState,
        *,
        settling: bool = False,
        focus: object = None,
        chances: object = None,
        power: float = 1.0,
    ) -> int:
        """Draw every touched cell once, in place; return the number of flips.

        The others make no difference to single cells, see `PosteriorModel`.
        """
        order = self.touched
        if self.order == 'random':
            order = rng.permutation(self.touched)
        elif self.order == 'checkerboard':
            order = self._checkered
        if state.odds.size:
            return draw_lists(rng, order, state, self.index, self.zones, self.prior_log_odds)
        return draw_cells(rng, order, state, self.index, self.ceiling, self.prior_log_odds)

    def focus(self, in_doubt: BoolArray, moving: BoolArray) -> None:
        """Return nothing: a settled cell costs next to nothing."""

    def log_prior(self, state: GibbsState) -> float:
        """Log p(m) less that of the empty map, nats."""
        return self.prior_log_odds * float(np.count_nonzero(state.cells))


def start(cells: UInt8Array, model: CellModel) -> GibbsState:
    """Return the state of a map; see `CellModel.start`."""
    return model.start(cells)


def sweep(rng: Generator, state: GibbsState, model: CellModel) -> Draw:
    """Resample every cell once ([gibbs] Algorithm 1, inner loop); `state` stays as it is."""
    after = state.copy()
    flips = model.advance(rng, after)
    likelihood = model.log_likelihood(after)
    info = SweepInfo(
        flips,
        int(np.count_nonzero(after.cells)),
        likelihood,
        likelihood + model.log_prior(after),
    )
    return after, info


def highest_probability(index: RayIndex, prior_log_odds: float) -> Float32Array:
    """Return (K,) what no conditional probability of a cell exceeds, whatever the other cells.

    p <= sigmoid(prior + the most its rays can add), rounded upwards.
    """

    def bound(gain: AnyArray) -> Float32Array:
        log_odds = prior_log_odds + gain.astype(np.float64) * (1.0 + 1e-6) + 1e-5
        with np.errstate(over='ignore'):
            ceiling = 1.0 / (1.0 + np.exp(-log_odds))
        highest: Float32Array = (ceiling * (1.0 + 1e-6)).astype(np.float32)
        return highest

    # Most cells have no list: one number serves them all.
    ceiling = np.full(index.n_cells, bound(np.zeros(1))[0], np.float32)
    ceiling[index.listed()] = bound(index.gain)
    return ceiling
