"""The worker where something cannot be done: it says so and goes on."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from support.workers import CONFIG, ENDLESS, idle, scans, until

from ogm_mcmc.config import SamplerConfig, StopConfig, WindowConfig
from ogm_mcmc.engine.beams_found import BeamsFound
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.worker import RefineWorker
from ogm_mcmc.errors import WindowError

# What has a deadline here is compiled before the clock runs.
pytestmark = pytest.mark.usefixtures('compiled')


def test_what_cannot_be_sampled_is_said_and_harms_nothing(make):
    said = []
    small = SamplerConfig(
        window=WindowConfig(resolution=0.1, max_memory_mb=1.0), chain=CONFIG.chain
    )
    worker = make(config=small, log=said.append)
    worker.refine(scans(4), StopConfig(max_sweeps=10, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps'))
    before = worker.result
    worker.refine(scans(4, beams=2000), ENDLESS)
    until(lambda: idle(worker, 'error'))
    assert '8000 rays need' in worker.status.error
    assert 'expected at most max_memory_mb = 1' in worker.status.error
    assert said[1:] == [f'not refined: {worker.status.error}']
    assert worker.status.no_return.value == 'clear'  # as asked: the recording can go by it
    assert worker.result is before
    worker.refine(scans(4), StopConfig(max_sweeps=5, r_hat=0.0))
    until(lambda: idle(worker, 'error') and 'max_sweeps is 5' in worker.status.error)
    worker.refine(scans(4), StopConfig(max_sweeps=10, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps') and worker.status.error == '')


def test_an_index_that_cannot_be_used_ends_no_worker(make, monkeypatch):
    """The posterior of a grown window failed: chains begin anew with the next order."""
    said, limits = [], StopConfig(max_sweeps=10, r_hat=0.0)
    worker, some = make(log=said.append), scans(6)
    worker.refine(some[:4], limits)
    until(lambda: idle(worker, 'sweeps'))

    def fails(*_, **__):
        raise WindowError('no patch fits')

    with monkeypatch.context() as patched:
        patched.setattr('ogm_mcmc.engine.refinement.posterior_model', fails)
        worker.refine(some, limits)
        until(lambda: idle(worker, 'error'))
    assert said[1:] == ['not refined: no patch fits']
    worker.refine(some, limits)
    until(lambda: idle(worker, 'sweeps'))
    assert worker.status.progress.sweeps == 10


def test_a_state_that_fails_after_its_index_was_built_harms_nothing(make, monkeypatch, tmp_path):
    """It says that beams are other ones, then it breaks off: chains begin as without it."""
    said, limits = [], StopConfig(max_sweeps=10, r_hat=0.0)
    path, some = tmp_path / 'chains.npz', scans(3)
    first = Refinement(CONFIG)
    first.take(some)
    first.save(path)
    other = first.beams._replace(model=replace(first.beams.model, sigma=0.5), told=3)
    monkeypatch.setattr(BeamsFound, 'saved', lambda *_: other)

    def fails(*_):
        raise WindowError('cut short')

    monkeypatch.setattr('ogm_mcmc.engine.refinement.load_chains', fails)
    worker = make(state_file=path, log=said.append)
    worker.refine(some, limits)
    until(lambda: idle(worker, 'sweeps'))
    assert said[0] == 'starts new chains: cut short'
    assert worker.status.progress.sweeps == 10


def test_a_state_that_cannot_be_written_is_said(make, tmp_path):
    """Once for each reason, as a warning, and when it can be written again."""
    said, warned, limits = [], [], StopConfig(max_sweeps=10, r_hat=0.0)
    path = tmp_path / 'gone' / 'chains.npz'
    worker = make(state_file=path, log=said.append, warn=warned.append)
    for _ in range(2):
        worker.refine(scans(3), limits)
        until(lambda: idle(worker, 'sweeps') and worker.status.progress.sweeps > 0)
        worker.save_state()
        until(lambda: bool(worker.unsaved))
    assert 'cannot be written' in worker.unsaved
    assert warned == [f'state not saved: {worker.unsaved}']
    assert worker.result.final
    path.parent.mkdir()
    worker.save_state()
    until(lambda: worker.unsaved == '')
    assert said[-1] == f'state saved again: {path}'


def test_an_index_is_not_waited_for(monkeypatch):
    """It may take long and cannot be interrupted; the map of before is still there."""
    said, go_on = [], threading.Event()
    worker = RefineWorker(CONFIG, log=said.append)
    worker.refine(scans(3), StopConfig(max_sweeps=10, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps'))
    before, take = worker.result, Refinement.take
    monkeypatch.setattr(Refinement, 'take', lambda *a, **b: go_on.wait(30.0) and take(*a, **b))
    worker.refine(scans(4), ENDLESS)
    until(lambda: worker.status.state == 'indexing')
    started = time.monotonic()
    worker.close()
    assert time.monotonic() - started > 0.9
    assert worker.running  # so it was not waited for
    assert worker.result is before
    started = time.monotonic()
    worker.close()  # as a node does that is destroyed after it finished
    assert time.monotonic() - started < 0.5
    assert said[1:] == ['stopped while the index was being built']
    go_on.set()
    until(lambda: not worker.running)


def test_a_bug_is_not_swallowed(monkeypatch):
    def broken(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(Refinement, 'map', broken)
    worker = RefineWorker(CONFIG)
    worker.refine(scans(3), ENDLESS)
    until(lambda: worker.failure is not None)
    assert isinstance(worker.failure, ZeroDivisionError)
    worker.close()
    assert not worker.running


def test_orders_from_all_sides_leave_nothing_behind(make):
    """The last order wins, whatever came before it, and the thread ends when it is told."""
    worker, some = make(map_every_s=0.0), [scans(3), scans(4)]
    rng = np.random.default_rng(7)
    for action in rng.integers(0, 4, 120):
        if action == 0:
            worker.stop()
        elif action == 1:
            worker.clear()
        else:
            worker.refine(some[action - 2], ENDLESS)
        time.sleep(float(rng.random()) * 0.004)
    worker.clear()
    worker.refine(some[1], StopConfig(max_sweeps=20, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps'))
    assert worker.result.scans == 4
    assert worker.result.draws == 30
    worker.close()
    assert not [thread for thread in threading.enumerate() if thread.name == 'refine']
