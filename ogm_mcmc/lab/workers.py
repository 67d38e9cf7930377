"""The workers of a Dask cluster as an executor; what they are sent: `ogm_mcmc.lab.cluster`."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from typing import Any

from ogm_mcmc import __version__
from ogm_mcmc.errors import ClusterError, ConfigError

__all__ = ['RETRIES', 'Workers', 'connected', 'share', 'submit_again']

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
        self._had: dict[int, str] = {}  # which worker had the last task of a key
        self._pool = client.get_executor(pure=False, retries=RETRIES)

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let any worker do it; a worker that is lost costs nothing."""
        done: Future[Any] = self._pool.submit(fn, *args, **kwargs)
        return done

    def again(self, key: int, fn: Any, /, *args: Any) -> Future[Any]:
        """Let the worker do it that had the last task of this key, or another if need be."""
        there: dict[str, int] = self.client.nthreads()
        if there and self._had.get(key) not in there:
            had = Counter(self._had.values())
            self._had[key] = min(sorted(there), key=lambda one: had[one] / there[one])
        near = self.client.get_executor(
            pure=False,
            retries=RETRIES,
            workers=[self._had[key]] if key in self._had else None,
            allow_other_workers=key in self._had,
        )
        done: Future[Any] = near.submit(fn, *args)
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


def submit_again(executor: Executor, key: int, fn: Any, /, *args: Any) -> Future[Any]:
    """Submit a task, to the worker that had the last one of this key where there are several."""
    if isinstance(executor, Workers):
        return executor.again(key, fn, *args)
    return executor.submit(fn, *args)


def share(executor: Executor, data: bytes) -> Any:
    """Return what stands for data in the tasks of an executor: sent once where that is known."""
    return executor.share(data) if isinstance(executor, Workers) else data
