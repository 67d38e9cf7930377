"""Which of Numba's caches are forgotten before a test run."""

import os

import pytest
from support.kernel_caches import forget_stale_kernels


@pytest.mark.parametrize(('edited_at', 'kept'), [(50, True), (150, False)])
def test_caches_older_than_any_kernel_are_forgotten(tmp_path, edited_at, kept):
    (tmp_path / 'room').mkdir()
    times = {'walk_kernels.py': 10, 'room/other_kernels.py': edited_at, 'room/loop.py': 999}
    caches = {
        f'{folder}walk.py311.{kind}': 100 for folder in ('', 'room/') for kind in ('nbi', 'nbc')
    }
    for name, time_s in {**times, **caches}.items():
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time_s, time_s))
    forget_stale_kernels(tmp_path)
    assert all((tmp_path / name).exists() == kept for name in caches)
    assert all((tmp_path / name).exists() for name in times)
