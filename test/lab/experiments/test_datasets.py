"""Many data sets: every one once, resumed after a death, an interrupt and a change."""

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from support.tasks import square

from ogm_mcmc.errors import ClusterError, ConfigError
from ogm_mcmc.lab.experiments import datasets
from ogm_mcmc.lab.experiments.datasets import ExperimentError, run_all, worker_count
from ogm_mcmc.lab.workers import Workers


def tasks(folder, count, **more):
    folder.mkdir(exist_ok=True)
    return {f'set{k}': {'value': k, 'folder': str(folder), **more} for k in range(count)}


def calls(folder):
    return sorted(path.name for path in folder.iterdir())


def test_each_once_and_never_again(tmp_path):
    work = tasks(tmp_path / 'calls', 5)
    results = run_all(tmp_path / 'out', square, work, workers=1)
    assert list(results) == list(work)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9, 16]
    assert run_all(tmp_path / 'out', square, work, workers=1) == results
    assert calls(tmp_path / 'calls') == ['0-0', '1-0', '2-0', '3-0', '4-0']


def test_what_was_made_otherwise_is_made_anew_and_stays(tmp_path):
    work = tasks(tmp_path / 'calls', 3)
    first = run_all(tmp_path / 'out', square, work, workers=1)
    other = {**work, 'set1': {**work['set1'], 'seconds': 0.001}}
    run_all(tmp_path / 'out', square, other, workers=1)
    assert calls(tmp_path / 'calls') == ['0-0', '1-0', '1-1', '2-0']
    # What was there first is still there.
    assert run_all(tmp_path / 'out', square, work, workers=1) == first
    assert calls(tmp_path / 'calls') == ['0-0', '1-0', '1-1', '2-0']
    run_all(tmp_path / 'out', square, work, workers=1, depends_on={'table': [1, 2]})
    assert calls(tmp_path / 'calls') == ['0-0', '0-1', '1-0', '1-1', '1-2', '2-0', '2-1']


def test_what_other_code_made_is_made_anew(tmp_path, monkeypatch):
    work = tasks(tmp_path / 'calls', 1)
    run_all(tmp_path / 'out', square, work, workers=1)
    monkeypatch.setattr(datasets, 'code_digest', lambda: 'of another day')
    run_all(tmp_path / 'out', square, work, workers=1)
    assert calls(tmp_path / 'calls') == ['0-0', '0-1']


def test_the_digest_is_of_all_code_that_results_are_made_by(tmp_path, monkeypatch):
    package = tmp_path / 'ogm_mcmc'
    files = ('lab/experiments/datasets.py', 'engine/engine.py', 'cli/cli.py', 'top.py')
    for file in files:
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        (package / file).write_text('1')
    prior = tmp_path / 'prior'
    prior.write_text('1')
    monkeypatch.setattr(datasets, '__file__', str(package / files[0]))
    monkeypatch.setattr(datasets, 'default_prior_file', lambda: prior)
    of = datasets.code_digest.__wrapped__
    found = [of()]
    for path in (*(package / file for file in files), prior):
        path.write_text('2')
        found.append(of())
    changed = [before != after for before, after in itertools.pairwise(found)]
    assert changed == [True, True, False, True, True]


@pytest.mark.parametrize(
    'broken', ['', '{"made_wi', '[]', '{"made_with": {}, "result": {"square": 5}}', None]
)
def test_a_broken_part_is_made_anew(tmp_path, broken):
    work = tasks(tmp_path / 'calls', 1)
    run_all(tmp_path / 'out', square, work, workers=1)
    (path,) = (tmp_path / 'out').iterdir()
    if broken is None:  # made with the same, and nothing in it
        broken = json.dumps({**json.loads(path.read_text()), 'result': {}})
    path.write_text(broken)
    assert run_all(tmp_path / 'out', square, work, workers=1)['set0']['square'] == 0
    assert calls(tmp_path / 'calls') == ['0-0', '0-1']


