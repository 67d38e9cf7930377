"""Write files so that a reader finds the old one or the new one, whole, whenever it looks.

Everything is made in a hidden folder beside its place and written through to the disk before it
is renamed. That folder is named after host and process, so the next save into the same place
can remove what a process left that was killed.

Sets: readers of a map start at its YAML, which names the image. Both names are to stay, and two
files cannot be renamed at once. So the YAML changes twice: first it comes to name the new image
under a name of its own, then the image takes its usual name, and the YAML with it. At any moment
the YAML names an image that belongs to it. (To remove the old YAML first would be simpler; but a
process killed in between, or a power cut, would leave a robot without any map.) What no order
can give: a reader that has read the YAML and opens the image only after the switch finds the new
image. All other files of a set are replaced before, one by one; each is whole by itself. Ctrl-C
and a polite kill wait until a set is in its place, and what takes room on the disk is done before.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from ogm_mcmc.errors import PLAIN_NAME_EXPECTED, OutputError, is_plain_name
from ogm_mcmc.files.folders import replace_folder, write_all_through, write_through
from ogm_mcmc.files.input_files import text_of
from ogm_mcmc.files.processes import host_name, lives
from ogm_mcmc.files.signals import signals_later
from ogm_mcmc.files.user_paths import possible_path
from ogm_mcmc.files.yaml_files import parse_yaml

__all__ = [
    'checked_name',
    'folder_to_fill',
    'makeable_folder',
    'refuse_folder',
    'replacing',
    'replacing_set',
    'scratch_folder',
    'writable_folder',
]

# Bytes; the YAML of a map has some hundreds.
LARGEST_YAML = 1_000_000

LEFTOVER = re.compile(r'\.ogm_mcmc-(?P<host>[A-Za-z0-9_]*)-(?P<pid>[0-9]+)-[A-Za-z0-9_]+')


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path of the same name that takes the place of `path` if all went well.

    Raises OutputError when the place cannot be written to; nothing half-written is left.
    """
    with _said(path), scratch_folder(path.parent) as scratch:
        temporary = scratch / path.name
        yield temporary
        refuse_folder(path)
        write_through(temporary)
        os.replace(temporary, path)
        write_through(path.parent)


@contextlib.contextmanager
def replacing_set(folder: Path, name: str, without: Sequence[str] = ()) -> Iterator[Path]:
    """Yield a folder for new files; they replace those of the same names in `folder`, as a set.

    A folder in it, such as a bag, replaces a folder in the same way.
    name     of the map; its YAML (NAME.yaml, which names the image) comes last, if there is one
    without  names of files that are no part of the set any more
    Raises OutputError; a failure before the first file is in its place leaves all as it was.
    """
    checked_name(name)
    with _said(folder), folder_to_fill(folder), scratch_folder(folder) as scratch:
        try:
            yield scratch
        except OutputError as error:  # of a file of the set: its place tells more
            raise OutputError(str(error).replace(f'{scratch}', f'{folder}')) from error
        made = sorted(path.name for path in scratch.iterdir())
        for one in made:
            if (scratch / one).is_dir():
                _refuse_file(folder / one)
                write_all_through(scratch / one)
            else:
                refuse_folder(folder / one)
                write_through(scratch / one)
        described = f'{name}.yaml'
        image = _image_of(scratch / described) if described in made else None
        twice = _first_under_another_name(scratch, folder, described, image)
        with signals_later():
            for one in made:
                if (scratch / one).is_dir():
                    replace_folder(scratch / one, folder / one)
                elif one not in (described, image):
                    os.replace(scratch / one, folder / one)
            if described in made:
                _switch(scratch, folder, described, image, twice)
            for one in set(without) - set(made):
                (folder / one).unlink(missing_ok=True)
            write_through(folder)


def _first_under_another_name(
    scratch: Path, folder: Path, described: str, image: str | None
) -> bool:
    """Make what the YAML changes to first; return False where it need not change twice.

    That is the new image under a name of its own, and a YAML beside it that names it.
    """
    named = _image_of(folder / described)
    if image is None or named is None or not (scratch / image).exists():
        return False
    if (folder / named).resolve() != (folder / image).resolve():
        return False
    between = _between(image)
    fields = parse_yaml((scratch / described).read_text(encoding='utf-8'))
    text = _dumped({**fields, 'image': between})
    (scratch / f'{between}.yaml').write_text(text, encoding='utf-8')
    shutil.copyfile(scratch / image, scratch / between)
    for one in (between, f'{between}.yaml'):
        write_through(scratch / one)
    return True


