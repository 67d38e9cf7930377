"""Many data sets: every one once, resumed after a death, an interrupt and a change."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.experiments.datasets import ExperimentError, run_all, worker_count
from ogm_mcmc.testing.tasks import square


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


def test_what_was_made_otherwise_is_made_anew(tmp_path):
    work = tasks(tmp_path / 'calls', 3)
    run_all(tmp_path / 'out', square, work, workers=1)
    work['set1']['seconds'] = 0.001
    (tmp_path / 'out' / 'set2.json').write_text('{"made_wi')
    run_all(tmp_path / 'out', square, work, workers=1)
    assert calls(tmp_path / 'calls') == ['0-0', '1-0', '1-1', '2-0', '2-1']


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


def test_ctrl_c_keeps_what_is_finished(tmp_path):
    work = tasks(tmp_path / 'calls', 6, seconds=0.5)
    (tmp_path / 'work.json').write_text(json.dumps(work))
    code = (
        'import json, pathlib\n'
        'from ogm_mcmc.experiments.datasets import run_all\n'
        'from ogm_mcmc.testing.tasks import square\n'
        "if __name__ == '__main__':\n"
        "    run_all(pathlib.Path('out'), square, json.load(open('work.json')), workers=2)\n"
    )
    (tmp_path / 'script.py').write_text(code)
    process = subprocess.Popen(
        [sys.executable, 'script.py'], cwd=tmp_path, stderr=subprocess.DEVNULL,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )  # fmt: skip
    deadline = time.monotonic() + 60.0
    while not list((tmp_path / 'out').glob('set*.json')) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert process.wait(30.0) != 0
    finished = sorted(path.stem for path in (tmp_path / 'out').glob('set*.json'))
    assert 0 < len(finished) < 6
    assert not list((tmp_path / 'out').glob('.*'))
    before = len(calls(tmp_path / 'calls'))
    results = run_all(tmp_path / 'out', square, work, workers=1)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9, 16, 25]
    assert len(calls(tmp_path / 'calls')) == before + 6 - len(finished)


def test_another_executor(tmp_path):
    """Two of six fail: what came before is kept, what had not begun never does."""
    work = tasks(tmp_path / 'calls', 6)
    for name in ('set2', 'set3'):
        work[name]['value'] = 'no number'
    with ThreadPoolExecutor(1) as executor, pytest.raises(TypeError):
        run_all(tmp_path / 'out', square, work, executor=executor)
    kept = sorted(path.stem for path in (tmp_path / 'out').iterdir())
    assert kept[:2] == ['set0', 'set1']
    work = tasks(tmp_path / 'calls', 6)
    with ThreadPoolExecutor(2) as executor:
        results = run_all(tmp_path / 'out', square, work, executor=executor)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9, 16, 25]
    assert '0-1' not in calls(tmp_path / 'calls')


def test_how_many_workers(monkeypatch):
    monkeypatch.delenv('OGM_MCMC_WORKERS', raising=False)
    assert worker_count() >= 1
    monkeypatch.setenv('OGM_MCMC_WORKERS', '3')
    assert worker_count() == 3
    monkeypatch.setenv('OGM_MCMC_WORKERS', 'many')
    with pytest.raises(ConfigError, match='OGM_MCMC_WORKERS'):
        worker_count()
