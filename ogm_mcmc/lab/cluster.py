"""Work on other machines: a Dask cluster in the place of local processes.

Design note: what a lost machine costs
--------------------------------------
Context. Data sets and chains are independent, and machines fail. Work that lives in a worker's
memory would be lost with it.

Decision. Nothing lives there. A task is a function of its arguments alone: a data set's settings,
or where a chain stands (`ChainState`: its map, counts and random generator) and how many sweeps to
do. Dask gives the task of a lost worker to another one, which finds what the first would have
found, bit for bit. What a worker keeps is the ray index of the last window, built from the scans
when the first chain comes by; another worker builds it again. Between rounds the chains stand
where the command runs, so R-hat is of all chains, and an interrupted run can be saved. The scans
go to every worker once, packed (`parcels`); were they gone with all workers that had them, they
would be sent again.

Consequence. Every round ships a chain's counts both ways (32 bytes per sampled cell), so rounds
last seconds, not tenths. The result is that of local chains with the same seed.
"""

from __future__ import annotations

import copy
import hashlib
import threading
from collections.abc import Sequence
from concurrent.futures import CancelledError, Executor
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.engine.posterior import patch_prior, posterior_of
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.lab.parcels import pack, unpack
from ogm_mcmc.lab.workers import RETRIES, share
from ogm_mcmc.sampling import PosteriorModel, PosteriorSampler
from ogm_mcmc.sampling.diagnostics import BatchCounts

__all__ = ['ChainState', 'advance_chain', 'digest', 'distribute', 'pack_problem']


class ChainState(NamedTuple):
    """Where a chain stands: its map as bits (K / 8,), counts, generator, sweeps done.

    `settling`: counts of the burn-in, as long as anything follows from them; `in_focus`: where it
    looks most, as bits (2 C / 8,), decided `after` so many sweeps; -1: nowhere.
    """

    cells: UInt8Array
    counts: BatchCounts
    settling: BatchCounts | None
    rng: np.random.Generator
    sweeps: int
    after: int
    in_focus: UInt8Array

    @classmethod
    def of(cls, sampler: PosteriorSampler, j: int) -> ChainState:
        """Return where a chain of a sampler stands."""
        focus = sampler.focus.get(j)
        return cls(
            np.packbits(sampler.states[j].cells),
            sampler.counts[j],
            sampler.settling[j] if sampler.settling else None,
            sampler.rngs[j],
            sampler.sweeps,
            -1 if focus is None else focus.after,
            np.empty(0, np.uint8) if focus is None else np.packbits(focus.cells),
        )

    def focus_into(self, sampler: PosteriorSampler, j: int) -> None:
        """Let a chain of a sampler look most where this one does."""
        known = sampler.focus.get(j)
        if self.after >= 0 and (known is None or known.after != self.after):
            n = 2 * sampler.model.touched.size
            cells = np.unpackbits(self.in_focus, count=n).reshape(2, -1).view(np.bool_)
            sampler.look_at(j, self.after, cells)


class Problem(NamedTuple):
    """What a worker builds a model from: `token` is the digest of its parcel.

    `n_rays` and `n_cells` are those of the window at home: all rays, those that merge included.
    """

    token: str
    n_rays: int
    n_cells: int


def distribute(refinement: Refinement, scans: Sequence[PlacedScan], executor: Executor) -> None:
    """Let the chains of a refinement be advanced by an executor from now on.

    `scans` are those that the refinement took. Counts come back after every round: R-hat, map
    and state of the refinement are of all chains. New scans end it: `take` makes local chains.
    """
    here = refinement.sampler
    if here is None:
        raise WindowError('no scan was taken: nothing to sample')
    # What was found out here is not looked for again by a worker.
    parcel = pack_problem(refinement.found_settings(), scans)
    problem = Problem(digest(parcel), refinement.size.n_rays, here.model.n_cells)
    refinement.sampler = _DistantSampler(here, problem, parcel, executor)


