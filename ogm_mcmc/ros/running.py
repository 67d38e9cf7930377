"""Start and stop of a node process: quiet on Ctrl-C and SIGTERM, one line on a user's mistake."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ogm_mcmc.errors import ConfigError, OgmError
from ogm_mcmc.files.saying import say
from ogm_mcmc.files.signals import NotedSignals

__all__ = ['StopSignal', 'ros_args_explained', 'run_node']

LOOK_EVERY_S = 0.1


class StopSignal(NotedSignals):
    """Signals are noted instead of ending ROS: a node can still say its last word.

    Before `spin` a signal raises KeyboardInterrupt. While spinning, or if it came where it cannot
    be raised, `spin` ends at once.
    """

    def spin(self, node: Any, going: Callable[[], bool] = lambda: True) -> None:
        """Handle messages while a condition holds and no signal comes.

        Then let the node `finish()`, if it has such a method, while it can still publish.
        """
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        self.patient = True
        try:
            while not self.asked and going() and node.context.ok():
                executor.spin_once(timeout_sec=LOOK_EVERY_S)
            getattr(node, 'finish', lambda: None)()
        finally:
            executor.shutdown()


@contextlib.contextmanager
def ros_args_explained() -> Iterator[None]:
    """Turn what rcl says of a wrong --ros-args into a ConfigError of one line."""
    try:
        yield
    except (RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        reason = ' '.join(str(error).split()) or 'not accepted'
        raise ConfigError(f'ROS cannot start with these arguments: {reason}') from error


def run_node(
    make: Callable[[], Node],
    args: list[str] | None,
    spin: Callable[[Any, StopSignal], None] = lambda node, told: told.spin(node),
) -> int:
    """Make a node, spin it, clean up; return the exit code (2: a user's mistake)."""
    with StopSignal() as told:
        try:
            with ros_args_explained():
                rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except ConfigError as error:
            say(f'error: {error}')
            return 2
        except KeyboardInterrupt:
            return 0
        node: Node | None = None
        try:
            node = make()
            spin(node, told)
        except KeyboardInterrupt:
            pass
        except OgmError as error:
            say(f'error: {error}')
            return 2
        finally:
            if node is not None:
                node.destroy_node()
            else:
                gc.collect()  # half made it is in cycles, and seen for 20 s after `entry.leave`
            rclpy.try_shutdown()
    return 0
