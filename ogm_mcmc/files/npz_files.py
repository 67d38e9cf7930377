"""Arrays from an NPZ whose names, types and sizes are known: the header is looked at first.

`numpy.load` allocates what a header claims, and lets through whatever zip, zlib and its header
parser raise. Here a member is refused by its header unless it is one of those expected, of the
expected type and shape, within a bound on its bytes, and as long as it says. Pickles are refused.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from numpy.lib import format as npy

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.errors import OgmError
from ogm_mcmc.files.input_files import file_to_read, reason_of

__all__ = ['NUMBER', 'TEXT', 'Field', 'NpzFile', 'npz_file']

MOST_BYTES = 1 << 33
MOST_TEXT = 1 << 22
MOST_HEADER = 4096
KINDS = {'f': 'float', 'i': 'integer', 'u': 'unsigned', 'b': 'boolean', 'U': 'text'}


class Field(NamedTuple):
    """What an array has to be.

    kinds  of NumPy's dtype, one letter each: `f`, `iu`, `U` (text)
    shape  its sides, None for any length; no shape at all: anything
    """

    kinds: str
    shape: tuple[int | None, ...] | None = ()

    def __str__(self) -> str:
        """Return it as a message has it: float or integer (2, any)."""
        kinds = ' or '.join(KINDS[letter] for letter in self.kinds)
        if self.shape is None:
            return kinds
        return f'{kinds} ({", ".join("any" if n is None else str(n) for n in self.shape)})'


NUMBER = Field('fiu')
TEXT = Field('U')


class NpzFile:
    """An NPZ that is open; arrays are read one by one."""

    def __init__(self, archive: zipfile.ZipFile, most_bytes: int) -> None:
        self.names = frozenset(
            name.removesuffix('.npy') for name in archive.namelist() if name.endswith('.npy')
        )
        self._archive = archive
        self._left = most_bytes

    def read(self, name: str, field: Field) -> AnyArray:
        """Return an array. Raises ValueError, naming it, unless it is as expected."""
        if name not in self.names:
            raise ValueError(f'no field {name}')
        info = self._archive.getinfo(f'{name}.npy')
        with self._archive.open(info) as stream:
            head = io.BytesIO()
            shape, fortran, dtype = _header(_Recorded(stream, head))
            fits = field.shape is None or (
                len(shape) == len(field.shape)
                and all(n in (None, m) for n, m in zip(field.shape, shape, strict=True))
            )
            if dtype.hasobject or dtype.kind not in field.kinds or not fits:
                raise ValueError(f'{name} is {dtype} {shape}: expected {field}')
            n_bytes = math.prod(shape) * dtype.itemsize
            most = min(self._left, MOST_TEXT) if dtype.kind == 'U' else self._left
            if n_bytes > most:
                raise ValueError(f'{name} takes {n_bytes} bytes: expected at most {most}')
            if info.file_size != head.tell() + n_bytes:
                raise ValueError(f'{name} has {info.file_size} bytes: expected another number')
            self._left -= n_bytes
            array: AnyArray = np.empty(math.prod(shape), dtype)
            if n_bytes:
                _fill(stream, array.view(np.uint8).data)
            if stream.read(1):  # the end is where the checksum is looked at
                raise ValueError(f'{name} goes on behind its end')
        if dtype.kind == 'U' and n_bytes and array.view(np.uint32).max(initial=0) > 0x10FFFF:
            raise ValueError(f'{name}: expected text')
        array = array.reshape(shape, order='F' if fortran else 'C')
        return np.ascontiguousarray(array.astype(dtype.newbyteorder('='), copy=False)).reshape(
            shape
        )


class _Recorded:
    """A stream that notes what was read."""

    def __init__(self, stream: IO[bytes], note: io.BytesIO) -> None:
        self._stream, self._note = stream, note

    def read(self, size: int) -> bytes:
        content: bytes = self._stream.read(min(size, MOST_HEADER))
        self._note.write(content)
        if self._note.tell() > MOST_HEADER:
            raise ValueError(f'header of more than {MOST_HEADER} bytes')
        return content


def _header(stream: _Recorded) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)  # type: ignore[arg-type]
    if version not in readers:
        raise ValueError(f'version {version} of the format: expected one of {list(readers)}')
    shape, fortran, dtype = readers[version](stream, max_header_size=MOST_HEADER)  # type: ignore[arg-type]
    if any(side < 0 for side in shape):
        raise ValueError(f'shape {shape}')
    return shape, fortran, dtype


def _fill(stream: IO[bytes], into: memoryview) -> None:
    done = 0
    while done < len(into):
        count = stream.readinto(into[done : done + (1 << 20)])  # type: ignore[attr-defined]
        if not count:
            raise EOFError('ends too early')
        done += count


@contextmanager
def npz_file(
    path: Path, what: str, error: type[OgmError], most_bytes: int = MOST_BYTES
) -> Iterator[NpzFile]:
    """Open an NPZ; any error inside the block becomes one line about the file.

    what   how the message names it: `an NPZ with samples`; most_bytes: of all arrays that are read
    Raises `error`: '<path>: expected <what> (<reason>)'.
    """
    try:
        with file_to_read(path) as stream, zipfile.ZipFile(stream) as archive:
            yield NpzFile(archive, most_bytes)
    except OgmError:
        raise
    except Exception as reason:  # a damaged archive fails in more ways than can be listed
        raise error(f'{path}: expected {what} ({reason_of(reason)})') from reason
