"""`warm-up`: compile the kernels of both nodes; what starts later loads them from the cache."""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import time
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from typing import Any

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.compiling import uncollected
from ogm_mcmc.engine.live_map import warm_up_mapping
from ogm_mcmc.engine.warm_up import (
    warm_up_chains,
    warm_up_changes,
    warm_up_collisions,
    warm_up_maps,
    warm_up_sampling,
)
from ogm_mcmc.files.signals import starting_children

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'warm-up',
        help='compile what both nodes need with their defaults, so that they start at once: when '
        'an image is built, before a drive',
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command: the compiler takes one core, so two processes share the work."""
    start = time.monotonic()
    config = RefineSamplerConfig()
    with uncollected():
        with beside(_beside_chains, config) as process:
            warm_up_chains(config)
            process.join()
        if process.exitcode != 0:  # killed, or at fault: here it is said why
            _beside_chains(config)
        warm_up_sampling(config)  # what both may have left
    seconds = time.monotonic() - start
    print_result(options, {'seconds': seconds}, f'kernels ready after {seconds:.1f} s')
    return 0


@contextlib.contextmanager
def beside(work: Callable[..., object], *arguments: Any) -> Iterator[BaseProcess]:
    """Have work done in a new process, which is ended at once where it goes on after the block.

    Ctrl-C does not reach it: this process leaves the block, and ends it.
    """
    spawn = multiprocessing.get_context('spawn')
    process = spawn.Process(target=work, args=arguments, daemon=True)
    try:
        with starting_children():
            process.start()
        yield process
    finally:
        if process.pid is not None:
            process.terminate()
            process.join()


def _beside_chains(config: RefineSamplerConfig) -> None:
    """Compile, or load from the cache, what `warm_up_chains` leaves or comes to last."""
    with uncollected():
        warm_up_mapping(MapperConfig())
        warm_up_maps(config)
        warm_up_collisions()
        warm_up_changes(config)
