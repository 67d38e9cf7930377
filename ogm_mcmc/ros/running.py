"""Start and stop of a node process: quiet on Ctrl-C and SIGTERM, one line on a user's mistake."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Any, Self

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ogm_mcmc.errors import ConfigError, OgmError

__all__ = ['StopSignal', 'ros_args_explained', 'run_node']

LOOK_EVERY_S = 0.1


class StopSignal:
    """SIGINT and SIGTERM, noted instead of ending ROS: a node can still say its last word.

    Pass `signals=SignalHandlerOptions.NO` to `run_node`, and `spin`, which calls the node's
    `finish()` while it can still publish. Before that a signal raises KeyboardInterrupt.
    """

    def __init__(self) -> None:
        self.asked = False
        self._spinning = False

    def __enter__(self) -> Self:
        """Install the handlers."""
        self._before = [
            (number, signal.signal(number, self._note))
            for number in (signal.SIGINT, signal.SIGTERM)
        ]
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put back what was there."""
        for number, handler in self._before:
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        first, self.asked = not self.asked, True
        if first and not self._spinning:
            raise KeyboardInterrupt

    def spin(self, node: Any) -> None:
        """Handle messages until a signal comes, then let the node finish."""
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        self._spinning = True
        try:
            while not self.asked and node.context.ok():
                executor.spin_once(timeout_sec=LOOK_EVERY_S)
            node.finish()
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
    spin: Callable[[Node], None],
    args: list[str] | None,
    signals: SignalHandlerOptions = SignalHandlerOptions.ALL,
) -> int:
    """Make a node, spin it, clean up; return the exit code (2: a user's mistake)."""
    try:
        with ros_args_explained():
            rclpy.init(args=args, signal_handler_options=signals)
    except ConfigError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
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
