"""Folders that take the place of others: killed at any moment, one of both is there, whole."""

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
        assert sorted(one.name for one in place.iterdir()) == ['place', 'scratch']
