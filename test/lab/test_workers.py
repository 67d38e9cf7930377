"""How workers of a Dask cluster are reached, before any work is sent."""

import pytest

from ogm_mcmc.cli.main import run
from ogm_mcmc.errors import ClusterError, ConfigError
from ogm_mcmc.lab import workers as workers_module
from ogm_mcmc.lab.workers import connected


def test_no_scheduler(monkeypatch, tmp_path, capsys):
    pytest.importorskip('distributed')
    monkeypatch.setattr(workers_module, 'ANSWER_S', 0.3)
    monkeypatch.chdir(tmp_path)
    assert run(['experiment', 'pose-sim', '--quick', '--scheduler', 'tcp://127.0.0.1:9']) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert 'tcp://127.0.0.1:9' in lines[0]


@pytest.mark.parametrize(
    ('address', 'reason'),
    [
        ('inproc://x', 'expected the address of a Dask scheduler, such as tcp://host:8786'),
        ('tls://127.0.0.1:9', "expected what distributed.comm of Dask's configuration allows"),
    ],
)
def test_an_address_that_cannot_be_is_one_line_at_once(run_process, tmp_path, address, reason):
    """A process of its own: what is left of a client speaks when Python ends."""
    pytest.importorskip('distributed')
    done = run_process('experiment', 'pose-sim', '--quick', '--scheduler', address, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f'ogm_mcmc experiment: error: scheduler {address}: ')
    assert reason in line
    assert not any(tmp_path.rglob('*.json'))


@pytest.mark.parametrize(
    'address',
    ['bla', 'http://x', 'no://where', 'tcp://127.0.0.1', 'tcp://[::1', 'tcp://127.0.0.1:99999'],
)
def test_no_client_is_made_for_an_address_that_cannot_be(address, monkeypatch):
    distributed = pytest.importorskip('distributed')
    monkeypatch.setattr(distributed, 'Client', None)
    with pytest.raises(ClusterError, match='expected the address'), connected(address):
        pass


def test_without_distributed(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'distributed', None)
    with pytest.raises(ConfigError, match=r'ogm_mcmc\[cluster\]'), connected('tcp://here:1'):
        pass
