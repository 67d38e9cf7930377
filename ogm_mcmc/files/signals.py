"""Ctrl-C and a polite kill (SIGINT, SIGTERM): all ways in which the package takes them.

Commands leave through every `with` (`leave_on_signals`), sampling ends early (`interruptible`),
short critical work goes first (`signals_later`), what is done or not begun ends at once
(`end_at_once_on_signals`), nodes finish what they do (`NotedSignals`), and
children that this process ends by itself hear nothing of Ctrl-C (`starting_children`).

Two places cannot bear an exception. In a callback from C it is printed and lost. And Numba, when
it takes a numpy Generator apart for a kernel, calls `ctypes.cast` and uses what comes back
without a look: an exception in there is a crash of the process. In both, and where LLVM asks for
the code of a kernel, the signal is sent to ourselves again, a little later.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, Self

__all__ = [
    'NotedSignals',
    'end_at_once_on_signals',
    'interruptible',
    'leave_on_signals',
    'signals_later',
    'starting_children',
    'stop_a_little_later',
]

AGAIN_S = 0.05

UNSAFE = ctypes.cast.__code__

# By name, as llvmlite is not imported here. LLVM asks in them for the code of a kernel, or hands
# it over, and goes on with whatever was written by then.
CALLBACKS = ('_raw_object_cache_getbuffer', '_raw_object_cache_notify')

_leaving = threading.Event()


def leave_on_signals() -> None:
    """Let SIGINT raise KeyboardInterrupt and SIGTERM exit with 143; for the main thread only.

    A SIGINT that is ignored or handled by somebody else is left alone.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    signal.signal(signal.SIGTERM, _leave)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def end_at_once_on_signals(code: int) -> None:
    """Let SIGINT and SIGTERM end the process with a code: there is nothing to clean up.

    While Python takes itself down nobody catches an exception: it would be printed. A signal that
    is ignored, as under nohup, stays so; one that is not handled by Python is left alone.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for stream in filter(None, (sys.stdout, sys.stderr)):  # None: closed before the start
        with contextlib.suppress(OSError, ValueError):  # nobody reads it any more
            stream.flush()
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, lambda *_: os._exit(code))


def _leave(number: int, frame: FrameType | None) -> None:
    if _unsafe(frame):
        _again(number)
        return
    _leaving.set()
    if number == signal.SIGTERM:
        sys.exit(143)
    else:
        raise KeyboardInterrupt


def _unsafe(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code is UNSAFE or frame.f_code.co_name in CALLBACKS:
            return True
        frame = frame.f_back
    return False


def stop_a_little_later(unraisable: Any) -> None:
    """Send the signal again whose exception could not be raised; a `sys.unraisablehook`.

    Once a signal was answered, what was half made by then may fail when it is taken down: that
    is not told.
    """
    signals = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}
    again = signals.get(unraisable.exc_type)
    if again is not None:
        _again(again)
    elif not _leaving.is_set():
        sys.__unraisablehook__(unraisable)


def _again(number: int) -> None:
    threading.Timer(AGAIN_S, os.kill, (os.getpid(), number)).start()


@contextlib.contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Yield an event that the first SIGINT or SIGTERM sets; the second one interrupts as ever."""
    interrupted = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield interrupted
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def stop(_number: int, _frame: FrameType | None) -> None:
        interrupted.set()
        restore()

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    for number in before:
        signal.signal(number, stop)
    try:
        yield interrupted
    finally:
        restore()


@contextlib.contextmanager
def signals_later() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the end of this; outside of the main thread, nothing.

    A signal that Python does not handle is left alone, since what handles it (rclpy, by its
    default, in C) could not be put back.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    waiting = True
    handlers = {int(one): signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    before = {one: handler for one, handler in handlers.items() if callable(handler)}

    def note(number: int, frame: FrameType | None) -> None:
        # One that comes while handlers are put back may leave the other one where it is.
        if waiting:
            came.append(number)
        else:
            before[number](number, frame)

    try:
        for number in before:
            signal.signal(number, note)
        yield
    finally:
        waiting = False
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


@contextlib.contextmanager
def starting_children() -> Iterator[None]:
    """Start processes that hear nothing of SIGINT; for this one signals wait meanwhile.

    A terminal sends it to them, too, and while they import modules they would complain aloud. A
    process has blocked what the thread that starts it has. Half a start would leave one that
    nobody knows of.
    """
    from multiprocessing import resource_tracker

    with signals_later():
        resource_tracker.ensure_running()  # unblocks SIGINT where the first child starts it
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


class NotedSignals:
    """SIGINT and SIGTERM are noted in `asked`; while not `patient`, the first one interrupts.

    An exception in the middle of a call from C may come out as another one, or not at all. Where
    KeyboardInterrupt cannot be raised (a kernel is being compiled), `asked` says it all the same.
    """

    def __init__(self) -> None:
        self.asked = False
        self.patient = False

    def __enter__(self) -> Self:
        """Install the handlers."""
        self._before = [
            (number, signal.signal(number, self._note))
            for number in (signal.SIGINT, signal.SIGTERM)
        ]
        self._hook_before, sys.unraisablehook = sys.unraisablehook, self._unraisable
        return self

    def _unraisable(self, unraisable: Any) -> None:
        # What was half made when a signal came may fail when it is taken down.
        if unraisable.exc_type is not KeyboardInterrupt and not self.asked:
            self._hook_before(unraisable)

    def __exit__(self, *_: object) -> None:
        """Put back what was there."""
        for number, handler in self._before:
            signal.signal(number, handler)
        sys.unraisablehook = self._hook_before

    def _note(self, number: int, frame: FrameType | None) -> None:
        first, self.asked = not self.asked, True
        if first and not self.patient and not _unsafe(frame):
            raise KeyboardInterrupt
