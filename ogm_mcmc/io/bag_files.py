"""Which files a bag consists of, what they are, and how a broken one is mended.

A storage file is known by its first bytes, so names, suffixes and most of `metadata.yaml` need
not be right: of a rosbag2 folder only the list of its files is used.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from ogm_mcmc.errors import BagError
from ogm_mcmc.files.input_files import file_to_read, text_of

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = [
    'is_recording',
    'kind_of',
    'mending',
    'plain_yaml',
    'storage_files',
    'stored_note',
    'unmerged',
    'unpack_file',
    'unpacked',
]

MAGIC = {
    b'\x89MCAP0\r\n': 'mcap',
    b'SQLite format 3\0': 'sqlite3',
    b'#ROSBAG V': 'ros1',
    b'\x28\xb5\x2f\xfd': 'zstd',
}
# gzip, bzip2, zip, xz, 7z: what people pack recordings with.
PACKED = (b'\x1f\x8b', b'BZh', b'PK\x03\x04', b'\xfd7zXZ', b'7z\xbc\xaf')
LOG = 'it is a text: of a CARMEN log `import-carmen` makes a bag'
SUFFIXES = ('.mcap', '.db3', '.bag', '.zstd')

# Real metadata of thousands of files and topics stays far below.
LARGEST_YAML = 8_000_000

# Bytes of a message unpacked; a camera's picture has some ten millions.
LARGEST_MESSAGE = 200_000_000

Loader: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def kind_of(path: Path) -> str:
    """Return mcap, sqlite3, ros1 or zstd, from the first bytes. Raises BagError for all else."""
    try:
        with file_to_read(path) as file:
            start = file.read(16)
    except ValueError as error:
        raise BagError(f'{path}: {error}') from error
    for magic, kind in MAGIC.items():
        if start.startswith(magic):
            return kind
    what = 'it is empty' if not start else 'its first bytes are of none of them'
    if start.startswith(PACKED):
        what = 'it is a packed archive, to be unpacked first'
        if path.name.endswith('.log.gz'):
            what = LOG
    elif start.strip() and start.isascii() and start.split()[0].decode().isprintable():
        what = LOG
    if path.name == 'metadata.yaml':
        raise BagError(f'{path}: expected the folder that it is in, {path.parent}')
    raise BagError(f'{path}: {what}: expected an mcap, sqlite3 or ROS 1 recording')


def is_recording(path: Path) -> bool:
    """Tell whether a file begins as a recording does, whatever it is called."""
    try:
        kind_of(path)
    except (BagError, OSError):
        return False
    return True


def unpacked(raw: bytes) -> bytes:
    """Return a stored rosbag2 message, decompressed if it was compressed one by one."""
    # No serialized message begins like this: CDR starts with 0, 0 to 11.
    if not raw.startswith(b'\x28\xb5\x2f\xfd'):
        return raw
    reader = zstd.ZstdDecompressor()
    message: bytes = reader.decompress(raw, LARGEST_MESSAGE)
    if not reader.eof:
        raise BagError(f'a message is cut off, or more than {LARGEST_MESSAGE} bytes unpacked')
    return message


def unpack_file(path: Path, folder: Path) -> Path:
    """Decompress a storage file into a folder; return the new file."""
    plain = folder / path.stem
    with zstd.open(path, 'rb') as packed, plain.open('wb') as file:
        shutil.copyfileobj(packed, file)
    return plain


def plain_yaml(text: str) -> Any:
    """Return what a text of plain YAML says. Raises ValueError when it is none.

    Aliases are refused: no recorder writes them, and a few bytes of them grow without end.
    """
    if len(text) > LARGEST_YAML:
        raise ValueError(f'{len(text)} characters: expected at most {LARGEST_YAML}')
    try:
        if '*' in text and any(
            isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=Loader)
        ):
            raise ValueError('a YAML alias: expected plain values')
        return yaml.load(text, Loader=Loader)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f'no YAML: {" ".join(str(error).split())}') from error


def storage_files(path: Path) -> list[Path]:
    """Return the storage files of a bag: the file itself, or those of a rosbag2 folder.

    In a folder without `metadata.yaml`, or whose only file has been renamed, it is the only
    storage file there. Raises BagError that names the files that can be given themselves.
    """
    if not path.is_dir():
        return [path]
    there = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES and file.is_file())
    metadata = path / 'metadata.yaml'
    if not metadata.is_file():
        if len(there) == 1:
            return there
        what = 'no metadata.yaml in it' + ('' if there else ' and no storage file')
        raise BagError(
            f'{path}: {what}: expected a rosbag2 folder'
            + (f'; try `ros2 bag reindex {path}`, or give {_either(there)}' if there else '')
        )
    listed = _listed(metadata, there)
    missing = [file for file in listed if not file.is_file()]
    if not missing:
        return listed
    if len(listed) == len(there) == 1:
        return there
    names = ', '.join(file.name for file in missing)
    raise BagError(
        f'{path}: metadata.yaml names {names}, not in the folder: expected all storage files'
        + (f'; there is {_either(there)}' if there else '')
    )


def stored_note(path: Path, key: str) -> str:
    """Return a remark kept in the metadata of a rosbag2 folder; '' where there is none."""
    try:
        text = text_of(path / 'metadata.yaml', 'utf-8', LARGEST_YAML)
        kept = plain_yaml(text)['rosbag2_bagfile_information']['custom_data']
        return str(kept.get(key, ''))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return ''


def _listed(metadata: Path, there: list[Path]) -> list[Path]:
    instead = f'; give {_either(there)}' if there else ''
    try:
        if metadata.stat().st_size > LARGEST_YAML:
            raise ValueError(f'{metadata.stat().st_size} bytes: at most {LARGEST_YAML}')
        # A recording of the same names from another place: only the names of files count.
        names = plain_yaml(text_of(metadata, 'utf-8', LARGEST_YAML))[
            'rosbag2_bagfile_information'
        ]['relative_file_paths']
        if not names or not isinstance(names, list):
            raise ValueError('relative_file_paths names no file')
        return [metadata.parent / PurePosixPath(str(name)).name for name in names]
    except (ValueError, KeyError, TypeError, OSError) as error:
        reason = f'no {error}' if isinstance(error, KeyError) else ' '.join(str(error).split())
        raise BagError(
            f'{metadata}: expected the metadata of a rosbag2 ({reason}){instead}'
        ) from (error)


def _either(files: list[Path]) -> str:
    shown = [str(file) for file in files[:5]]
    return ' or '.join(shown) + (f' or one of {len(files) - 5} more' if len(files) > 5 else '')


def mending(path: Path, kind: str) -> str:
    """Return why a storage file cannot be read and how it is mended; '' if it was closed."""
    if kind == 'mcap' and path.stat().st_size >= 8:
        with path.open('rb') as file:
            file.seek(-8, 2)
            closed = file.read() == b'\x89MCAP0\r\n'
        if not closed:
            return f'it was not closed: `mcap recover {path} -o mended.mcap` mends it'
    if kind == 'ros1':
        fault = 'its index is damaged' if _is_indexed(path) else 'it was not closed'
        return f'{fault}: `rosbag reindex {path}` mends it'
    if kind == 'sqlite3' and _is_cut(path):
        mended = f"`sqlite3 {path} '.recover' | sqlite3 mended.db3`"
        return f'it is cut off: {mended} saves what is left'
    return ''


def unmerged(path: Path) -> str:
    """Return why a sqlite3 file lacks messages though it can be read, and what mends it."""
    if not _has_content(path.with_name(f'{path.name}-wal')):
        return ''
    return (
        f'it was not closed, messages are still in {path.name}-wal: '
        f"`sqlite3 {path} 'PRAGMA wal_checkpoint(TRUNCATE)'` moves them, then "
        '`ros2 bag reindex` writes the metadata'
    )


def _is_cut(path: Path) -> bool:
    """Tell whether a sqlite3 file is shorter than the pages that its header counts."""
    with path.open('rb') as file:
        header = file.read(32)
    if len(header) < 32:
        return True
    page = int.from_bytes(header[16:18], 'big')
    bytes_a_page = 65536 if page == 1 else page
    return path.stat().st_size < bytes_a_page * int.from_bytes(header[28:32], 'big')


def _has_content(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0


def _is_indexed(path: Path) -> bool:
    """Tell whether the header of a ROS 1 bag points to an index within the file."""
    with path.open('rb') as file:
        start = file.read(4096)
    at = start.find(b'index_pos=')
    position = int.from_bytes(start[at + 10 : at + 18], 'little') if at >= 0 else 0
    return 0 < position <= path.stat().st_size
