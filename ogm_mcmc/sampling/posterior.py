"""Several chains side by side: the anytime posterior mean and how good it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, Protocol

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, UInt8Array
from ogm_mcmc.errors import require
from ogm_mcmc.sampling.burn_in import (
    FRESH,
    LEAST_BURN_IN,
    agreement,
    decides_after,
    draws_everything,
    end_looks,
    ends_with,
    power_after,
)
from ogm_mcmc.sampling.cell_gibbs import GibbsState
from ogm_mcmc.sampling.diagnostics import BatchCounts, ChainQuality, assess
from ogm_mcmc.sampling.first_hits import HitsBefore
from ogm_mcmc.sampling.gibbs_kernels import NO_CHANCE, PARTS, add_occupied
from ogm_mcmc.sampling.patch_places import PatchPlaces

__all__ = ['Estimate', 'Focus', 'PosteriorModel', 'PosteriorSampler']

ARRIVES = 0.5
"""A cell is informed if a ray arrives there with at least this chance."""

SETTLED = 0.002
"""A cell this near to 0 or 1 is drawn seldom."""


class PosteriorModel(Protocol):
    """What a sampler of maps offers, over cells or patches."""

    touched: AnyArray
    """Cells (C,) int32 that are sampled."""

    @property
    def begins_cold(self) -> bool:
        """Whether readings count for more in the first sweeps of a burn-in, see `burn_in`."""
        ...

    @property
    def n_cells(self) -> int:
        """K, the cells of a map."""
        ...

    def start(self, cells: UInt8Array, before: HitsBefore | None = None) -> GibbsState:
        """Return the state of a map (K,); what rays hit may be kept from another map."""
        ...

    def found(self) -> tuple[BoolArray, AnyArray] | None:
        """Return what a model of these rays and more need not find again; None: nothing.

        See `PatchModel`: which cells (K,) rays tell of, and `telling` (N,) of the rays.
        """
        ...

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
        """Do one sweep in place; return the number of flips.

        `settling` says that it does not count: whatever leaves a bad start soonest will do.
        `focus` is what `focus` returned, None to draw everything alike. `chances` (K,) may be
        filled with what cells were drawn with, in `PARTS`, to be counted in their place.
        `power`: of the likelihood, 1 but in sweeps that settle chains of a model that
        `begins_cold`.
        """
        ...

    def focus(self, in_doubt: BoolArray, moving: BoolArray) -> PatchPlaces | None:
        """Return what makes sweeps come by settled cells seldom; `in_doubt` (K,) are not.

        `moving` (K,) are cells whose probabilities are to be told, where they are near to these.
        """
        ...

    def log_likelihood(self, state: GibbsState) -> float:
        """Log p(z | m, x), nats."""
        ...

    def arrival(self, probability: Float32Array, least: float) -> Float32Array:
        """Return (K,) the chance that a ray arrives at a cell; see `informed.arrival`."""
        ...

    def forget(
        self,
        rng: Generator,
        state: GibbsState,
        prior_log_odds: float,
        sweeps: int,
        only: BoolArray | None = None,
    ) -> None:
        """Draw sampled cells one by one, as if they were independent with this prior.

        `only` some cells (K,); a model may draw others, too.
        """
        ...


class Estimate(NamedTuple):
    """Posterior mean (C,) of the touched cells after so many counted sweeps of each chain.

    `draws`: the maps of all chains that it is the mean of.
    """

    mean: Float32Array
    sweeps: int
    draws: int


class Focus(NamedTuple):
    """Where a chain's sweeps look most.

    `after`: decided after so many sweeps; `cells` (2, C): touched cells that are in doubt, that
    move; `places`: what the model's `focus` made of these.
    """

    after: int
    cells: BoolArray
    places: PatchPlaces | None


class PosteriorSampler:
    """Chains of one model, each in a thread of its own, with counts for the posterior mean.

    Each chain has a child of the seed as its generator, so the result is the same however threads
    are scheduled and whatever number of sweeps is asked for at a time.

    With `may_end` the burn-in, of at least `LEAST_BURN_IN` sweeps, is no longer than it has to be:
    from its half on it ends where the chains agree about the later two thirds of it. `burn_in` is
    then what it was. It is sweeps that do not count which say so; those that count do not. Starts
    must be far apart, or forgotten, for that; of those that are the same it is never shorter.

    Sweeps look most where there is doubt: in cells that a chain's own maps disagree about and at
    which a ray arrives. Which these are is decided in the burn-in, after 8 of its sweeps, 16, ...
    and two before its end, from all but the first quarter of the sweeps up to then; no sweep that
    counts has a say. Were the focus to follow the counts it would bias them: a cell that happened
    to stay free is drawn seldom from then on, and would keep what it was chosen for. So after the
    last decision two sweeps draw everything, and then every cell has a fixed chance to be drawn,
    in all counted sweeps the same, which leaves the posterior as it is. A burn-in of fewer than
    ten sweeps tells too little: all sweeps draw everything. Of cells that move the probability
    that they were drawn with is counted, not what was drawn; see the design note of
    `ogm_mcmc.sampling.patch_places`.

    `hits` of each chain are what rays hit first on a map of before, see `HitsBefore`.

    Sweeps of the burn-in are counted apart, for a map to show before there are others; see
    `present_estimate`. A result is `estimate`: of counted sweeps alone, as R-hat and errors are.
    """

    round_s = 0.1
    """So long may `advance` take at a time: Python costs nothing, a stop is not waited for."""

    def __init__(
        self,
        model: PosteriorModel,
        starts: Sequence[UInt8Array],
        *,
        seed: int | Sequence[int],
        burn_in: int,
        may_end: bool = False,
        hits: Sequence[HitsBefore] = (),
    ) -> None:
        self.model = model
        self.burn_in = burn_in
        apart = any(not np.array_equal(starts[0], start) for start in starts[1:])
        self.may_end = may_end and apart and burn_in >= LEAST_BURN_IN
        self.sweeps = 0
        self.rngs = np.random.default_rng(seed).spawn(len(starts))
        with ThreadPoolExecutor(max(len(starts), 1)) as pool:
            before = [hits] if hits else []
            self.states = list(pool.map(model.start, starts, *before))
        self.counts = [BatchCounts(model.touched.size) for _ in starts]
        # Sweeps of the burn-in, by chain, as long as a map is made of them.
        self.settling = [BatchCounts(model.touched.size) for _ in starts if burn_in > 0]
        self.focus: dict[int, Focus] = {}  # by chain, from the first decision on

    def advance(self, n_sweeps: int) -> int:
        """Do so many sweeps in every chain; return the number of flips in all."""
        flips, left = 0, n_sweeps
        for look in self._end_looks():
            if self.sweeps < look <= self.sweeps + left:
                left -= look - self.sweeps
                flips += self._advance_all(look - self.sweeps)
                self._end_burn_in()
        flips += self._advance_all(left)
        if self.counted > 0 and self.counts[0].merged is not None and not self._helping():
            self.settling = []
        return flips

    def _advance_all(self, n_sweeps: int) -> int:
        """Do so many sweeps in every chain, in none of which the burn-in may end early."""
        n_chains = len(self.states)
        with ThreadPoolExecutor(n_chains) as pool:
            flips = sum(pool.map(self._advance_one, range(n_chains), [n_sweeps] * n_chains))
        self.sweeps += n_sweeps
        return flips

    def _end_looks(self) -> list[int]:
        """Return after how many sweeps it is decided whether the burn-in ends two later."""
        return end_looks(self.burn_in) if self.may_end and self.sweeps < self.burn_in else []

    def _end_burn_in(self) -> None:
        """Let the burn-in end after the sweeps of the last focus, if the chains agree by now."""
        # It may have ended at an earlier look.
        if self.may_end and ends_with(self.settling, self._informed):
            self.burn_in, self.may_end = self.sweeps + FRESH, False

    def settling_share(self, limit: float) -> float:
        """Return the share of informed cells with R-hat below a limit in the burn-in so far.

        See `agreement`; 0 once sweeps of the burn-in are let go.
        """
        return agreement(self.settling, self._informed, limit)

    def maps(self) -> list[UInt8Array]:
        """Return every chain's present map (K,)."""
        return [state.cells for state in self.states]

    def _advance_one(self, chain: int, n_sweeps: int) -> int:
        flips = 0
        state, counts = self.states[chain], self.counts[chain]
        settled = self.settling[chain] if self.settling else None
        chances = np.full(self.model.n_cells, NO_CHANCE, np.uint8)
        for i in range(n_sweeps):
            done = self.sweeps + i
            settling = done < self.burn_in
            into = settled if settling else counts
            power = power_after(self.burn_in, done) if self.model.begins_cold else 1.0
            flips += self.model.advance(
                self.rngs[chain],
                state,
                settling=settling,
                focus=self._focus_of(chain, done),
                chances=None if into is None else chances,
                power=power,
            )
            if into is not None:
                add_occupied(state.cells, chances, self.model.touched, into.row)
                into.sweep_added()
        return flips

    def _focus_of(self, chain: int, done: int) -> PatchPlaces | None:
        """Return what the sweep after so many looks at most, None when it draws everything."""
        if decides_after(self.burn_in, done):
            told = self.settling[chain]
            first = told.full // 4
            parts = told.counts[first : told.full + 1].sum(axis=0, dtype=np.int64)
            parts_of_one = PARTS * (told.n_sweeps - first * told.batch_length)
            mean = (parts / parts_of_one).astype(np.float32)
            moving = (mean > SETTLED) & (mean < 1.0 - SETTLED)
            self.look_at(chain, done, np.stack((moving & self._informed(mean), moving)))
        focus = self.focus.get(chain)
        if focus is None or draws_everything(self.burn_in, done):
            return None
        return focus.places

    def look_at(self, chain: int, after: int, cells: BoolArray) -> None:
        """Let a chain look most at these of the touched cells, see `Focus`."""
        whole = np.zeros((2, self.model.n_cells), np.bool_)
        whole[:, self.model.touched] = cells
        self.focus[chain] = Focus(after, cells, self.model.focus(*whole))

    @property
    def n_chains(self) -> int:
        """How many chains there are."""
        return len(self.counts)

    @property
    def counted(self) -> int:
        """Sweeps of each chain that count."""
        return self.counts[0].n_sweeps

    def estimate(self) -> Estimate:
        """Return the posterior mean of the counted sweeps; before the first, what there is.

        That is the mean of the later half of the burn-in, and without a sweep of the starts.
        """
        if self.counted == 0:
            return self.present_estimate()
        return self._mean_of([(counts.total(), counts.n_sweeps) for counts in self.counts])

    def present_estimate(self) -> Estimate:
        """Return a mean to show while sampling goes on, soon smooth, but no result.

        Until as many sweeps count, those of the later half of the burn-in are in it, too.
        """
        parts = [(counts.total(), counts.n_sweeps) for counts in self.counts if self.counted > 0]
        parts += [(counts.recent(), counts.n_recent) for counts in self._helping()]
        return self._mean_of(parts or [(cells[self.model.touched], 1) for cells in self.maps()])

    def _mean_of(self, parts: Sequence[tuple[AnyArray, int]]) -> Estimate:
        """Return the mean of maps: how often (C,) cells were occupied in how many."""
        total, draws = np.zeros(self.model.touched.size), 0
        for occupied, n_maps in parts:
            total += occupied
            draws += n_maps
        return Estimate((total / draws).astype(np.float32), self.counted, draws)

    def _helping(self) -> list[BatchCounts]:
        return [counts for counts in self.settling if counts.n_recent > self.counted]

    def quality(self) -> ChainQuality | None:
        """Judge the chains (see `assess`); None while they are too short."""
        return assess(self.counts)

    def arrival(self, mean: Float32Array) -> Float32Array:
        """Return (K,) the chance that a ray arrives at a cell, given the mean (C,)."""
        model = self.model
        probability = np.ones(model.n_cells, np.float32)
        probability[model.touched] = mean
        return model.arrival(probability, ARRIVES)

    def _informed(self, mean: Float32Array) -> BoolArray:
        """Return which of the touched cells (C,) a ray arrives at, given their mean (C,)."""
        informed: BoolArray = self.arrival(mean)[self.model.touched] >= ARRIVES
        return informed

    def informed_quality(self) -> ChainQuality | None:
        """Judge the chains by the cells at which a ray arrives that tells anything of them.

        What lies behind a surface, or in the flat tail of a ray, has nothing to agree about: it
        is the prior's.
        """
        quality = self.quality()
        if quality is None:
            return None
        return quality.of(self._informed(quality.mean))

    def log_likelihoods(self) -> list[float]:
        """Log p(z | m) of every chain's present map, nats."""
        return [self.model.log_likelihood(state) for state in self.states]

    def draw_maps(self, count: int, thin: int) -> Iterator[UInt8Array]:
        """Yield `count` maps (K,), `thin` sweeps apart, from the chains in turn."""
        require(thin > 0, 'thin', thin, 'expected at least 1')
        for i in range(count):
            if i % self.n_chains == 0:
                self.advance(thin)
            yield self.maps()[i % self.n_chains].copy()

    @property
    def n_bytes(self) -> int:
        """Memory of states and counts."""
        states = sum(array.nbytes for state in self.states for array in state)
        counted = sum(counts.counts.nbytes for counts in (*self.counts, *self.settling))
        return int(states + counted)
