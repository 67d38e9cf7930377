"""`replay BAG`: publish a bag; the ROS node, started from the command line."""

from __future__ import annotations

import argparse

from ogm_mcmc.cli.options import Subparsers
from ogm_mcmc.config import add_arguments, build, given
from ogm_mcmc.config.nodes import ReplayConfig
from ogm_mcmc.errors import BagError, ConfigError
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.io.bags import BagReader

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('replay', help='publish a bag over ROS 2')
    parser.add_argument('bag', help='ROS 1 bag or rosbag2')
    add_arguments(parser, ReplayConfig)
    parser.add_argument('--json', action='store_true', help='print what was done as JSON')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    build(ReplayConfig, given(options, ReplayConfig))
    with BagReader(user_path(options.bag, 'bag', BagError)):
        pass  # A wrong value or path is said at once, before ROS starts.
    try:
        from ogm_mcmc.ros.replay import replay
    except ImportError as error:
        raise ConfigError(
            f'replay needs rclpy ({error}): pip install "ogm_mcmc[ros]", or source a ROS 2 setup'
        ) from error
    return replay(options, [])
