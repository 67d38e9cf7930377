"""Work for processes of their own, which can only call what a package holds."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ['dying_once', 'square', 'whereabouts']


def square(value: int, folder: str, seconds: float = 0.0, dies: bool = False) -> dict[str, Any]:
    """Square a number, slowly, and leave a file for every call; or die like a killed process.

    A process that is to die does so only the first time.
    """
    calls = list(Path(folder).glob(f'{value}-*'))
    (Path(folder) / f'{value}-{len(calls)}').touch()
    if dies and not calls:
        os._exit(9)
    time.sleep(seconds)
    return {'value': value, 'square': value**2}


def dying_once(marker: str, work: Callable[..., Any], *arguments: Any) -> Any:
    """Do the work; the first time be killed before the answer is out."""
    result = work(*arguments)
    if not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return result


def whereabouts(number: int) -> dict[str, Any]:
    """Return the process this runs in."""
    return {'number': number, 'process': os.getpid()}
