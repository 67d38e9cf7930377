"""`bench CASE`: how fast things are, as JSON.

`bench online [--scene FILE] [BAG]`: the mapping call. `bench sample [--scene FILE] [BAG]`: the
full posterior. `bench refine [--scene FILE] [BAG]`: what `~/refine` takes until its map can be
relied on. `bench simulate`: beams through cells.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.cli.bag_scans import read_bag
from ogm_mcmc.cli.option_ranges import Range, check_options, option_name, refused
from ogm_mcmc.cli.options import (
    Subparsers,
    add_config_options,
    add_stream_options,
    config_from,
)
from ogm_mcmc.cli.simulated_sensor import FURTHEST_M
from ogm_mcmc.cli.simulated_world import check_cells
from ogm_mcmc.config import ForwardModelConfig, PlacingConfig
from ogm_mcmc.config.nodes import NodeMapperConfig, NodeWindowConfig, RefineSamplerConfig
from ogm_mcmc.engine.no_returns import NoReturnChoice, no_return_of
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import PlacedScan, PoseBelief
from ogm_mcmc.io.world_files import load_world
from ogm_mcmc.lab.benchmarks.online import time_online
from ogm_mcmc.lab.benchmarks.refine import Patience, recorded_office, time_refining
from ogm_mcmc.lab.benchmarks.sample import Effort, bag_config, scene_config, time_sampling
from ogm_mcmc.lab.benchmarks.scene import generated_scene, load_scene
from ogm_mcmc.lab.benchmarks.simulation import time_simulation
from ogm_mcmc.simulation import GridWorld, Lidar

__all__ = ['add_to']

SIMULATE_RANGES = {
    'beams': Range(1, 100_000),
    'range_max': Range(0, FURTHEST_M, 'm'),
    'scans': Range(1, 100_000),
    'seed': Range(0),
    'repeats': Range(1),
}

ONLINE_RANGES = {
    'repeats': Range(1),
    'pose_sigma': Range(0, 1000, 'm'),
    'yaw_sigma': Range(0, 1000, 'rad'),
}

SAMPLE_RANGES = {
    'sweeps': Range(1),
    'warm_up': Range(0),
    'resolution': Range(0.001, 10, 'm'),
    'cell_prior': Range(1e-6, 1.0 - 1e-6),
}

REFINE_RANGES = {
    'time': Range(0.1, 1e6, 's'),
    'better_time': Range(0.1, 1e6, 's'),
    'resolution': Range(0.001, 10, 'm'),
}

# The recorded scene has a noise of two cells.
SCENE_CELLS = 2.0


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('bench', help='measure speed; prints JSON')
    cases = parser.add_subparsers(dest='case', required=True, metavar='CASE')
    online = cases.add_parser('online', help='the mapping call, on the fixed scene and on a bag')
    online.add_argument('bag', nargs='?', type=Path, help='bag to map as well')
    online.add_argument('--scene', type=Path, help='NPZ of the scene; default: a generated one')
    online.add_argument('--repeats', type=int, default=15, help='passes; the best one counts')
    online.add_argument('--json', action='store_true', help='always JSON; accepted for symmetry')
    online.add_argument(
        '--pose-sigma', type=float, default=0.0, help='doubt about every position, m (1 sigma)'
    )
    online.add_argument(
        '--yaw-sigma', type=float, default=0.0, help='doubt about every heading, rad (1 sigma)'
    )
    add_config_options(online, 'mapping', NodeMapperConfig, PlacingConfig)
    add_stream_options(online)
    online.set_defaults(run=run_online)
    _add_sample(cases)
    _add_refine(cases)
    simulate = cases.add_parser('simulate', help='beams through cells, and a whole data set')
    simulate.add_argument('--world', default='building-5', help='as for the command simulate')
    simulate.add_argument('--beams', type=int, default=180)
    simulate.add_argument('--range-max', type=float, default=7.5, help='m')
    simulate.add_argument('--scans', type=int, default=200, help='in the data set')
    simulate.add_argument('--seed', type=int, default=1)
    simulate.add_argument('--repeats', type=int, default=7, help='passes; the best one counts')
    simulate.add_argument('--json', action='store_true', help='always JSON; for symmetry')
    simulate.set_defaults(run=run_simulate)


def _add_sample(cases: Subparsers) -> None:
    sample = cases.add_parser('sample', help='sampling, on the fixed scene and on a bag')
    sample.add_argument('bag', nargs='?', type=Path, help='bag to sample as well')
    sample.add_argument('--scene', type=Path, help='NPZ of the scene; default: a generated one')
    sample.add_argument(
        '--resolution', type=float, nargs='+', help='of the bag, m (default: 0.05 0.02)'
    )
    sample.add_argument(
        '--no-return', choices=('clear', 'ignore'),
        help='of the bag: what +inf says; CARMEN logs do not tell glass from nothing '
        '(default: ignore)',
    )  # fmt: skip
    sample.add_argument('--cell-prior', type=float, default=0.15)
    sample.add_argument('--warm-up', type=int, default=20, help='sweeps before any is timed')
    sample.add_argument('--sweeps', type=int, default=20, help='timed sweeps; the best one counts')
    sample.add_argument('--json', action='store_true', help='always JSON; accepted for symmetry')
    add_config_options(sample, 'placing', PlacingConfig)
    add_stream_options(sample)
    sample.set_defaults(run=run_sample)


def _add_refine(cases: Subparsers) -> None:
    refine = cases.add_parser(
        'refine',
        help='seconds until chains agree and until a map is better than the live one, effective '
        'samples per second: the scene, a simulated office, and a bag',
    )
    refine.add_argument('bag', nargs='?', type=Path, help='bag to refine as well')
    refine.add_argument('--scene', type=Path, help='NPZ of the scene; default: a generated one')
    refine.add_argument('--only-bag', action='store_true', help='leave out scene and office')
    refine.add_argument('--resolution', type=float, help='of the bag, m (default: 0.05)')
    refine.add_argument(
        '--no-return', choices=('clear', 'ignore'), help='of the bag: what +inf says '
        '(default: ignore)',
    )  # fmt: skip
    refine.add_argument(
        '--time', type=float, default=60.0, metavar='S', help='wait so long for agreement, s'
    )
    refine.add_argument(
        '--better-time', type=float, default=10.0, metavar='S',
        help='judge by held-out beams for so long, s',
    )  # fmt: skip
    refine.add_argument('--json', action='store_true', help='always JSON; accepted for symmetry')
    add_config_options(refine, 'placing', PlacingConfig)
    add_stream_options(refine)
    refine.set_defaults(run=run_refine)


def run_refine(options: argparse.Namespace) -> int:
    """Run `bench refine`: the settings of `refine_server` as they come."""
    check_options(options, REFINE_RANGES)
    _refuse_without_bag(options, ('resolution', 'no_return'))
    if options.only_bag and options.bag is None:
        raise ConfigError('--only-bag: expected with a BAG')
    patience = Patience(options.time, options.better_time)
    result: dict[str, Any] = {}
    if not options.only_bag:
        scene = generated_scene() if options.scene is None else load_scene(options.scene)
        cell = scene.resolution_m
        noisy = RefineSamplerConfig(
            model=ForwardModelConfig(sigma=SCENE_CELLS * cell),
            window=NodeWindowConfig(cell, no_return='clear'),
        )
        result['scene'] = {
            **time_refining(scene.placed, noisy, patience), 'source': scene.source,
        }  # fmt: skip
        # Held-out beams are judged with one meaning: as `auto` finds it for simulated walls.
        as_they_come = RefineSamplerConfig(window=NodeWindowConfig(no_return='clear'))
        office = time_refining(recorded_office(), as_they_come, patience)
        result['office'] = {**office, 'source': 'simulated office'}
    if options.bag is not None:
        window = NodeWindowConfig(
            options.resolution or 0.05,
            no_return=options.no_return or 'ignore',
            max_memory_mb=1e6,
        )
        placed = read_bag(options, config_from(options, PlacingConfig)).placed
        bag = time_refining(placed, RefineSamplerConfig(window=window), patience)
        result['bag'] = {**bag, 'source': options.bag.name}
    print(json.dumps(result))
    return 0


def run_sample(options: argparse.Namespace) -> int:
    """Run `bench sample`."""
    check_options(options, SAMPLE_RANGES)
    # The scene comes with cells and beams of its own.
    _refuse_without_bag(options, ('resolution', 'no_return'))
    cells = options.resolution or [0.05, 0.02]
    no_return = options.no_return or 'ignore'
    effort = Effort(options.warm_up, options.sweeps)
    prior = options.cell_prior
    bag_configs = {
        f'bag {100.0 * cell:g} cm': bag_config(cell, no_return, prior) for cell in cells
    }
    scene = generated_scene() if options.scene is None else load_scene(options.scene)
    result: dict[str, Any] = {
        name: {
            **time_sampling(scene.placed, scene_config(scene.resolution_m, cut, prior), effort),
            'source': scene.source,
        }
        for name, cut in (('scene', 0.0), ('scene cut at 4 sigma', 4.0))
    }
    if options.bag is not None:
        placed = read_bag(options, config_from(options, PlacingConfig)).placed
        for name, config in bag_configs.items():
            result[name] = {
                **time_sampling(placed, config, effort),
                'source': options.bag.name,
            }
    print(json.dumps(result))
    return 0


def run_simulate(options: argparse.Namespace) -> int:
    """Run `bench simulate`."""
    nearest = Lidar().range_min_m
    check_options(options, SIMULATE_RANGES)
    if options.range_max <= nearest:
        raise refused('range_max', options.range_max, f'expected more than {nearest:g} m')
    world = load_world(options.world)
    if not isinstance(world, GridWorld):
        raise ConfigError(f'--world is {options.world!r}: expected one that is made of cells')
    check_cells('range_max', options.range_max, world.spec.resolution_m)
    lidar = Lidar(options.beams, range_max_m=options.range_max, noise_m=0.03, dropout=0.0)
    result = time_simulation(world, lidar, options.repeats, options.seed, options.scans)
    print(json.dumps({'world': options.world, **result}))
    return 0


def run_online(options: argparse.Namespace) -> int:
    """Run `bench online`."""
    check_options(options, ONLINE_RANGES)
    # The scene stays the same whatever a bag needs.
    _refuse_without_bag(options, ('resolution', 'no_return', 'max_range'))
    config = config_from(options, NodeMapperConfig)
    sigmas = (options.pose_sigma, options.pose_sigma, options.yaw_sigma)
    scene = generated_scene() if options.scene is None else load_scene(options.scene)
    # The scene stays the same whatever the bag needs: beams that hit nothing clear.
    scene_config = replace(config, resolution=scene.resolution_m, no_return='clear', max_range=0.0)
    result: dict[str, Any] = {
        'scene': {
            **time_online(doubted(scene.placed, sigmas), scene_config, options.repeats),
            'source': scene.source,
        }
    }
    if options.bag is not None:
        placing = config_from(options, PlacingConfig)
        placed = read_bag(options, placing, config).placed
        found = (
            NoReturnChoice.of_cones(config.no_return)
            if config.method == 'sonar'
            else no_return_of(config.no_return, placed, config.resolution, config.max_range)
        )
        config = replace(config, no_return=found.value)
        result['bag'] = {
            **time_online(doubted(placed, sigmas), config, options.repeats),
            'no_return': found.value,
            'source': options.bag.name,
        }
    print(json.dumps(result))
    return 0


def _refuse_without_bag(options: argparse.Namespace, names: tuple[str, ...]) -> None:
    """Refuse options that are about the bag where there is none."""
    if options.bag is not None:
        return
    given = [name for name in names if getattr(options, name) is not None]
    given += [name for name in ('scan_topic', 'pose_topic') if getattr(options, name)]
    if given:
        raise ConfigError(f'{option_name(given[0])}: expected with a BAG, the scene has its own')


def doubted(placed: list[PlacedScan], sigmas: tuple[float, float, float]) -> list[PlacedScan]:
    """Give each pose a Gaussian belief around it; without sigmas nothing changes."""
    if not any(sigmas):
        return placed
    covariance = np.diag(np.square(sigmas))
    return [PlacedScan(scan, PoseBelief(belief.mean, covariance)) for scan, belief in placed]
