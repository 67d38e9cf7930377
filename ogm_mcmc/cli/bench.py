"""`bench CASE`: how fast things are, as JSON.

`bench online [--scene FILE] [BAG]`: the mapping call. `bench simulate`: beams through cells.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from ogm_mcmc.benchmarks.online import time_online
from ogm_mcmc.benchmarks.scene import generated_scene, load_scene
from ogm_mcmc.benchmarks.simulation import time_simulation
from ogm_mcmc.cli.options import (
    Subparsers,
    add_config_options,
    add_stream_options,
    config_from,
    stream_choice,
)
from ogm_mcmc.config import MapperConfig, PlacingConfig
from ogm_mcmc.errors import BagError, ConfigError, require
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.scan_stream import PlacedScans, choose_topics
from ogm_mcmc.io.world_files import load_world
from ogm_mcmc.pipeline import mounted, sensor_mount
from ogm_mcmc.simulation import GridWorld, Lidar

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('bench', help='measure speed; prints JSON')
    cases = parser.add_subparsers(dest='case', required=True, metavar='CASE')
    online = cases.add_parser('online', help='the mapping call, on the fixed scene and on a bag')
    online.add_argument('bag', nargs='?', type=Path, help='bag to map as well')
    online.add_argument('--scene', type=Path, help='NPZ of the scene; default: a generated one')
    online.add_argument('--repeats', type=int, default=15, help='passes; the best one counts')
    online.add_argument('--json', action='store_true', help='always JSON; accepted for symmetry')
    add_config_options(online, 'mapping', MapperConfig, PlacingConfig)
    add_stream_options(online)
    online.set_defaults(run=run_online)
    simulate = cases.add_parser('simulate', help='beams through cells, and a whole data set')
    simulate.add_argument('--world', default='building-5', help='as for the command simulate')
    simulate.add_argument('--beams', type=int, default=180)
    simulate.add_argument('--range-max', type=float, default=7.5, help='m')
    simulate.add_argument('--scans', type=int, default=200, help='in the data set')
    simulate.add_argument('--seed', type=int, default=1)
    simulate.add_argument('--repeats', type=int, default=7, help='passes; the best one counts')
    simulate.add_argument('--json', action='store_true', help='always JSON; for symmetry')
    simulate.set_defaults(run=run_simulate)


def run_simulate(options: argparse.Namespace) -> int:
    """Run `bench simulate`."""
    require(options.repeats > 0, 'repeats', options.repeats, 'expected at least one pass')
    require(options.seed >= 0, 'seed', options.seed, 'expected 0 or more')
    world = load_world(options.world)
    if not isinstance(world, GridWorld):
        raise ConfigError(f'world is {options.world!r}: expected one that is made of cells')
    lidar = Lidar(options.beams, range_max_m=options.range_max, noise_m=0.03, dropout=0.0)
    result = time_simulation(world, lidar, options.repeats, options.seed, options.scans)
    print(json.dumps({'world': options.world, **result}))
    return 0


def run_online(options: argparse.Namespace) -> int:
    """Run `bench online`."""
    require(options.repeats > 0, 'repeats', options.repeats, 'expected at least one pass')
    config = config_from(options, MapperConfig)
    scene = generated_scene() if options.scene is None else load_scene(options.scene)
    # The scene stays the same whatever the bag needs: beams that hit nothing clear.
    scene_config = replace(config, resolution=scene.resolution_m, no_return='clear', max_range=0.0)
    result: dict[str, Any] = {
        'scene': {
            **time_online(scene.placements, scene_config, options.repeats),
            'source': scene.source,
        }
    }
    if options.bag is not None:
        placing = config_from(options, PlacingConfig)
        mount = sensor_mount(placing.mount)
        with BagReader(options.bag) as bag:
            choice = stream_choice(options, placing)
            placed = PlacedScans(bag, choose_topics(bag, choice), choice)
            placements = [mounted(scan, robot, mount) for scan, robot in placed]
        if not placements:
            raise BagError(f'{options.bag}: no scan in it could be placed')
        result['bag'] = {
            **time_online(placements, config, options.repeats),
            'source': options.bag.name,
        }
    print(json.dumps(result))
    return 0