class _DistantSampler(PosteriorSampler):
    """Chains that stand here between rounds and are advanced elsewhere."""

    round_s = 5.0

    def __init__(
        self, here: PosteriorSampler, problem: Problem, parcel: bytes, executor: Executor
    ) -> None:
        super().__init__(here.model, [], seed=0, burn_in=here.burn_in)
        self.may_end = here.may_end
        self.rngs, self.states, self.counts = here.rngs, here.states, here.counts
        self.sweeps, self.settling, self.focus = here.sweeps, here.settling, here.focus
        self._problem, self._executor = problem, executor
        self._parcel = parcel
        self._shared: Any = None  # what stands for the parcel once it was sent

    def _advance_all(self, n_sweeps: int) -> int:
        results = self._sent(n_sweeps)
        for j, (chain, _) in enumerate(results):
            cells = np.unpackbits(chain.cells, count=self.model.n_cells)
            self.states[j] = self.model.start(cells)
            self.counts[j], self.rngs[j] = chain.counts, chain.rng
            chain.focus_into(self, j)
        self.settling = [chain.settling for chain, _ in results if chain.settling is not None]
        self.sweeps += n_sweeps
        return sum(flips for _, flips in results)

    def _sent(self, n_sweeps: int) -> list[tuple[ChainState, int]]:
        """Let every chain be advanced; send the scans again if no worker has them any more."""
        for left in reversed(range(RETRIES)):
            if self._shared is None:
                self._shared = share(self._executor, self._parcel)
            standing = [ChainState.of(self, j) for j in range(len(self.states))]
            sent = self._problem, self._shared
            futures = [
                self._executor.submit(advance_chain, *sent, chain, self.burn_in, n_sweeps)
                for chain in standing
            ]
            try:
                return [future.result() for future in futures]
            except CancelledError:
                if left == 0:
                    raise
                self._shared = None
            finally:
                for future in futures:
                    future.cancel()
        raise AssertionError


def advance_chain(
    problem: Problem, parcel: bytes, chain: ChainState, burn_in: int, n_sweeps: int
) -> tuple[ChainState, int]:
    """Return where a chain stands after so many sweeps more, and the number of flips."""
    model = _model_of(problem, parcel)
    sampler = PosteriorSampler(model, [], seed=0, burn_in=burn_in)
    sampler.sweeps = chain.sweeps
    sampler.states = [model.start(np.unpackbits(chain.cells, count=model.n_cells))]
    # Should this be done again, it has to begin at the same.
    sampler.counts, sampler.rngs = [copy.deepcopy(chain.counts)], [copy.deepcopy(chain.rng)]
    sampler.settling = [copy.deepcopy(chain.settling)] if chain.settling is not None else []
    chain.focus_into(sampler, 0)
    flips = sampler.advance(n_sweeps)
    return ChainState.of(sampler, 0), flips


def pack_problem(config: SamplerConfig, scans: Sequence[PlacedScan]) -> bytes:
    """Return everything that a window is built from; nothing of a belief but its mean.

    The table of the prior is in it: 4 MB, but its file need not be where workers are, and none of
    them has to make it, which takes 2 s.
    """
    return pack(scans, (config, patch_prior(config).table))


def digest(parcel: bytes) -> str:
    """Return what tells one parcel from another."""
    return hashlib.sha256(parcel).hexdigest()


_lock = threading.Lock()
_models: dict[str, PosteriorModel] = {}


def _model_of(problem: Problem, parcel: bytes) -> PosteriorModel:
    """Return the model of a problem, built when it is first asked for in this process."""
    with _lock:
        model = _models.get(problem.token)
        if model is None:
            _models.clear()
            model = _models[problem.token] = _built(problem, parcel)
    return model


def _built(problem: Problem, parcel: bytes) -> PosteriorModel:
    scans, (config, table) = unpack(parcel)
    window, model = posterior_of(config, scans, table)
    found = window.n_beams, model.n_cells
    if found != (problem.n_rays, problem.n_cells):
        raise WindowError(
            f'{found[0]} rays in {found[1]} cells on a worker: expected the '
            f'{problem.n_rays} in {problem.n_cells} of the window at home'
        )
    return model
