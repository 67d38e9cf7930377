"""Start and stop of a node process: quiet on Ctrl-C and SIGTERM, one line on a user's mistake."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from ogm_mcmc.errors import OgmError

__all__ = ['run_node']


def run_node(
    make: Callable[[], Node], spin: Callable[[Node], None], args: list[str] | None
) -> int:
    """Make a node, spin it, clean up; return the exit code (2: a user's mistake)."""
    try:
        rclpy.init(args=args)
    except (RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        # A parameter file that is missing, say. What rcl adds below its first line is for it.
        reason = str(error).strip().splitlines()[0] if str(error).strip() else 'not accepted'
        print(f'error: --ros-args: {reason}', file=sys.stderr)
        return 2
    node: Node | None = None
    try:
        node = make()
        spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except OgmError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
