"""Start and stop of a node process: quiet on Ctrl-C and SIGTERM, one line on a user's mistake."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from ogm_mcmc.errors import ConfigError, OgmError

__all__ = ['ros_args_explained', 'run_node']


@contextlib.contextmanager
def ros_args_explained() -> Iterator[None]:
    """Turn what rcl says of a wrong --ros-args into a ConfigError of one line."""
    try:
        yield
    except (RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        reason = ' '.join(str(error).split()) or 'not accepted'
        raise ConfigError(f'ROS cannot start with these arguments: {reason}') from error


def run_node(
    make: Callable[[], Node], spin: Callable[[Node], None], args: list[str] | None
) -> int:
    """Make a node, spin it, clean up; return the exit code (2: a user's mistake)."""
    try:
        with ros_args_explained():
            rclpy.init(args=args)
    except ConfigError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    node: Node | None = None
    try:
        node = make()
        spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RCLError:
        # Told to stop while still starting: the context goes before the node is complete.
        if rclpy.ok():
            raise
    except OgmError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
