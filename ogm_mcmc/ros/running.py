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
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ogm_mcmc.errors import ConfigError, OgmError

__all__ = ['StopSignal', 'ros_args_explained', 'run_node']

LOOK_EVERY_S = 0.1


class StopSignal:
    """SIGINT and SIGTERM, noted instead of ending ROS: a node can still say its last word.

    An exception in the middle of a call into ROS may come out as another one, or not at all. So a
    signal raises KeyboardInterrupt only before `spin`, and where C code is calling back then and
    it cannot be raised (a kernel is compiled), `spin` ends at once.
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
        self._hook_before, sys.unraisablehook = sys.unraisablehook, self._unraisable
        return self

    def _unraisable(self, unraisable: Any) -> None:
        if unraisable.exc_type is not KeyboardInterrupt:
            self._hook_before(unraisable)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put back what was there."""
        for number, handler in self._before:
            signal.signal(number, handler)
        sys.unraisablehook = self._hook_before

    def _note(self, number: int, frame: FrameType | None) -> None:
        first, self.asked = not self.asked, True
        if first and not self._spinning:
            raise KeyboardInterrupt

    def spin(self, node: Any, going: Callable[[], bool] = lambda: True) -> None:
        """Handle messages while a condition holds and no signal comes.

        Then let the node `finish()`, if it has such a method, while it can still publish.
        """
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        self._spinning = True
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
            print(f'error: {error}', file=sys.stderr)
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
            print(f'error: {error}', file=sys.stderr)
            return 2
        finally:
            if node is not None:
                node.destroy_node()
            rclpy.try_shutdown()
    return 0
