"""`call SERVICE`: what `ros2 service call` does, where there is no ros2."""

from __future__ import annotations

import argparse

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.errors import ConfigError

__all__ = ['add_to']

DATA = {'true': True, 'false': False}


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser('call', help='call a service of a running node')
    parser.add_argument(
        'service',
        nargs='?',
        help='with the name of its node: refine_server/refine, online_mapper/save_map; '
        'without one: list those that can be called (Trigger and SetBool)',
    )
    parser.add_argument(
        'value', nargs='?', choices=tuple(DATA), help='of a SetBool, such as online_mapper/pause'
    )
    parser.add_argument(
        '--timeout',
        type=float,
        default=10.0,
        help='time to wait for the service, and again for its answer, s; default %(default)g',
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    if not 0.0 < options.timeout < float('inf'):
        raise ConfigError(f'--timeout is {options.timeout:g}: expected more than 0 s')
    try:
        from ogm_mcmc.ros.calling import call_service, callable_services
    except ImportError as error:
        raise ConfigError(
            f'call needs rclpy ({error}): pip install "ogm_mcmc[ros]", or source a ROS 2 setup'
        ) from error
    if options.service is None:
        services = callable_services(options.timeout)
        lines = [f'{name}  ({kind})' for name, kind in services.items()]
        print_result(options, {'services': services}, '\n'.join(lines) or 'no service')
        return 0
    message = call_service(options.service, DATA.get(options.value), options.timeout)
    print_result(options, {'message': message}, message)
    return 0
