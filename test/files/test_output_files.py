"""Files and sets of files that are replaced as a whole, whenever the process is killed."""

import contextlib
import errno
import json
import os
import platform
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import save_map, write_shown
from ogm_mcmc.errors import OutputError
from ogm_mcmc.files.output_files import (
    checked_name,
    folder_to_fill,
    makeable_folder,
    replacing,
    replacing_set,
    writable_folder,
)
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_files import load_map


@pytest.mark.parametrize('error', [None, OutputError, KeyboardInterrupt])
def test_only_folders_made_for_nothing_go(tmp_path, error):
    (tmp_path / 'mine').mkdir()
    with (
        contextlib.suppress(OutputError, KeyboardInterrupt),
        folder_to_fill(tmp_path / 'mine' / 'new' / 'empty') as folder,
    ):
        assert folder.is_dir()
        if error:
            raise error
    with folder_to_fill(tmp_path / 'mine'):
        pass
    assert [path.name for path in tmp_path.rglob('*')] == ['mine']
    with folder_to_fill(tmp_path / 'mine' / 'new' / 'full') as folder:
        (folder / 'result').touch()
    assert (tmp_path / 'mine' / 'new' / 'full' / 'result').exists()
    with pytest.raises(OutputError), folder_to_fill(tmp_path / 'mine/new/full/result/more'):
        pass
    assert (tmp_path / 'mine' / 'new' / 'full' / 'result').is_file()


@pytest.mark.parametrize('error', [RuntimeError, KeyboardInterrupt, OSError])
def test_replacing_leaves_nothing_behind(tmp_path, error):
    path = tmp_path / 'result.txt'
    path.write_text('old')
    expected = OutputError if error is OSError else error
    with pytest.raises(expected), replacing(path) as temporary:  # noqa: PT012
        temporary.write_text('half')
        raise error('stop')
    assert [found.name for found in tmp_path.iterdir()] == ['result.txt']
    assert path.read_text() == 'old'


def test_replacing_puts_the_file_in_place(tmp_path):
    path = tmp_path / 'result.txt'
    ordinary = tmp_path / 'ordinary.txt'
    ordinary.write_text('as always')
    with replacing(path) as temporary:
        temporary.write_text('new')
        assert not path.exists()
        assert temporary.name == path.name
        assert tmp_path in temporary.parents
    assert path.read_text() == 'new'
    assert path.stat().st_mode == ordinary.stat().st_mode
    assert len(list(tmp_path.iterdir())) == 2


def test_replacing_by_nothing(tmp_path):
    """A writer that wrote nothing: said, and the old file stays."""
    path = tmp_path / 'result.txt'
    path.write_text('old')
    with pytest.raises(OutputError, match='cannot be written'), replacing(path):
        pass
    assert path.read_text() == 'old'


def test_folders_of_names_that_cannot_be(tmp_path):
    (tmp_path / 'file').write_text('mine')
    for path in (tmp_path / 'file' / 'maps', tmp_path / ('x' * 300), tmp_path / 'nul\0'):
        for check in (writable_folder, makeable_folder):
            with pytest.raises(OutputError, match='expected'):
                check(path)


@pytest.mark.parametrize('name', ['', '.', '..', '.hidden', 'a/b', '/a', 'a\0'])
def test_names_that_are_none(name):
    with pytest.raises(OutputError, match='name of the map'):
        checked_name(name)


# -- leftovers ----------------------------------------------------------------------------------


def a_dead_process():
    child = subprocess.Popen([sys.executable, '-c', ''])
    child.wait()
    return child.pid


def test_what_a_killed_process_left_goes(tmp_path):
    host = re.sub('[^A-Za-z0-9]', '_', platform.node())[:60]
    dead = a_dead_process()
    gone = [f'.ogm_mcmc-{host}-{dead}-abc_1', f'.ogm_mcmc-{host}-{dead}-x']
    kept = [
        f'.ogm_mcmc-{host}-{os.getppid()}-abc',  # lives
        f'.ogm_mcmc-{host}-{os.getpid()}-abc',  # another thread of ours may write to it
        f'.ogm_mcmc-elsewhere{host}-{dead}-abc',  # of a process we cannot see
        f'.ogm_mcmc-{host}-{dead}',
        f'.ogm_mcmc-{host}-{dead}-abc.txt',
        f'.map-{dead}-abc',
        'map.yaml',
    ]
    for name in gone + kept:
        (tmp_path / name).mkdir()
        (tmp_path / name / 'map.pgm').write_text('half')
    with replacing(tmp_path / 'result.txt') as temporary:
        temporary.write_text('new')
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*kept, 'result.txt'])


# -- a set, and a process that is killed while it is replaced -----------------------------------

