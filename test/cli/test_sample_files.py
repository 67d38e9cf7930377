"""Maps drawn by `sample`: what can be held of them."""

import math

import pytest

from ogm_mcmc.cli.sample_files import check_room
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.processes import free_memory


@pytest.mark.parametrize(
    ('free', 'reason'),
    [
        (1e12, 'take 20 GB: expected at most 429, for the 8.59 GB that a file of maps may hold'),
        (1e9, 'take 20 GB: expected at most 50, for the 1 GB that is free'),
    ],
)
def test_maps_that_nothing_can_hold(monkeypatch, free, reason):
    monkeypatch.setattr('ogm_mcmc.cli.sample_files.free_memory', lambda: free)
    with pytest.raises(ConfigError, match=f'--samples 1000: maps of 20000000 cells {reason}'):
        check_room(1000, 20_000_000)
    check_room(50, 20_000_000)


def test_free_memory_is_what_linux_tells(tmp_path, monkeypatch):
    listed = tmp_path / 'meminfo'
    monkeypatch.setattr('ogm_mcmc.files.processes.MEMORY', listed)
    assert free_memory() == math.inf
    listed.write_text('MemTotal: 24684084 kB\nMemAvailable:   2000 kB\n')
    assert free_memory() == 2_048_000
    listed.write_text('MemTotal: 24684084 kB\n')  # kernels before 3.14
    assert free_memory() == math.inf
