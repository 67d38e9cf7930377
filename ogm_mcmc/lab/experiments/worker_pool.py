"""Processes for independent work that end when whoever started them does, however that comes.

Design note: an end within a second
-----------------------------------
Context. Parts take long and are kept only when finished: after an error, Ctrl-C or SIGTERM there
is nothing to wait for. `ProcessPoolExecutor` waits all the same, leaves its processes behind when
its own process is killed, and cannot be told otherwise before Python 3.14.

Decision. The pool's processes are the children this process got since the pool was made
(`multiprocessing.active_children`); whatever ends the `with` early kills them. They watch their
parent and end when it is gone. Ctrl-C at a terminal reaches every process there: they block it
from their first moment, so it is the parent's alone. While a process is started, or a result is
put in its place (`signals_later`), signals wait: both take milliseconds, and half a start would
leave a process that nobody knows of.

Consequence. Workers get no chance to clean up: what they leave is for their parent to write.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from ogm_mcmc.files.signals import starting_children

__all__ = ['worker_pool']

P = ParamSpec('P')
T = TypeVar('T')


@contextmanager
def worker_pool(count: int) -> Iterator[Executor]:
    """Give an executor of so many processes, started afresh (spawn); no work outlives the `with`.

    Leaving it in good order waits for what was submitted; an error or a signal kills it.
    """
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context('spawn')
    pool = _Pool(count, mp_context=context, initializer=_end_with_the_parent)
    try:
        yield pool
    except BaseException:
        for worker in set(multiprocessing.active_children()) - others:
            worker.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


class _Pool(ProcessPoolExecutor):
    """Starts its processes where work is submitted."""

    def submit(self, fn: Callable[P, T], /, *arguments: P.args, **keywords: P.kwargs) -> Future[T]:
        """Submit work; signals wait for it."""
        with starting_children():
            return super().submit(fn, *arguments, **keywords)


def _end_with_the_parent() -> None:
    """Watch the parent, in a thread: a pool's process would wait for work forever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, name='parent', daemon=True).start()
