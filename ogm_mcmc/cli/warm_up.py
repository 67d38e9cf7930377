"""`warm-up`: compile the kernels of both nodes; what starts later loads them from the cache."""

from __future__ import annotations

import argparse
import time

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.live_map import warm_up_mapping
from ogm_mcmc.engine.warm_up import warm_up_collisions, warm_up_sampling

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
    """Run the command."""
    start = time.monotonic()
    warm_up_mapping(MapperConfig())
    warm_up_sampling(RefineSamplerConfig())
    warm_up_collisions()
    seconds = time.monotonic() - start
    print_result(options, {'seconds': seconds}, f'kernels ready after {seconds:.1f} s')
    return 0