def test_a_dead_process_costs_only_what_was_not_finished(tmp_path):
    work = tasks(tmp_path / 'calls', 4)
    run_all(tmp_path / 'out', square, dict(list(work.items())[:2]), workers=1)
    work['set3']['dies'] = True
    with pytest.raises(ExperimentError, match='a worker process died'):
        run_all(tmp_path / 'out', square, work, workers=2)
    results = run_all(tmp_path / 'out', square, work, workers=2)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9]
    assert calls(tmp_path / 'calls')[:2] == ['0-0', '1-0']
    assert '0-1' not in calls(tmp_path / 'calls')


SCRIPT = """
import json, sys
from ogm_mcmc.cli import entry
from ogm_mcmc.lab.experiments import EXPERIMENTS
from ogm_mcmc.lab.experiments.datasets import run_all
from support.tasks import square

def experiment(folder, *, quick, seed):
    run_all(folder, square, json.load(open('work.json')), workers=2)
    return {'reached': 'the end'}

if __name__ == '__main__':
    EXPERIMENTS['slow'] = experiment
    sys.argv = ['ogm_mcmc', 'experiment', 'slow', '-o', 'out', '--json']
    entry.main()
"""


def children(pid):
    """Processes whose parent is this one, but for the one that tracks semaphores."""
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):
            parent = int((path / 'stat').read_text().rpartition(')')[2].split()[1])
            started = (path / 'cmdline').read_bytes()
            # Until it has its own program a child has its parent's line, the tracker, too.
            begun = started != Path(f'/proc/{pid}/cmdline').read_bytes()
            if parent == pid and begun and b'resource_tracker' not in started:
                found.append(int(path.name))
    return found


def in_session(leader):
    """Processes that live in a session."""
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):
            state, _, _, session = (path / 'stat').read_text().rpartition(')')[2].split()[:4]
            if int(session) == leader and state != 'Z':
                found.append(int(path.name))
    return found


def alive(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


def until(condition, timeout_s):
    deadline = time.monotonic() + timeout_s
    while not (held := condition()) and time.monotonic() < deadline:
        time.sleep(0.02)
    return held


@pytest.fixture
def start_slow(tmp_path):
    """Start the command with six parts, the first of which is done soon; the rest take minutes."""
    work = tasks(tmp_path / 'calls', 6)
    for name in list(work)[1:]:
        work[name]['seconds'] = 300.0
    (tmp_path / 'work.json').write_text(json.dumps(work))
    (tmp_path / 'script.py').write_text(SCRIPT)
    started = []

    def start():
        process = subprocess.Popen(
            [sys.executable, 'script.py'], cwd=tmp_path, stderr=subprocess.PIPE, text=True,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}, start_new_session=True,
        )  # fmt: skip
        started.append(process)
        return process

    yield start
    for process in started:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.mark.alone
@pytest.mark.skipif(not Path('/proc/self/stat').exists(), reason='looks for processes in /proc')
@pytest.mark.parametrize('to_all', [False, True], ids=['to the command', 'to its workers, too'])
@pytest.mark.parametrize(('how', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stop_is_at_once_and_keeps_what_is_finished(tmp_path, start_slow, how, code, to_all):
    """Quiet, within two seconds, nothing half-written, no process left; a later run goes on."""
    process = start_slow()
    out = tmp_path / 'out'
    # One part is done and two are in progress.
    assert until(lambda: any(out.glob('set0_*')) and len(calls(tmp_path / 'calls')) == 3, 60)
    workers = children(process.pid)
    assert len(workers) == 2
    began = time.monotonic()
    if to_all:
        os.killpg(process.pid, how)
    else:
        process.send_signal(how)
    _, errors = process.communicate(timeout=60)
    assert time.monotonic() - began < 2.0
    assert process.returncode == code
    assert errors == ''
    assert not any(map(alive, workers))
    assert [path.name[:5] for path in out.iterdir()] == ['set0_']
    work = tasks(tmp_path / 'calls', 6)
    work['set0'] = json.loads((tmp_path / 'work.json').read_text())['set0']
    results = run_all(out, square, work, workers=1)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9, 16, 25]
    assert '0-1' not in calls(tmp_path / 'calls')


@pytest.mark.skipif(not Path('/proc/self/stat').exists(), reason='looks for processes in /proc')
@pytest.mark.parametrize('delay_s', [0.0, 0.05, 0.4])
def test_a_stop_while_workers_are_started(start_slow, delay_s):
    """Half a start would say so, or leave a process that nobody knows of."""
    process = start_slow()
    assert until(lambda: children(process.pid), 60)
    time.sleep(delay_s)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, '')
    assert until(lambda: not in_session(process.pid), 2.0)


