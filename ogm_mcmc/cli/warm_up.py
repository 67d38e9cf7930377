"""`warm-up`: compile the kernels of both nodes; what starts later loads them from the cache."""

from __future__ import annotations

import argparse
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.live_map import warm_up_mapping
from ogm_mcmc.engine.warm_up import (
    warm_up_chains,
    warm_up_collisions,
    warm_up_maps,
    warm_up_sampling,
)

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
    spawn = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        beside = pool.submit(_beside_chains, config)
        warm_up_chains(config)
        try:
            beside.result()
        except BrokenProcessPool:  # killed
            _beside_chains(config)
    warm_up_sampling(config)  # what both may have left
    seconds = time.monotonic() - start
    print_result(options, {'seconds': seconds}, f'kernels ready after {seconds:.1f} s')
    return 0


def _beside_chains(config: RefineSamplerConfig) -> None:
    """Compile, or load from the cache, what `warm_up_chains` leaves."""
    warm_up_mapping(MapperConfig())
    warm_up_maps(config)
    warm_up_collisions()
