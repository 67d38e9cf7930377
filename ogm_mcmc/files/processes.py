"""Which process of which host something belongs to, and whether that one still lives."""

from __future__ import annotations

import math
import os
import platform
import re
import signal
import threading
import time
from pathlib import Path

__all__ = ['end_with_parent', 'ending_with_this', 'free_memory', 'host_name', 'lives']

# In the environment of a process: the parent without which it shall end.
PARENT = 'OGM_MCMC_PARENT'
PARENT_LOOK_S = 0.5
PATIENCE_S = 10.0  # after SIGTERM

MEMORY, AVAILABLE = Path('/proc/meminfo'), 'MemAvailable:'


def host_name() -> str:
    """Return the name of this host as part of a file name: letters, digits and `_`."""
    return re.sub('[^A-Za-z0-9]', '_', platform.node())[:60]


def lives(pid: int) -> bool:
    """Whether a process of this host is there, whoever owns it."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # somebody else's
        return True
    return True


def free_memory() -> float:
    """Return how many bytes of memory new work may have, as Linux tells it; inf: not known."""
    try:
        lines = MEMORY.read_text(encoding='ascii').splitlines()
        return next(1024.0 * int(one.split()[1]) for one in lines if one.startswith(AVAILABLE))
    except (OSError, ValueError, IndexError, StopIteration):
        return math.inf


def ending_with_this() -> dict[str, str]:
    """Return the environment of a child that ends with this process: see `end_with_parent`."""
    return {**os.environ, PARENT: str(os.getpid())}


def end_with_parent() -> None:
    """Let this process end, by SIGTERM, soon after a parent that asked for it has gone.

    A parent that was killed cannot end its children itself. Without such a parent nothing happens.
    """
    parent = os.environ.pop(PARENT, '')
    if parent:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: str) -> None:
    while str(os.getppid()) == parent:
        time.sleep(PARENT_LOOK_S)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE_S)
    os._exit(1)
