"""Entry points of the nodes: the installed scripts and `python3 -m ogm_mcmc.ros NODE`.

Whoever starts a node may stop it at once. Until it can handle signals by itself (`StopSignal`)
there is nothing to clean up, so SIGINT and SIGTERM end the process on the spot, with code 0.
"""

from __future__ import annotations

import importlib
import os

from ogm_mcmc.files.processes import end_with_parent
from ogm_mcmc.files.signals import end_at_once_on_signals

__all__ = ['NODES', 'online_mapper', 'refine_server', 'replay', 'run']

NODES = ('online_mapper', 'refine_server', 'replay')


def online_mapper() -> None:
    """Run the node `online_mapper` until Ctrl-C or SIGTERM."""
    run('online_mapper')


def refine_server() -> None:
    """Run the node `refine_server` until Ctrl-C or SIGTERM."""
    run('refine_server')


def replay() -> None:
    """Run the node `replay` until it is done, Ctrl-C or SIGTERM."""
    run('replay')


def run(node: str) -> None:
    """Run a node of `NODES` and leave with its exit code."""
    end_at_once_on_signals(0)
    end_with_parent()
    main = importlib.import_module(f'ogm_mcmc.ros.{node}').main
    try:
        main()
    except SystemExit as end:
        leave(end.code if isinstance(end.code, int) else int(end.code is not None))


def leave(code: int) -> None:
    """End the process at once: nodes have cleaned up, and nothing else is left to do.

    The interpreter's own way out takes half a second of CPU time (what Numba loaded is taken
    down), and waits for a thread in the compiler, which cannot stop. On a busy robot that is
    longer than the five seconds that launch gives a node before it sends SIGTERM.
    """
    end_at_once_on_signals(code)  # what was said is out by then
    os._exit(code)
