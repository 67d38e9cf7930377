"""How workers of a Dask cluster are reached, before any work is sent."""

import pytest

from ogm_mcmc.cli.main import run
from ogm_mcmc.errors import ClusterError, ConfigError
from ogm_mcmc.lab import workers as workers_module
from ogm_mcmc.lab.workers import Workers, connected, spread


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


def test_keys_stay_with_their_workers_and_are_spread_by_threads():
    assert spread(range(3), {}, {'b': 1, 'a': 2}) == {0: 'a', 1: 'a', 2: 'b'}
    assert spread(range(2), {0: 'b', 1: 'b'}, {'a': 1, 'b': 2}) == {0: 'b', 1: 'b'}
    assert spread(range(2), {}, {}) == {}


def test_keys_of_a_worker_that_is_gone_go_to_the_others():
    had = {0: 'a', 1: 'b', 2: 'c', 3: 'a', 4: 'b', 5: 'c'}
    assert spread(range(6), had, {'a': 1, 'b': 1}) == {**had, 2: 'a', 5: 'b'}


def test_a_worker_that_joins_takes_over_what_others_have_too_much_of():
    had = dict.fromkeys(range(4), 'a') | dict.fromkeys(range(4, 8), 'b')
    found = spread(range(8), had, {'a': 1, 'b': 1, 'c': 1})
    assert found == {**had, 3: 'c', 7: 'c'}
    assert spread(range(8), found, {'a': 1, 'b': 1, 'c': 1}) == found
    # One chain for each: nobody would be done sooner.
    assert spread(range(2), {0: 'a', 1: 'b'}, {'a': 1, 'b': 1, 'c': 1}) == {0: 'a', 1: 'b'}


class Scheduler:
    """Stands for a client: says who is there, and notes who is to do what."""

    def __init__(self, threads):
        self.threads, self.asked, self.given = threads, 0, []

    def nthreads(self):
        self.asked += 1
        return self.threads

    def get_executor(self, *, workers=None, **_):
        outer = self

        class Pool:
            def submit(self, fn, *args):
                outer.given.append(workers)

        return Pool()


def test_who_is_there_is_asked_once_a_round():
    there = Scheduler({'a': 1})
    workers = Workers(there)
    assert workers.place(range(2)) == {0, 1}
    for key in range(2):
        workers.again(key, abs)
    there.threads['b'] = 1
    assert workers.place(range(2)) == {1}
    for key in range(2):
        workers.again(key, abs)
    assert there.asked == 2
    assert there.given == [['a'], ['a'], ['a'], ['b']]
    # Another worker took a task over: from now on it has what belongs to it.
    workers.done_by(0, 'b')
    workers.done_by(1, 'a')
    assert workers.place(range(2)) == set()
    assert workers.held() == {'a': [1], 'b': [0]}
    there.threads.clear()
    workers.place(range(2))
    workers.again(0, abs)
    assert there.given[-1] is None


class GoneScheduler:
    """Stands for a client whose scheduler, or all workers, went away."""

    def nthreads(self):
        raise OSError('Timed out')

    def run(self, fn, *, on_error):
        raise OSError('Timed out')

    def scatter(self, data, *, broadcast, hash, timeout):
        assert timeout == workers_module.WORKERS_S
        raise TimeoutError('No valid workers found')

    def get_executor(self, **_):
        return None


def test_a_cluster_that_goes_away_is_one_line_and_takes_no_figures_along():
    workers = Workers(GoneScheduler())
    for ask in (lambda: workers.place([0]), lambda: workers.share(b'scans')):
        with pytest.raises(
            ClusterError, match=r'^the cluster is lost \((Timed|No valid).*expected'
        ):
            ask()
    assert workers.asked(abs) == {}


def test_a_cluster_without_workers_is_waited_for_only_so_long(monkeypatch):
    there, now = Scheduler({'a': 1}), [0.0]
    workers = Workers(there)
    monkeypatch.setattr(workers_module.time, 'monotonic', lambda: now[0])
    for now[0] in (0.0, 100.0):
        workers.check()
    there.threads.clear()
    for now[0] in (200.0, 229.0):
        workers.check()
    there.threads['b'] = 1
    workers.check()  # one came
    there.threads.clear()
    for now[0] in (300.0, 329.0):
        workers.check()
    now[0] = 331.0
    with pytest.raises(ClusterError, match='no worker is left, nor came in 30 s: expected'):
        workers.check()
