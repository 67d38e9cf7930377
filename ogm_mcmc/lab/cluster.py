"""Work on other machines: a Dask cluster in the place of local processes.

Design note: what a lost machine costs
--------------------------------------
Context. Data sets and chains are independent, and machines fail. Work that lives in a worker's
memory alone would be lost with it.

Decision. After every round each chain is known where the command runs, too: its map, generator
and counts. So R-hat is of all chains, and an interrupted run can be saved. A worker keeps the ray
index of the last window, built from the scans when the first chain comes by, and the chains that
it advanced: it is asked to go on with a chain by its mark alone, and says only what the sweeps
added (`chain_parcels`). Before a round the scheduler is asked, once, who is there. A chain goes
to the worker that had it, unless that is gone, or has more chains for each of its threads than
another, who joined since, would have with this one (`workers.spread`). A worker that does not keep
a chain under its mark says so, and is told its state, while others still sample: in place of one
that is gone or busy, or again, if its last answer was lost. From then on the chain is there. It
finds what the first would have found, bit for bit. The scans go to every worker once, packed
(`parcels`); were they gone with all workers that had them, they would be sent again.

Consequence. A worker that is lost costs the sweeps of a round, and the time to build its index;
the last one, and none that comes in its place for half a minute, ends the command.
Tried before: tasks that are functions of their arguments alone. Every round then ships a chain's
counts both ways (64 bytes per sampled cell), and finds the first hits of all rays anew, on the
worker and where the command runs. The result is that of local chains with the same seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from typing import Any, NamedTuple

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.engine.posterior import patch_prior
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.lab.chain_parcels import unpack_bits, unpack_rows
from ogm_mcmc.lab.chain_worker import (
    Advanced,
    ChainJob,
    ChainState,
    Problem,
    Unknown,
    advance_chain,
)
from ogm_mcmc.lab.memory import peak_mb
from ogm_mcmc.lab.parcels import pack
from ogm_mcmc.lab.workers import (
    LOOK_S,
    RETRIES,
    Workers,
    check,
    done_by,
    place,
    share,
    submit_again,
)
from ogm_mcmc.sampling import GibbsState, PosteriorSampler

__all__ = ['ChainTraffic', 'DistantSampler', 'digest', 'distribute', 'pack_problem']


class ChainTraffic(NamedTuple):
    """Jobs, and bytes of the chains that were sent, and of what came back."""

    jobs: int = 0
    told: int = 0
    answered: int = 0

    def and_job(self, job: ChainJob) -> ChainTraffic:
        """Return it with one job more."""
        return self._replace(jobs=self.jobs + 1, told=self.told + job.n_bytes)

    def and_answer(self, answer: Advanced) -> ChainTraffic:
        """Return it with one answer more."""
        return self._replace(answered=self.answered + answer.n_bytes)


def distribute(
    refinement: Refinement, scans: Sequence[PlacedScan], executor: Executor
) -> DistantSampler:
    """Let the chains of a refinement be advanced by an executor from now on; return its sampler.

    `scans` are those that the refinement took. What was drawn comes back after every round: R-hat,
    map and state of the refinement are of all chains. New scans end it: `take` makes local chains.
    """
    here = refinement.sampler
    if here is None:
        raise WindowError('no scan was taken: nothing to sample')
    # What was found out here is not looked for again by a worker.
    parcel = pack_problem(refinement.beams.as_given(refinement.config), scans)
    problem = Problem(digest(parcel), refinement.size.n_rays, here.model.n_cells)
    distant = refinement.sampler = DistantSampler(here, problem, parcel, executor)
    return distant


class DistantSampler(PosteriorSampler):
    """Chains that are advanced elsewhere, and known here between rounds.

    What rays hit first on their maps is looked for here when somebody asks for it (`states`).
    """

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
        self._marks = [''] * self.n_chains  # of chains that a worker keeps
        self._log_likelihoods: list[float] | None = None
        self.traffic = ChainTraffic()

    @property
    def states(self) -> list[GibbsState]:
        """Where chains stand; what rays hit first on a new map is found now."""
        for j, cells in self._new.items():
            self._states[j] = self.model.start(cells)
        self._new.clear()
        return self._states

    @states.setter
    def states(self, states: list[GibbsState]) -> None:
        self._states = states
        self._new: dict[int, UInt8Array] = {}

    def maps(self) -> list[UInt8Array]:
        """Return every chain's present map (K,)."""
        return [self._new.get(j, state.cells) for j, state in enumerate(self._states)]

    def log_likelihoods(self) -> list[float]:
        """Log p(z | m) of every chain's present map, nats."""
        known = self._log_likelihoods
        return super().log_likelihoods() if known is None else list(known)

    def figures(self) -> dict[str, Any]:
        """Return what was sent, and by worker which chains it has and its memory at the most.

        Bytes of the scans went to each worker once; `told` and `answered` are of chains. Workers
        that are gone by now are left out.
        """
        workers = {}
        if isinstance(self._executor, Workers):
            peaks = self._executor.asked(peak_mb)
            held = self._executor.held()
            workers = {
                worker: {'chains': [j + 1 for j in held.get(worker, [])], 'peak_mb': peak}
                for worker, peak in sorted(peaks.items())
            }
        sent = {'parcel_bytes': len(self._parcel), **self.traffic._asdict()}
        return {**sent, 'workers': workers}

    def _advance_all(self, n_sweeps: int) -> int:
        answers = self._answers(n_sweeps)
        for j, answer in enumerate(answers):
            self.traffic = self.traffic.and_answer(answer)
            cells = unpack_bits(answer.cells, self.model.n_cells)
            self._new[j], self._marks[j] = cells, answer.mark
            self.rngs[j].bit_generator.state = answer.generator
            occupied = cells[self.model.touched] != 0
            for row, n_added in unpack_rows(answer.counted, occupied):
                self.counts[j].add(row, n_added)
            for row, n_added in unpack_rows(answer.settling, occupied):
                self.settling[j].add(row, n_added)
            if answer.looks is not None:
                answer.looks.into(self, j)
        self.sweeps += n_sweeps
        self._log_likelihoods = [answer.log_likelihood for answer in answers]
        return sum(answer.flips for answer in answers)

    def _answers(self, n_sweeps: int) -> list[Advanced]:
        """Let every chain be advanced; send the scans again if no worker has them any more."""
        futures: list[Future[Advanced | Unknown]] = []
        for left in reversed(range(RETRIES)):
            if self._shared is None:
                self._shared = share(self._executor, self._parcel)
            for j in place(self._executor, range(self.n_chains)):
                self._marks[j] = ''  # whoever does it next is told where the chain stands
            try:
                return self._answered(n_sweeps, futures)
            except CancelledError:
                if left == 0:
                    raise
                self._shared, self._marks = None, [''] * self.n_chains
            finally:
                while futures:
                    futures.pop().cancel()
        raise AssertionError

    def _answered(
        self, n_sweeps: int, futures: list[Future[Advanced | Unknown]]
    ) -> list[Advanced]:
        """Return what became of every chain; `futures` are those that were waited for."""
        found: dict[int, Advanced] = {}
        waiting: dict[Future[Advanced | Unknown], int] = {}
        ask = list(range(self.n_chains))
        while len(found) < self.n_chains:
            sent = {self._sent(j, n_sweeps): j for j in ask}
            futures += sent
            waiting.update(sent)
            ask.clear()
            while not (done := wait(waiting, LOOK_S, return_when=FIRST_COMPLETED).done):
                check(self._executor)
            for future in done:
                j, answer = waiting.pop(future), future.result()
                done_by(self._executor, j, answer.worker)
                if isinstance(answer, Advanced):
                    found[j] = answer
                else:
                    self._marks[j] = ''
                    ask.append(j)
        return [found[j] for j in range(self.n_chains)]

    def _sent(self, j: int, n_sweeps: int) -> Future[Advanced | Unknown]:
        """Let a chain be advanced, by the worker that keeps it if there is one."""
        mark = self._marks[j]
        state = None if mark else ChainState.of(self, j)
        job = ChainJob(j, mark, self.burn_in, n_sweeps, state)
        self.traffic = self.traffic.and_job(job)
        return submit_again(self._executor, j, advance_chain, self._problem, self._shared, job)


def pack_problem(config: SamplerConfig, scans: Sequence[PlacedScan]) -> bytes:
    """Return everything that a window is built from; nothing of a belief but its mean.

    The table of the prior is in it: 4 MB, but its file need not be where workers are, and none of
    them has to make it, which takes 2 s.
    """
    return pack(scans, (config, patch_prior(config).table))


def digest(parcel: bytes) -> str:
    """Return what tells one parcel from another."""
    return hashlib.sha256(parcel).hexdigest()
