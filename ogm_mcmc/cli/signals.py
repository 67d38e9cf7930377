"""Ctrl-C and a polite kill: leave through every `with`, from wherever the program is.

Two places cannot bear an exception. In a callback from C it is printed and lost. And Numba, when
it takes a numpy Generator apart for a kernel, calls `ctypes.cast` and uses what comes back
without a look: an exception in there is a crash of the process. In both the signal is sent to
ourselves again, a little later.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from types import CodeType, FrameType
from typing import Any

__all__ = ['leave_on_signals', 'stop_a_little_later']

AGAIN_S = 0.05

UNSAFE = ctypes.cast.__code__


def leave_on_signals() -> None:
    """Let SIGINT raise KeyboardInterrupt and SIGTERM exit with 143; for the main thread only.

    A SIGINT that is ignored or handled by somebody else is left alone.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    signal.signal(signal.SIGTERM, _leave)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def _leave(number: int, frame: FrameType | None) -> None:
    if _inside(UNSAFE, frame):
        _again(number)
    elif number == signal.SIGTERM:
        sys.exit(143)
    else:
        raise KeyboardInterrupt


def _inside(code: CodeType, frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code is code:
            return True
        frame = frame.f_back
    return False


def stop_a_little_later(unraisable: Any) -> None:
    """Send the signal again whose exception could not be raised; a `sys.unraisablehook`."""
    signals = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}
    again = signals.get(unraisable.exc_type)
    if again is None:
        sys.__unraisablehook__(unraisable)
    else:
        _again(again)


def _again(number: int) -> None:
    threading.Timer(AGAIN_S, os.kill, (os.getpid(), number)).start()
