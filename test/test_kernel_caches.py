"""Which of Numba's caches are forgotten before a test run."""

import os

import pytest
from support.kernel_caches import forget_stale_kernels

SOURCES = {
    'walk_kernels.py': 'import math\n',
    'room/loop_kernels.py': 'from house.walk_kernels import (\n    next_cell,\n)\n',
    'room/far_kernels.py': 'import math\n\nfrom house.room.loop_kernels import loop\n',
    'room/other_kernels.py': 'from house.arrays import walk_kernels\n',
}
ALL = ['walk', 'loop', 'far', 'other']


@pytest.fixture
def house(tmp_path):
    """Make a package with one kernel and its cache, of two files, a module; all of time 100."""
    for name, text in SOURCES.items():
        source = tmp_path / 'house' / name
        (source.parent / '__pycache__').mkdir(parents=True, exist_ok=True)
        source.write_text(text)
        for kind in ('nbi', '1.nbc'):
            cache = source.parent / '__pycache__' / f'{source.stem}.fit-12.py311.{kind}'
            cache.touch()
            os.utime(cache, (100, 100))
        os.utime(source, (50, 50))
    return tmp_path / 'house'


def left(house):
    """Forget what is stale; return whose caches are left."""
    forget_stale_kernels(house)
    assert all((house / name).exists() for name in SOURCES)
    found = [sorted(house.rglob(f'{name}_kernels.*.nb[ic]')) for name in ALL]
    assert all(len(files) in (0, 2) for files in found)
    return [name for name, files in zip(ALL, found, strict=True) if files]


@pytest.mark.parametrize('first', [True, False])
@pytest.mark.parametrize(
    ('edited', 'kept'),
    [
        ('walk_kernels.py', ['other']),
        ('room/loop_kernels.py', ['walk', 'other']),
        ('room/far_kernels.py', ['walk', 'loop', 'other']),
    ],
)
def test_an_edit_reaches_all_that_call_directly_or_not(house, edited, kept, first):
    if not first:
        assert left(house) == ALL
    (house / edited).write_text(SOURCES[edited] + '# edited')  # and so younger than the caches
    assert left(house) == kept


def test_a_source_that_is_written_anew_as_it_was_costs_nothing(house):
    assert left(house) == ALL
    for name, text in SOURCES.items():
        (house / name).write_text(text)
    assert left(house) == ALL


def test_caches_of_a_module_that_is_gone_go(house):
    forget_stale_kernels(house)
    (house / 'room/far_kernels.py').rename(house / 'room/new_kernels.py')
    forget_stale_kernels(house)
    assert not list(house.rglob('far_kernels.*.nb[ic]'))