@pytest.mark.skipif(not Path('/proc/self/stat').exists(), reason='looks for processes in /proc')
def test_workers_end_with_a_parent_that_was_killed(tmp_path, start_slow):
    process = start_slow()
    assert until(lambda: len(calls(tmp_path / 'calls')) == 3, 60)
    workers = children(process.pid)
    process.kill()
    assert len(workers) == 2
    assert until(lambda: not any(map(alive, workers)), 5.0)


def test_an_error_ends_what_runs(tmp_path):
    work = tasks(tmp_path / 'calls', 3)
    work['set0']['seconds'] = 300.0
    work['set1']['value'] = 'no number'
    began = time.monotonic()
    with pytest.raises(TypeError):
        run_all(tmp_path / 'out', square, work, workers=2)
    assert time.monotonic() - began < 60.0


def test_another_executor(tmp_path):
    """Two of six fail: what came before is kept, what had not begun never does."""
    work = tasks(tmp_path / 'calls', 6)
    for name in ('set2', 'set3'):
        work[name]['value'] = 'no number'
    with ThreadPoolExecutor(1) as executor, pytest.raises(TypeError):
        run_all(tmp_path / 'out', square, work, executor=executor)
    kept = sorted(path.stem for path in (tmp_path / 'out').iterdir())
    assert [name[:5] for name in kept[:2]] == ['set0_', 'set1_']
    work = tasks(tmp_path / 'calls', 6)
    with ThreadPoolExecutor(2) as executor:
        results = run_all(tmp_path / 'out', square, work, executor=executor)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9, 16, 25]
    assert '0-1' not in calls(tmp_path / 'calls')


def test_a_cluster_whose_workers_are_gone_ends_it(tmp_path, monkeypatch):
    """Nobody ever answers: that was waited for, for ever."""

    class Left(Workers):
        def __init__(self):
            self.looks, self.begun = 0, []

        def submit(self, fn, /, *arguments, **keywords):
            self.begun.append(Future())
            return self.begun[-1]

        def check(self):
            self.looks += 1
            if self.looks == 3:
                raise ClusterError('no worker is left')

    monkeypatch.setattr(datasets, 'LOOK_S', 0.01)
    gone = Left()
    with pytest.raises(ClusterError, match='no worker is left'):
        run_all(tmp_path / 'out', square, tasks(tmp_path / 'calls', 2), executor=gone)
    assert [future.cancelled() for future in gone.begun] == [True, True]


def test_what_is_finished_when_others_fail_is_kept(tmp_path):
    """All six are done before the first is looked at, in whatever order a set has them."""

    class AtOnce(ThreadPoolExecutor):
        def submit(self, fn, /, *arguments, **keywords):
            future = super().submit(fn, *arguments, **keywords)
            future.exception()
            return future

    work = tasks(tmp_path / 'calls', 6)
    work['set2']['value'] = 'no number'
    with AtOnce(1) as executor, pytest.raises(TypeError):
        run_all(tmp_path / 'out', square, work, executor=executor)
    kept = {path.name.split('_')[0] for path in (tmp_path / 'out').iterdir()}
    assert kept == {'set0', 'set1', 'set3', 'set4', 'set5'}


def test_how_many_workers(tmp_path, monkeypatch):
    monkeypatch.delenv('OGM_MCMC_WORKERS', raising=False)
    assert worker_count() >= 1
    monkeypatch.setenv('OGM_MCMC_WORKERS', '3')
    assert worker_count() == 3
    monkeypatch.setenv('OGM_MCMC_WORKERS', 'many')
    with pytest.raises(ConfigError, match='OGM_MCMC_WORKERS'):
        worker_count()
    with pytest.raises(ConfigError, match='OGM_MCMC_WORKERS'):
        run_all(tmp_path / 'out', square, {'set0': {'value': 1}})
    assert list(tmp_path.iterdir()) == []