def _between(image: str) -> str:
    """Return the name of an image for a moment: hidden, and none that a set can have."""
    return f'.{Path(image).stem}-next{Path(image).suffix}'


def _switch(scratch: Path, folder: Path, described: str, image: str | None, twice: bool) -> None:
    """Put a YAML and its image in place of others; see the top of this file."""
    if image is None or not (scratch / image).exists():
        os.replace(scratch / described, folder / described)
        return
    between = _between(image)
    if twice:
        os.replace(scratch / between, folder / between)
        write_through(folder)
        os.replace(scratch / f'{between}.yaml', folder / described)
        write_through(folder)
    os.replace(scratch / image, folder / image)
    write_through(folder)
    os.replace(scratch / described, folder / described)
    write_through(folder)
    (folder / between).unlink(missing_ok=True)


def _dumped(fields: dict[str, object]) -> str:
    text: str = yaml.safe_dump(fields, sort_keys=False, default_flow_style=None)
    return text


def _image_of(path: Path) -> str | None:
    """Return which image a map YAML names; None where it is none or cannot be read."""
    try:
        fields = parse_yaml(text_of(path, 'utf-8', LARGEST_YAML))  # a pipe there would hang
    except (OSError, ValueError):
        return None
    return str(fields['image']) if isinstance(fields, dict) and 'image' in fields else None


@contextlib.contextmanager
def _said(path: Path) -> Iterator[None]:
    """Turn an OSError into one line about a place."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f'{path}: cannot be written ({reason})') from error


@contextlib.contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """Yield a hidden folder inside of another; remove it in the end, and those of the dead."""
    _remove_leftovers(folder)
    prefix = f'.ogm_mcmc-{host_name()}-{os.getpid()}-'
    made: tempfile.TemporaryDirectory[str] | None = None
    try:
        with signals_later():
            made = tempfile.TemporaryDirectory(
                dir=folder, prefix=prefix, ignore_cleanup_errors=True
            )
        yield Path(made.name)
    finally:
        with signals_later():
            if made is not None:
                made.cleanup()


def _remove_leftovers(folder: Path) -> None:
    """Remove what processes of this host left behind that are no more."""
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if entry.name.startswith('.ogm_mcmc-')]
    for name in names:
        found = LEFTOVER.fullmatch(name)
        if found and found['host'] == host_name() and not lives(int(found['pid'])):
            shutil.rmtree(folder / name, ignore_errors=True)


def refuse_folder(path: Path) -> None:
    """Check that a path is free for a file; raises OutputError for a folder."""
    if path.is_dir():
        raise OutputError(f'{path}: is a folder; expected a name for a file')


def _refuse_file(path: Path) -> None:
    """Check that a path is free for a folder; raises OutputError for a file."""
    if path.exists() and not path.is_dir():
        raise OutputError(f'{path}: is a file; expected a name for a folder')


def writable_folder(path: Path) -> Path:
    """Make a folder, parents included, and check that files can be made in it.

    Raises OutputError otherwise; call it before long work, so that none is lost.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise OutputError(f'{path}: expected a writable folder ({reason})') from error
    return path


@contextlib.contextmanager
def folder_to_fill(path: Path) -> Iterator[Path]:
    """Make a folder as `writable_folder` does; what was made for nothing goes again.

    That is the folder, and parents that were not there before, if they are empty in the end.
    """
    new = [one for one in (path, *path.parents) if not os.path.lexists(one)]
    try:
        yield writable_folder(path)
    finally:
        with contextlib.suppress(OSError):
            for one in new:
                one.rmdir()


def makeable_folder(path: Path) -> Path:
    """Check that `writable_folder` will succeed, without making any: work may fail before.

    Raises OutputError.
    """
    there = possible_path(path)
    while not os.path.exists(there) and there != there.parent:
        there = there.parent
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise OutputError(f'{there}: expected a writable folder ({reason})') from error
    return path


def checked_name(name: str) -> str:
    """Return a name for map files; raises OutputError unless it is a plain file name."""
    if not is_plain_name(name):
        raise OutputError(f'name of the map is {name!r}: {PLAIN_NAME_EXPECTED}')
    return name
