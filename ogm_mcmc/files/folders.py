"""Put a folder in the place of another one: a reader finds the old one or the new one, whole.

Linux can exchange two names at once (renameat2). Where a file system cannot, the old folder
waits beside its place, under a hidden name, for the moment between two renames; if the process
is killed in it, the next one that writes there puts the old folder back first.
"""

from __future__ import annotations

import ctypes
import os
import shutil
from pathlib import Path

from ogm_mcmc.files.output_files import write_through

__all__ = ['put_back', 'replace_folder']

AT_FDCWD = -100  # names are not relative to an open folder
RENAME_EXCHANGE = 2


def replace_folder(new: Path, path: Path) -> None:
    """Move a folder to a path; one that is there goes when the new one is in its place.

    All files of the new one are written through to the disk first. Raises OSError; then the old
    folder is where it was.
    """
    for one in sorted(new.rglob('*')):
        write_through(one)
    write_through(new)
    if not path.exists():
        new.replace(path)
    elif _exchanged(new, path):
        shutil.rmtree(new, ignore_errors=True)
    else:
        aside = _aside(path)
        path.replace(aside)
        try:
            new.replace(path)
        except BaseException:
            aside.replace(path)
            raise
        shutil.rmtree(aside, ignore_errors=True)
    write_through(path.parent)


def put_back(path: Path) -> None:
    """Put a folder back that a process was about to replace when it was killed; raises OSError."""
    aside = _aside(path)
    if not aside.exists():
        return
    if path.exists():  # killed later: the new one is in its place
        shutil.rmtree(aside, ignore_errors=True)
    else:
        aside.replace(path)


def _aside(path: Path) -> Path:
    return path.with_name(f'.{path.name}-before')


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two names at once; return False where system or file system cannot."""
    exchange = getattr(ctypes.CDLL(None), 'renameat2', None)
    if exchange is None:
        return False
    names = (os.fsencode(one), os.fsencode(other))
    failed = exchange(AT_FDCWD, names[0], AT_FDCWD, names[1], ctypes.c_uint(RENAME_EXCHANGE))
    return bool(failed == 0)
