"""`simulate WORLD -o BAG`: a walk through a simulated building."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.errors import require
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.simulation import WORLDS, Lidar, record

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('simulate', help='record a walk through a simulated building')
    parser.add_argument('world', choices=sorted(WORLDS), help='building')
    parser.add_argument('-o', '--output', type=Path, required=True, help='rosbag2 to make')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing bag')
    parser.add_argument('--seed', type=int, default=1, help='seed of the noise')
    parser.add_argument('--beams', type=int, default=360)
    parser.add_argument('--range-max', type=float, default=12.0, help='m')
    parser.add_argument('--noise', type=float, default=0.01, help='of the ranges, m')
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    require(options.seed >= 0, 'seed', options.seed, 'expected 0 or more')
    lidar = Lidar(options.beams, range_max_m=options.range_max, noise_m=options.noise)
    walk = record(WORLDS[options.world](), lidar, np.random.default_rng(options.seed))
    with tqdm(walk, unit=' scans', desc='simulate', disable=None) as scans:
        count = write_recording(options.output, scans, overwrite=options.overwrite)
    result = {'bag': str(options.output), 'scans': count, 'seed': options.seed}
    print_result(options, result, f'{count} scans -> {options.output} (seed {options.seed})')
    return 0
