"""Lines for people on standard error: the door of all commands and nodes."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator

from tqdm import tqdm

__all__ = ['said_if_slow', 'said_if_stopped', 'say']

SLOW_S = 3.0


def say(line: str) -> None:
    """Print a line for people beside whatever bar there is; one that is lost costs no work."""
    with contextlib.suppress(OSError):
        tqdm.write(line, file=sys.stderr)
        sys.stderr.flush()


@contextlib.contextmanager
def said_if_slow(line: str, after_s: float = SLOW_S) -> Iterator[None]:
    """Print a line where the block takes longer than so many seconds: nobody waits in the dark."""
    timer = threading.Timer(after_s, say, [line])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextlib.contextmanager
def said_if_stopped(line: str) -> Iterator[None]:
    """Print a line where Ctrl-C or SIGTERM ends the block, and let them go on."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        say(line)
        raise
