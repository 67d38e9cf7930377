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

import asyncio
import copy
import hashlib
import tempfile
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc import __version__
from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import ClusterError, ConfigError, PriorError, WindowError
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.lab.parcels import pack, unpack
from ogm_mcmc.sampling import PosteriorModel, PosteriorSampler
from ogm_mcmc.sampling.diagnostics import BatchCounts

__all__ = ['ChainState', 'Workers', 'advance_chain', 'connected', 'distribute']

ANSWER_S = 10.0
WORKERS_S = 30.0

LAST_PORT = 65535
EXPECTED = 'expected the address of a Dask scheduler, such as tcp://host:8786'

# A task may be lost with so many workers before it is to blame itself.
RETRIES = 3


@contextmanager
def connected(address: str) -> Iterator[Workers | None]:
    """Give the workers of a Dask scheduler as an executor; None without an address.

    Raises ConfigError where `distributed` is not installed, and ClusterError when the scheduler
    does not answer, has no workers, they run another version, or tasks were lost for good.
    """
    if not address:
        yield None
        return
    try:
        from distributed import Client, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise ConfigError(
            f'--scheduler needs distributed ({error}): pip install "ogm_mcmc[cluster]"'
        ) from error
    _check_address(address)
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f'scheduler {address}: no answer; {EXPECTED}') from error
    try:
        _check_workers(client, address)
        yield Workers(client)
    except KilledWorker as error:
        raise ClusterError(
            f'scheduler {address}: a task was lost with every worker that tried it '
            '(out of memory?)'
        ) from error
    except (CancelledError, CommClosedError) as error:
        raise ClusterError(
            f'scheduler {address}: lost; expected it to run until the end'
        ) from error
    finally:
        client.close()


class Workers(Executor):
    """The workers of a Dask cluster, `client` its client."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self._pool = client.get_executor(pure=False, retries=RETRIES)

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let any worker do it; a worker that is lost costs nothing."""
        done: Future[Any] = self._pool.submit(fn, *args, **kwargs)
        return done

    def at(self, worker: str) -> Executor:
        """Return one of the workers alone; what it is given waits for it if it is gone."""
        alone: Executor = self.client.get_executor(pure=False, retries=RETRIES, workers=[worker])
        return alone

    def share(self, data: bytes) -> Any:
        """Send something to every worker, once; return what stands for it in tasks."""
        return self.client.scatter(data, broadcast=True, hash=False)


def _check_address(address: str) -> None:
    """Raise ClusterError unless a scheduler answers.

    Only then is a Client made: one that fails to connect may hang when it is thrown away.
    """
    from distributed.comm import get_address_host_port

    try:
        _, port = get_address_host_port(address)
        if not 0 < port <= LAST_PORT:
            raise ValueError(port)
    except (ImportError, ValueError) as error:
        raise ClusterError(f'scheduler {address}: {EXPECTED}') from error
    try:
        found = asyncio.run(_who_answers(address))
    except OSError as error:
        raise ClusterError(f'scheduler {address}: no answer; {EXPECTED}') from error
    except (RuntimeError, TypeError) as error:
        # An encrypted connection without certificates, or a plain one where that is forbidden.
        reason = ' '.join(str(error).split())
        raise ClusterError(
            f"scheduler {address}: {reason}; expected what distributed.comm of Dask's "
            'configuration allows'
        ) from error
    if found != 'Scheduler':
        raise ClusterError(f'scheduler {address}: is a {found}; {EXPECTED}')


async def _who_answers(address: str) -> str:
    """Return what kind of Dask server an address is of: Scheduler, Worker, Nanny."""
    from distributed.comm import connect
    from distributed.core import send_recv
    from distributed.security import Security

    settings = Security().get_connection_args('client')
    comm = await connect(address, timeout=ANSWER_S, **settings)
    try:
        answer = await asyncio.wait_for(send_recv(comm, op='identity'), ANSWER_S)
        return str(answer['type'])
    finally:
        comm.abort()


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError as error:
        raise ClusterError(f'scheduler {address}: no workers; expected at least one') from error
    try:
        versions = set(client.run(_version).values())
    except ImportError as error:
        raise ClusterError(
            f'scheduler {address}: a worker lacks {error.name}: expected ogm_mcmc on all'
        ) from error
    if versions != {__version__}:
        raise ClusterError(
            f'scheduler {address}: workers run ogm_mcmc {", ".join(sorted(versions))}: '
            f'expected {__version__}'
        )


def _version() -> str:
    return __version__


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

    `n_rays` and `n_cells` are those of the window at home.
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


def share(executor: Executor, data: bytes) -> Any:
    """Return what stands for data in the tasks of an executor: sent once where that is known."""
    return executor.share(data) if isinstance(executor, Workers) else data


def pack_problem(config: SamplerConfig, scans: Sequence[PlacedScan]) -> bytes:
    """Return everything that a window is built from; nothing of a belief but its mean."""
    file = config.patch.prior_file
    # It was read before, for the problem at home: what is wrong with it has been said.
    prior = user_path(file, 'patch.prior_file', PriorError).read_bytes() if file else None
    return pack(scans, (config, prior))


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
    scans, (config, prior) = unpack(parcel)
    with prior_at_hand(config, prior) as here:
        refinement = Refinement(here)
        refinement.take(scans)
    sampler = refinement.sampler
    assert sampler is not None
    found = refinement.size.n_rays, sampler.model.n_cells
    if found != (problem.n_rays, problem.n_cells):
        raise WindowError(
            f'{found[0]} rays in {found[1]} cells on a worker: expected the '
            f'{problem.n_rays} in {problem.n_cells} of the window at home'
        )
    return sampler.model


@contextmanager
def prior_at_hand(config: SamplerConfig, prior: bytes | None) -> Iterator[SamplerConfig]:
    """Give settings that name a file with this prior, where there is one."""
    if prior is None:
        yield config
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'prior.npz'
        file.write_bytes(prior)
        yield replace(config, patch=replace(config.patch, prior_file=str(file)))
