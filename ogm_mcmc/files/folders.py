"""Put a folder in the place of another one: a reader finds the old one or the new one, whole.

Linux can exchange two names at once (renameat2). Where a file system cannot, the old folder
waits beside its place, under a hidden name with host and process in it, for the moment between
two renames; if the process is killed in it, the next one that writes there puts the old folder
back first. Nobody touches what a living process, or a process of another host, has put there.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import shutil
from pathlib import Path

from ogm_mcmc.files.processes import host_name, lives

__all__ = ['put_back', 'replace_folder', 'write_all_through', 'write_through']

AT_FDCWD = -100  # names are not relative to an open folder
RENAME_EXCHANGE = 2


def replace_folder(new: Path, path: Path) -> None:
    """Move a folder to a path; one that is there goes when the new one is in its place.

    All files of the new one are written through to the disk first. Raises OSError; then the old
    folder is where it was.
    """
    write_all_through(new)
    if not path.exists():
        new.replace(path)
    elif _exchanged(new, path):
        shutil.rmtree(new, ignore_errors=True)
        _remove_aside(path)
    else:
        aside = path.with_name(f'{_aside()}{os.getpid()}-{path.name}')
        path.replace(aside)
        try:
            new.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):  # another process has put its own there
                aside.replace(path)
            raise
        shutil.rmtree(aside, ignore_errors=True)
        _remove_aside(path)
    write_through(path.parent)


def put_back(path: Path) -> None:
    """Put a folder back that a process was about to replace when it was killed.

    Only where nothing is in its place. Raises OSError.
    """
    if path.parent.is_dir() and not os.path.lexists(path):
        for aside in _left_aside(path)[:1]:
            aside.replace(path)


def _remove_aside(path: Path) -> None:
    """Remove the folders of killed processes that this path has had before."""
    for aside in _left_aside(path):
        shutil.rmtree(aside, ignore_errors=True)


def _left_aside(path: Path) -> list[Path]:
    """Return the folders put aside for a path by processes of this host that are no more."""
    pattern = re.compile(re.escape(_aside()) + '([0-9]+)-' + re.escape(path.name))
    found = ((pattern.fullmatch(name), name) for name in sorted(os.listdir(path.parent)))
    return [path.with_name(name) for match, name in found if match and not lives(int(match[1]))]


def _aside() -> str:
    return f'.ogm_mcmc_old-{host_name()}-'


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two names at once; return False where system or file system cannot."""
    exchange = getattr(ctypes.CDLL(None), 'renameat2', None)
    if exchange is None:
        return False
    names = (os.fsencode(one), os.fsencode(other))
    failed = exchange(AT_FDCWD, names[0], AT_FDCWD, names[1], ctypes.c_uint(RENAME_EXCHANGE))
    return bool(failed == 0)


def write_through(path: Path) -> None:
    """Have a file or folder written to the disk itself, so that a power cut finds it there."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    except OSError:
        if not path.is_dir():  # some file systems cannot do it for folders
            raise
    finally:
        os.close(handle)


def write_all_through(folder: Path) -> None:
    """Have a folder and all that is in it written to the disk itself."""
    for one in sorted(folder.rglob('*')):
        write_through(one)
    write_through(folder)
