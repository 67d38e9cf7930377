"""Work for processes of their own, which can only call what a package holds."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

__all__ = ['square']


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
