"""Folders that take the place of others: killed at any moment, one of both is there, whole."""

import pathlib
import subprocess
import sys

import pytest

from ogm_mcmc.files import folders
from ogm_mcmc.files.folders import put_back, replace_folder


def filled(path, text):
    (path / 'deep').mkdir(parents=True)
    (path / 'deep' / 'file').write_text(text)
    return path


def read(path):
    return (path / 'deep' / 'file').read_text()


@pytest.mark.parametrize('exchange', [True, False])
def test_the_new_folder_is_there_and_nothing_is_left(tmp_path, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(folders, '_exchanged', lambda one, other: False)
    path = tmp_path / 'place'
    for text in ('first', 'second'):
        replace_folder(filled(tmp_path / 'new', text), path)
        assert read(path) == text
        assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform != 'linux', reason='only Linux exchanges two names at once')
def test_two_names_are_exchanged_in_one_step(tmp_path):
    path = filled(tmp_path / 'place', 'old')
    new = filled(tmp_path / 'new', 'new')
    assert folders._exchanged(new, path)
    assert (read(path), read(new)) == ('new', 'old')


# Dies at the n-th step in the place sys.argv[n + 1]; ends with 0 if it comes to that step.
KILLING = """
import os, sys
from pathlib import Path
from ogm_mcmc.files import folders
folders._exchanged = lambda one, other: False
for at, place in enumerate(sys.argv[1:]):
    if os.fork() == 0:
        done = []
        def killing(work):
            def step(*args, **options):
                if len(done) == at:
                    os._exit(0)
                done.append(work)
                return work(*args, **options)
            return step
        for module, name in ((os, 'replace'), (os, 'rename'), (folders.shutil, 'rmtree')):
            setattr(module, name, killing(getattr(module, name)))
        folders.replace_folder(Path(place, 'scratch', 'new'), Path(place, 'place'))
        os._exit(1)
    if os.waitstatus_to_exitcode(os.wait()[1]):
        sys.exit(f'came to no step {at}')
"""


def test_who_writes_there_next_puts_back_what_a_killed_process_left(tmp_path):
    places = [tmp_path / str(at) for at in range(3)]
    for place in places:
        filled(place / 'place', 'old')
        filled(place / 'scratch' / 'new', 'new')
    subprocess.run([sys.executable, '-c', KILLING, *map(str, places)], check=True)
    for at, place in enumerate(places):
        put_back(place / 'place')
        assert read(place / 'place') == ('old' if at < 2 else 'new')
        replace_folder(filled(place / 'scratch' / 'next', 'next'), place / 'place')
        assert read(place / 'place') == 'next'
        assert sorted(one.name for one in place.iterdir()) == ['place', 'scratch']


def test_two_that_replace_at_once_leave_one_whole(tmp_path, monkeypatch):
    path = filled(tmp_path / 'place', 'old')

    def other_comes_first(one, other):
        other.rename(tmp_path / 'aside of the other')
        return False

    monkeypatch.setattr(folders, '_exchanged', other_comes_first)
    with pytest.raises(FileNotFoundError):
        replace_folder(filled(tmp_path / 'new', 'new'), path)

    def between_two_renames(self, target):
        renamed = rename(self, target)
        if self == path:
            filled(path, 'of the other')
        return renamed

    rename = pathlib.Path.replace
    (tmp_path / 'aside of the other').rename(path)
    monkeypatch.setattr(folders, '_exchanged', lambda one, other: False)
    monkeypatch.setattr(pathlib.Path, 'replace', between_two_renames)
    with pytest.raises(OSError, match='not empty'):
        replace_folder(tmp_path / 'new', path)
    assert read(path) == 'of the other'
