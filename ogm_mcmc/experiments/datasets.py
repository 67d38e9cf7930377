"""Many independent data sets: all cores, resumed when interrupted.

Every finished data set leaves one JSON file with what it was made with. A later run computes
only those that are missing or were made with anything else. Workers are processes started
afresh (spawn): no state is inherited, so a data set gives the same result alone or among many.
Ctrl-C, SIGTERM and errors end them at once (see `ogm_mcmc.experiments.worker_pool`).
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ogm_mcmc.errors import ConfigError, OgmError
from ogm_mcmc.experiments.worker_pool import signals_later, worker_pool
from ogm_mcmc.io.map_files import replacing, writable_folder

__all__ = ['WORKERS_VARIABLE', 'ExperimentError', 'run_all', 'using_executor', 'worker_count']

WORKERS_VARIABLE = 'OGM_MCMC_WORKERS'

Work = Callable[..., dict[str, Any]]


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
    workers: int | None = None,
    executor: Executor | None = None,
) -> dict[str, dict[str, Any]]:
    """Call `work(**arguments)` for every data set; return the results by name.

    `work` is a function of a module, its arguments and results are fit for JSON. Finished ones
    are kept in `folder`. Raises ExperimentError when a process dies; what is finished stays.
    `executor`, or that of `using_executor`, takes the place of local processes: anything with the
    interface of concurrent.futures, a cluster's as well.
    """
    writable_folder(folder)
    executor = executor or _executor.get()
    results: dict[str, dict[str, Any]] = {}
    missing: dict[str, Mapping[str, Any]] = {}
    for name, arguments in datasets.items():
        held = _held(folder / f'{name}.json', work, arguments)
        if held is None:
            missing[name] = arguments
        else:
            results[name] = held
    count = min(workers or worker_count(), max(1, len(missing)))
    with tqdm(
        total=len(datasets), initial=len(results), desc=title, unit=' sets', disable=None
    ) as bar:

        def keep(name: str, result: dict[str, Any]) -> None:
            with signals_later():
                _keep(folder / f'{name}.json', work, datasets[name], result)
            results[name] = result
            bar.update()

        if executor is not None:
            _submitted(executor, work, missing, keep)
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
            _submitted(pool, work, missing, keep)
    except BrokenProcessPool as error:
        raise ExperimentError(
            'a worker process died (out of memory?): expected it to finish; '
            f'start again to go on, with fewer workers by {WORKERS_VARIABLE}'
        ) from error


def _submitted(
    executor: Executor,
    work: Work,
    missing: Mapping[str, Mapping[str, Any]],
    keep: Callable[[str, dict[str, Any]], None],
) -> None:
    """Keep every result as it comes; after an error, nothing more is begun."""
    running: dict[Future[dict[str, Any]], str] = {
        executor.submit(work, **arguments): name for name, arguments in missing.items()
    }
    try:
        while running:
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                keep(running.pop(future), future.result())
    finally:
        for future in running:
            future.cancel()


def _made_with(work: Work, arguments: Mapping[str, Any]) -> dict[str, Any]:
    made: dict[str, Any] = json.loads(
        json.dumps({'work': f'{work.__module__}.{work.__qualname__}', 'arguments': arguments})
    )
    return made


def _held(path: Path, work: Work, arguments: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the result in a file if it was made with the same; anything else is made anew."""
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
        same = content['made_with'] == _made_with(work, arguments)
        result: dict[str, Any] | None = content['result'] if same else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return result


def _keep(path: Path, work: Work, arguments: Mapping[str, Any], result: dict[str, Any]) -> None:
    content = {'made_with': _made_with(work, arguments), 'result': result}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content) + '\n', encoding='utf-8')
