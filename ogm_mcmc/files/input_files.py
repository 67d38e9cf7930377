"""Open a file to read it, if it is one: a pipe or a device would hang or never end."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

__all__ = ['file_to_read', 'reason_of', 'text_of']

# Bytes: more than an hour of poses a millisecond apart.
LARGEST_TEXT = 500_000_000


@contextlib.contextmanager
def file_to_read(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file, links followed. Raises OSError or ValueError, whatever it is."""
    # Without O_NONBLOCK, opening a pipe waits for somebody who writes to it.
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, 'O_NONBLOCK', 0))
    with open(handle, 'rb') as stream:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ValueError('a folder, pipe or device: expected a regular file')
        yield stream


def text_of(path: Path, encoding: str = 'utf-8-sig', most: int = LARGEST_TEXT) -> str:
    """Return what a regular file of at most so many bytes says; raises OSError or ValueError."""
    with file_to_read(path) as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise ValueError(f'it is too large: expected at most {most} bytes')
    return content.decode(encoding)


def reason_of(error: BaseException) -> str:
    """Return in one line what an exception says, without the path it repeats."""
    said = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return ' '.join(str(said).split())[:300]
