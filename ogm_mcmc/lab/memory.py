"""What memory a process takes, as Linux tells it."""

from __future__ import annotations

import contextlib
import ctypes
from pathlib import Path

__all__ = ['PROC', 'give_back_free_memory', 'memory_mb', 'peak_mb']

PROC = Path('/proc/self')

# What Linux calls kB has 1024 bytes.
KB, MB = 1024, 1e6


def memory_mb(name: str) -> float | None:
    """Return a figure of this process, MB of a million bytes; None where it is not known.

    `name`: `VmRSS`, what is resident now; `VmHWM`, the most that ever was. Not `ru_maxrss`: that
    of a child process begins with what its parent had.
    """
    try:
        lines = (PROC / 'status').read_text(encoding='ascii').splitlines()
    except OSError:
        return None
    found = (line.split()[1] for line in lines if line.startswith(f'{name}:'))
    kb = next(found, None)
    return None if kb is None else int(kb) * KB / MB


def peak_mb() -> float | None:
    """Return the most memory that this process has had, MB, None where that is not known."""
    most = memory_mb('VmHWM')
    return None if most is None else round(most, 1)


def give_back_free_memory() -> None:
    """Let malloc keep nothing that is free: what came from there next would not be seen."""
    with contextlib.suppress(OSError, AttributeError):  # only glibc has it
        ctypes.CDLL(None).malloc_trim(0)