SPEC = GridSpec(0.1, 2, 1)
OLD = GridMap(SPEC, np.array([[0.0, 1.0]], np.float32))
NEW = GridMap(GridSpec(0.2, 2, 2), np.array([[1.0, np.nan], [0.0, 0.0]], np.float32))
OUTPUT = OutputConfig()


class Killed(BaseException):
    """No handler of ours catches it, as none runs when a process is killed."""


def seen(folder):
    """What a reader that starts at the YAML finds: 'old', 'new' or nothing."""
    if not (folder / 'map.yaml').exists():
        return 'none'
    spec, probability = load_map(folder / 'map.yaml')
    for name, (a, b) in {'old': OLD, 'new': NEW}.items():
        if (spec.resolution_m, probability.shape) == (a.resolution_m, b.shape):
            assert np.array_equal(probability, b, equal_nan=True)
            return name
    raise AssertionError('image and YAML are not of one set')


def save_until(folder, monkeypatch, steps):
    """Save the new set; the process is killed before step `steps`. Return what readers saw."""
    views, left = [], steps

    def counted(step):
        def run(*args, **options):
            nonlocal left
            if Path(args[0]).is_relative_to(folder):
                views.append(seen(folder))
                if left == 0:
                    raise Killed
                left -= 1
            return step(*args, **options)

        return run

    with monkeypatch.context() as patch, contextlib.suppress(Killed):
        for name in ('replace', 'unlink', 'link', 'rename'):
            patch.setattr(os, name, counted(getattr(os, name)))
        patch.setattr('tempfile.TemporaryDirectory.cleanup', lambda self: self._finalizer.detach())
        save_map(NEW, folder, OUTPUT)
    return [*views, seen(folder)]


@pytest.mark.parametrize('before', ['nothing', 'a set', 'a set that names its image otherwise'])
def test_readers_find_the_old_set_or_the_new_one(tmp_path, monkeypatch, before):
    whole = tmp_path / 'whole'
    made = []

    def prepared(folder):
        if before != 'nothing':
            save_map(OLD, folder, OUTPUT)
        if 'otherwise' in before:
            path = folder / 'map.yaml'
            path.write_text(path.read_text().replace('map.pgm', f'../{folder.name}/./map.pgm'))
        folder.mkdir(exist_ok=True)
        return folder

    n_steps = len(save_until(prepared(whole), monkeypatch, -1)) - 1
    assert n_steps >= 3
    start = 'none' if before == 'nothing' else 'old'
    for steps in range(n_steps + 1):
        folder = prepared(tmp_path / str(steps))
        views = save_until(folder, monkeypatch, steps)
        switch = views.index('new') if 'new' in views else len(views)
        assert views == [start] * switch + ['new'] * (len(views) - switch)
        made.append(views[-1])
        # Whatever was left: the next save goes well, and leaves no more than its files.
        save_map(NEW, folder, OUTPUT)
        assert seen(folder) == 'new'
        names = {path.name for path in folder.iterdir() if not path.name.startswith('.ogm_mcmc-')}
        assert names == {'map.pgm', 'map.png', 'map.yaml'}
    assert (made[0], made[-1]) == (start, 'new')


KILLING = """
import json, os, sys
from pathlib import Path
import numpy as np
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.engine.saved_map import save_map
new = GridMap(GridSpec(0.2, 2, 2), np.array([[1.0, np.nan], [0.0, 0.0]], np.float32))
replace, codes = os.replace, []
for steps, folder in enumerate(sys.argv[1:]):
    child = os.fork()
    if child == 0:
        left = [steps]
        def killed(*args):
            if left[0] == 0:
                os._exit(9)
            left[0] -= 1
            replace(*args)
        os.replace = killed
        save_map(new, Path(folder), OutputConfig())
        os._exit(0)
    codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(json.dumps(codes))
"""


