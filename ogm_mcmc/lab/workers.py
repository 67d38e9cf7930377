"""The workers of a Dask cluster as an executor; what they are sent: `ogm_mcmc.lab.cluster`."""

from __future__ import annotations

import asyncio
import logging
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from typing import Any

from ogm_mcmc import __version__
from ogm_mcmc.errors import ClusterError, ConfigError

__all__ = [
    'LOOK_S',
    'RETRIES',
    'Workers',
    'check',
    'connected',
    'done_by',
    'place',
    'share',
    'spread',
    'submit_again',
    'this_worker',
]

ANSWER_S = 10.0
WORKERS_S = 30.0

# How long answers are waited for before it is asked whether any worker is still there.
LOOK_S = 5.0

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
        # What is lost is said in a line here, not in a traceback of its thread.
        logging.getLogger('distributed.client').setLevel(logging.CRITICAL)
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
        self._holder: dict[int, str] = {}  # the worker that keeps what belongs to a key
        self._pool = client.get_executor(pure=False, retries=RETRIES)
        self._near: dict[str, Executor] = {}
        self._alone_since: float | None = None

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let any worker do it; a worker that is lost costs nothing."""
        done: Future[Any] = self._pool.submit(fn, *args, **kwargs)
        return done

    def threads(self) -> dict[str, int]:
        """Return who is there, with how many threads. Raises ClusterError where nobody says."""
        with _scheduler_there():
            return dict(self.client.nthreads())

    def check(self) -> None:
        """Raise ClusterError where no worker has been there for as long as one is waited for."""
        if self.threads():
            self._alone_since = None
            return
        now = time.monotonic()
        if self._alone_since is None:
            self._alone_since = now
        if now - self._alone_since > WORKERS_S:
            raise ClusterError(
                f'no worker is left, nor came in {WORKERS_S:g} s: expected at least one'
            )

    def asked(self, fn: Any) -> dict[str, Any]:
        """Return what each worker says that answers: those that are gone by now cost nothing."""
        try:
            return dict(self.client.run(fn, on_error='ignore'))
        except OSError:  # the scheduler is gone, too
            return {}

    def place(self, keys: Sequence[int]) -> set[int]:
        """Ask who is there, and bind every key to a worker; return those with another one now."""
        before = self._holder
        self._holder = spread(keys, before, self.threads())
        return {key for key in keys if self._holder.get(key) != before.get(key)}

    def again(self, key: int, fn: Any, /, *args: Any) -> Future[Any]:
        """Let the worker do it that a key is bound to, or another if need be."""
        worker = self._holder.get(key)
        if worker is None:
            return self.submit(fn, *args)
        if worker not in self._near:
            self._near[worker] = self.client.get_executor(
                pure=False, retries=RETRIES, workers=[worker], allow_other_workers=True
            )
        return self._near[worker].submit(fn, *args)

    def done_by(self, key: int, worker: str) -> None:
        """Bind a key to the worker that did its last task: another may have taken it over."""
        self._holder[key] = worker

    def held(self) -> dict[str, list[int]]:
        """Return the keys that are bound to each worker."""
        workers = sorted(set(self._holder.values()))
        return {
            worker: sorted(key for key, holder in self._holder.items() if holder == worker)
            for worker in workers
        }

    def at(self, worker: str) -> Executor:
        """Return one of the workers alone; what it is given waits for it if it is gone."""
        alone: Executor = self.client.get_executor(pure=False, retries=RETRIES, workers=[worker])
        return alone

    def share(self, data: bytes) -> Any:
        """Send something to every worker, once; return what stands for it in tasks."""
        with _scheduler_there():
            return self.client.scatter(data, broadcast=True, hash=False, timeout=WORKERS_S)


@contextmanager
def _scheduler_there() -> Iterator[None]:
    """Raise ClusterError where a scheduler is gone, or has no workers to give something to."""
    try:
        yield
    except OSError as error:
        raise ClusterError(
            f'the cluster is lost ({error}); expected scheduler and workers to run until the end'
        ) from error


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
        with _scheduler_there():
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


def spread(
    keys: Sequence[int], holder: Mapping[int, str], threads: Mapping[str, int]
) -> dict[int, str]:
    """Return the worker of each key, of workers with so many threads; {} where there is none.

    That is who had it before, unless that one is gone, or so full that another one, who joined
    since, would have less to do for each of its threads with one key more.
    """
    if not threads:
        return {}
    there = sorted(threads)
    placed = {key: holder[key] for key in keys if holder.get(key) in threads}
    count = Counter(placed.values())

    def with_one_more(worker: str) -> float:
        return (count[worker] + 1) / threads[worker]

    for key in keys:
        if key not in placed:
            placed[key] = min(there, key=with_one_more)
            count[placed[key]] += 1
    while True:
        full = max(there, key=lambda worker: count[worker] / threads[worker])
        free = min(there, key=with_one_more)
        if count[full] / threads[full] <= with_one_more(free):
            return placed
        placed[max(key for key, worker in placed.items() if worker == full)] = free
        count[full] -= 1
        count[free] += 1


def place(executor: Executor, keys: Sequence[int]) -> set[int]:
    """Bind keys to workers, where there are several; return those with another one than before."""
    return executor.place(keys) if isinstance(executor, Workers) else set()


def check(executor: Executor) -> None:
    """Raise ClusterError where the workers of an executor are all gone, and stay away."""
    if isinstance(executor, Workers):
        executor.check()


def submit_again(executor: Executor, key: int, fn: Any, /, *args: Any) -> Future[Any]:
    """Submit a task, to the worker that its key is bound to where there are several."""
    if isinstance(executor, Workers):
        return executor.again(key, fn, *args)
    return executor.submit(fn, *args)


def done_by(executor: Executor, key: int, worker: str) -> None:
    """Note which worker did the last task of a key; '' says that there is none."""
    if isinstance(executor, Workers) and worker:
        executor.done_by(key, worker)


def this_worker() -> str:
    """Return the address of the worker that this runs in, '' in none."""
    # Where a task of a worker runs it is imported.
    distributed = sys.modules.get('distributed')
    try:
        return '' if distributed is None else str(distributed.get_worker().address)
    except ValueError:
        return ''


def share(executor: Executor, data: bytes) -> Any:
    """Return what stands for data in the tasks of an executor: sent once where that is known."""
    return executor.share(data) if isinstance(executor, Workers) else data
