"""Which process of which host something hidden belongs to, and whether that one still lives."""

from __future__ import annotations

import os
import platform
import re

__all__ = ['host_name', 'lives']


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