def test_a_process_that_dies_at_every_rename(tmp_path):
    """No handler runs; what it leaves is removed by the next save."""
    folders = [tmp_path / str(steps) for steps in range(7)]
    for folder in folders:
        save_map(OLD, folder, OUTPUT)
    command = [sys.executable, '-c', KILLING, *map(str, folders)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    codes = json.loads(done.stdout)
    assert codes.count(0) > 0
    assert codes == sorted(codes, reverse=True)
    for folder, code in zip(folders, codes, strict=True):
        assert seen(folder) in ('old', 'new')
        hidden = [path.name for path in folder.iterdir() if path.name.startswith('.ogm_mcmc-')]
        assert len(hidden) == (code == 9)
        save_map(NEW, folder, OUTPUT)
        assert sorted(path.name for path in folder.iterdir()) == ['map.pgm', 'map.png', 'map.yaml']


class Stopped(BaseException):
    """What the handler of a polite signal raises."""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_polite_stop_waits_until_the_set_is_in_its_place(tmp_path, monkeypatch, number):
    """It comes before every rename and removal; only before the first is the old set left."""
    heard = []

    def stop(number, frame):
        heard.append(number)
        raise Stopped

    def stop_before(step, steps, left):
        def run(*args, **options):
            left.append(step.__name__)
            if len(left) == steps:
                signal.raise_signal(number)
            return step(*args, **options)

        return run

    before = signal.signal(number, stop)
    try:
        for steps in range(1, 20):
            folder = tmp_path / str(steps)
            save_map(OLD, folder, OUTPUT)
            done = []
            with monkeypatch.context() as patch, contextlib.suppress(Stopped):
                for name in ('replace', 'unlink', 'rmdir'):
                    patch.setattr(os, name, stop_before(getattr(os, name), steps, done))
                save_map(NEW, folder, OUTPUT)
            names = sorted(path.name for path in folder.iterdir())
            assert (seen(folder), names) == ('new', ['map.pgm', 'map.png', 'map.yaml'])
            assert len(heard) == min(steps, len(done))
            assert signal.getsignal(number) is stop
    finally:
        signal.signal(number, before)
    assert 5 <= len(heard) < 19


def test_a_set_of_other_files_and_those_that_are_not_of_it(tmp_path):
    for name in ('map.npz', 'map_tree.npz', 'other.yaml'):
        (tmp_path / name).write_text('old')
    with replacing_set(tmp_path, 'map', without=['map_tree.npz']) as scratch:
        (scratch / 'map.npz').write_text('new')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['map.npz', 'other.yaml']
    assert (tmp_path / 'map.npz').read_text() == 'new'


def test_a_folder_made_for_a_set_that_fails_goes_again(tmp_path):
    folder = tmp_path / 'new' / 'maps'
    with pytest.raises(OutputError, match='No space left'), replacing_set(folder, 'map'):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert list(tmp_path.iterdir()) == []
    with replacing_set(folder, 'map') as scratch:
        (scratch / 'map.npz').write_text('new')
    assert [path.name for path in folder.iterdir()] == ['map.npz']


def test_a_folder_of_a_set_takes_the_place_of_one(tmp_path):
    for text in ('old', 'new'):
        with replacing_set(tmp_path, 'bag_truth') as scratch:
            (scratch / 'bag').mkdir()
            (scratch / 'bag' / f'{text}.mcap').write_text(text)
            (scratch / 'bag_poses.csv').write_text(text)
        found = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob('*'))
        assert found == ['bag', f'bag/{text}.mcap', 'bag_poses.csv']
        assert (tmp_path / 'bag_poses.csv').read_text() == text


def test_a_folder_of_a_set_takes_no_place_of_a_file(tmp_path):
    (tmp_path / 'bag').write_text('mine')
    with (  # noqa: PT012
        pytest.raises(OutputError, match=f'^{tmp_path}/bag: is a file; expected a name for a'),
        replacing_set(tmp_path, 'map') as scratch,
    ):
        (scratch / 'a.csv').write_text('new')
        (scratch / 'bag').mkdir()
    assert [path.name for path in tmp_path.iterdir()] == ['bag']
    assert (tmp_path / 'bag').read_text() == 'mine'


def test_a_disk_that_gets_full_leaves_all_as_it_was(tmp_path, monkeypatch):
    """The second copy of the image was made when others had been replaced."""
    save_map(OLD, tmp_path, OUTPUT)
    (tmp_path / 'map.npz').write_text('old')
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr('shutil.copyfile', full)
    with (  # noqa: PT012
        pytest.raises(OutputError, match='No space left'),
        replacing_set(tmp_path, 'map') as scratch,
    ):
        (scratch / 'map.npz').write_text('new')
        write_shown(NEW, scratch, OUTPUT, 'map')
    with (
        pytest.raises(OutputError, match=f'^{tmp_path}/map.npz: cannot be written'),
        replacing_set(tmp_path, 'map') as scratch,
        replacing(scratch / 'map.npz'),
    ):
        full()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_set_that_fails_leaves_all_as_it_was(tmp_path):
    (tmp_path / 'map.npz').write_text('old')
    (tmp_path / 'map.png').mkdir()
    with (  # noqa: PT012
        pytest.raises(OutputError, match='is a folder'),
        replacing_set(tmp_path, 'map') as scratch,
    ):
        (scratch / 'map.npz').write_text('new')
        (scratch / 'map.png').write_text('new')
    assert (tmp_path / 'map.npz').read_text() == 'old'
    assert len(list(tmp_path.iterdir())) == 2
