"""The text a user gave, as a path, or one line that says why it is none."""

from __future__ import annotations

import os
from pathlib import Path

from ogm_mcmc.errors import OgmError, OutputError

__all__ = ['possible_path', 'user_path']

# What Linux takes; other file systems take less and say so themselves.
LONGEST_NAME, LONGEST_PATH = 255, 4095


def user_path(
    text: str | os.PathLike[str], what: str = 'path', error: type[OgmError] = OutputError
) -> Path:
    """Return the path a text means, `~` and `~user` filled in.

    what   how the message names it: `save_directory`, `--prior-file`
    Raises `error` for what no file can be called: nothing at all, a NUL byte, an unknown user,
    bytes that are no text, a name longer than a file system takes.
    """
    given = os.fspath(text)
    if not given:
        raise error(f'{what} is empty: expected a path')
    try:
        path = Path(given).expanduser()
    except RuntimeError as reason:
        raise error(f'{what} is {given!r}: expected a path ({reason})') from reason
    return possible_path(path, what, error)


def possible_path(path: Path, what: str = 'path', error: type[OgmError] = OutputError) -> Path:
    """Return a path as it is; raises `error`, as `user_path` does, for what no file can be."""
    given = str(path)
    if '\0' in given:
        raise error(f'{what} is {given!r}: expected a path without NUL bytes')
    try:
        encoded = os.fsencode(path)
    except UnicodeError as reason:
        raise error(f'{what} is {given!r}: expected a path ({reason})') from reason
    longest = max(map(len, encoded.split(b'/')))
    if longest > LONGEST_NAME or len(encoded) > LONGEST_PATH:
        raise error(
            f'{what} is {given[:60]!r}...: expected names of at most {LONGEST_NAME} bytes and '
            f'{LONGEST_PATH} in all, not {longest} and {len(encoded)}'
        )
    return path
