"""Many independent data sets: all cores, resumed when interrupted.

Every finished data set leaves one JSON file, named after it and after everything it was made
with. A later run computes only those that are missing: one with another seed, another size,
another version, or with code or a shipped prior that was edited since, finds nothing of its own
and leaves what is there alone. Workers are processes
started afresh (spawn): no state is inherited, so a data set gives the same result alone or among
many.
Ctrl-C, SIGTERM and errors end them at once (see `ogm_mcmc.lab.experiments.worker_pool`).
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from ogm_mcmc import __version__
from ogm_mcmc.engine.prior_files import default_prior_file
from ogm_mcmc.errors import ConfigError, OgmError
from ogm_mcmc.files.output_files import folder_to_fill, replacing
from ogm_mcmc.files.signals import signals_later
from ogm_mcmc.lab.experiments.worker_pool import worker_pool
from ogm_mcmc.lab.workers import LOOK_S, check

__all__ = [
    'WORKERS_VARIABLE',
    'ExperimentError',
    'code_digest',
    'digest_of',
    'run_all',
    'using_executor',
    'worker_count',
]

WORKERS_VARIABLE = 'OGM_MCMC_WORKERS'

Work = Callable[..., dict[str, Any]]

# What no result is made by: commands, nodes, pictures.
NOT_OF_RESULTS = ('cli', 'plotting', 'ros')

# Parts in progress, and their names.
Running = dict[Future[dict[str, Any]], str]


class ExperimentError(OgmError, RuntimeError):
    """A data set of an experiment could not be computed."""


_executor: ContextVar[Executor | None] = ContextVar('executor', default=None)


@contextmanager
def using_executor(executor: Executor | None) -> Iterator[None]:
    """Let `run_all` send data sets to an executor, whoever calls it inside; None: processes."""
    token = _executor.set(executor)
    try:
        yield
    finally:
        _executor.reset(token)


def worker_count() -> int:
    """Return how many processes to use: those of the environment variable, or all cores."""
    wanted = os.environ.get(WORKERS_VARIABLE, '')
    if not wanted:
        return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else 1
    if not wanted.isdigit() or int(wanted) < 1:
        raise ConfigError(f'{WORKERS_VARIABLE} is {wanted!r}: expected at least 1')
    return int(wanted)


def run_all(
    folder: Path,
    work: Work,
    datasets: Mapping[str, Mapping[str, Any]],
    *,
    title: str = 'data sets',
    depends_on: Mapping[str, Any] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
) -> dict[str, dict[str, Any]]:
    """Call `work(**arguments)` for every data set; return the results by name.

    `work` is a function of a module, its arguments and results are fit for JSON. Finished ones
    are kept in `folder`. `depends_on`: what the results depend on beside arguments, code and prior
    of the package, constants and files that `work` reads. Raises ExperimentError when a process
    dies; what is finished stays.
    `executor`, or that of `using_executor`, takes the place of local processes: anything with the
    interface of concurrent.futures, a cluster's as well.
    """
    executor = executor or _executor.get()
    results: dict[str, dict[str, Any]] = {}
    missing: dict[str, Mapping[str, Any]] = {}
    parts = {
        name: _Part.of(folder, name, work, arguments, depends_on or {})
        for name, arguments in datasets.items()
    }
    for name, arguments in datasets.items():
        held = parts[name].held()
        if held is None:
            missing[name] = arguments
        else:
            results[name] = held
    count = min(workers or worker_count(), max(1, len(missing)))
    with (
        folder_to_fill(folder),
        tqdm(
            total=len(datasets), initial=len(results), desc=title, unit=' sets', disable=None
        ) as bar,
    ):

        def keep(name: str, result: dict[str, Any]) -> None:
            with signals_later():
                parts[name].keep(result)
            results[name] = result
            bar.update()

        if executor is not None:
            _elsewhere(executor, work, missing, keep)
        elif count == 1:
            for name, arguments in missing.items():
                keep(name, work(**arguments))
        else:
            _in_processes(work, missing, count, keep)
    return {name: results[name] for name in datasets}


def _in_processes(
    work: Work,
    missing: Mapping[str, Mapping[str, Any]],
    count: int,
    keep: Callable[[str, dict[str, Any]], None],
) -> None:
    try:
        with worker_pool(count) as pool:
            # Nothing is cancelled: a pool that is killed tells its futures so in a thread, which
            # fails, and says so at length, where one of them was cancelled.
            _collect(_begun(pool, work, missing), keep)
    except BrokenProcessPool as error:
        raise ExperimentError(
            'a worker process died (out of memory?): expected it to finish; '
            f'start again to go on, with fewer workers by {WORKERS_VARIABLE}'
        ) from error


def _elsewhere(
    executor: Executor,
    work: Work,
    missing: Mapping[str, Mapping[str, Any]],
    keep: Callable[[str, dict[str, Any]], None],
) -> None:
    """Work on an executor that goes on to live: after an error, nothing more is begun."""
    running = _begun(executor, work, missing)
    try:
        _collect(running, keep, executor)
    finally:
        for future in running:
            future.cancel()


def _begun(executor: Executor, work: Work, missing: Mapping[str, Mapping[str, Any]]) -> Running:
    return {executor.submit(work, **arguments): name for name, arguments in missing.items()}


def _collect(
    running: Running,
    keep: Callable[[str, dict[str, Any]], None],
    executor: Executor | None = None,
) -> None:
    """Keep every result as it comes, and take it from those that are running.

    Raises ClusterError where the workers of an `executor` are all gone, and stay away.
    """
    while running:
        done, _ = wait(running, None if executor is None else LOOK_S, FIRST_COMPLETED)
        if not done and executor is not None:
            check(executor)
        # Those that failed at the same moment come last: what is finished is kept.
        for future in sorted(done, key=_failed):
            keep(running.pop(future), future.result())


def _failed(future: Future[dict[str, Any]]) -> bool:
    return future.cancelled() or future.exception() is not None


def digest_of(*contents: bytes) -> str:
    """Return what tells contents apart, for `depends_on`."""
    whole = hashlib.sha256()
    for content in contents:
        whole.update(content)
    return whole.hexdigest()[:16]


@cache
def code_digest() -> str:
    """Return what tells the code of the package and its prior from those of another day."""
    package = Path(__file__).parents[2]
    sources = sorted(
        path
        for path in package.rglob('*.py')
        if path.relative_to(package).parts[0] not in NOT_OF_RESULTS
    )
    named = (str(path.relative_to(package)).encode() + path.read_bytes() for path in sources)
    return digest_of(*named, default_prior_file().read_bytes())


class _Part(NamedTuple):
    """The file of a data set, and what it has to be made with."""

    path: Path
    made_with: dict[str, Any]

    @classmethod
    def of(
        cls,
        folder: Path,
        name: str,
        work: Work,
        arguments: Mapping[str, Any],
        depends_on: Mapping[str, Any],
    ) -> _Part:
        text = json.dumps(
            {
                'work': f'{work.__module__}.{work.__qualname__}',
                'version': __version__,
                'code': code_digest(),
                'arguments': arguments,
                'depends_on': depends_on,
            },
            sort_keys=True,
        )
        digest = hashlib.sha256(text.encode()).hexdigest()[:10]
        return cls(folder / f'{name}_{digest}.json', json.loads(text))

    def held(self) -> dict[str, Any] | None:
        """Return the result in the file if it is whole; anything else is made anew."""
        try:
            content = json.loads(self.path.read_text(encoding='utf-8'))
            same, result = content['made_with'] == self.made_with, content['result']
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return result if same and isinstance(result, dict) and result else None

    def keep(self, result: dict[str, Any]) -> None:
        content = {'made_with': self.made_with, 'result': result}
        with replacing(self.path) as temporary:
            temporary.write_text(json.dumps(content) + '\n', encoding='utf-8')
