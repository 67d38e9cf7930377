"""The worker without ROS: what it hands over, keeps, forgets and writes, and when."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from support.workers import CONFIG, ENDLESS, idle, scans, until

from ogm_mcmc.config import StopConfig
from ogm_mcmc.config.nodes import NodeWindowConfig
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.geometry import PlacedScan, Pose2D

# What has a deadline here is compiled before the clock runs.
pytestmark = pytest.mark.usefixtures('compiled')


def test_the_last_map_is_what_the_core_samples(make):
    said: list[str] = []
    worker = make(map_every_s=0.0, log=said.append)
    limits = StopConfig(max_sweeps=40, r_hat=0.0)
    assert worker.result is None
    assert worker.refine(scans(6), limits) is False
    until(lambda: idle(worker, 'sweeps'))
    core = Refinement(CONFIG)
    core.take(scans(6))
    list(core.run(limits))
    result = worker.result
    assert result.final
    assert (result.scans, result.stamp_ns, result.draws) == (6, 1_000_000_005, 70)
    assert np.array_equal(
        result.grid_map.probability, core.known_map().probability, equal_nan=True
    )
    progress = worker.status.progress
    assert progress.sweeps == 40
    assert said[-1].startswith(
        f'refined 6 scans in {progress.seconds:.1f} s: 40 sweeps of each of 2 chains'
    )
    assert said[-1].endswith(' (sweeps)')
    assert f'{100.0 * progress.agreeing_share:.1f} % of the informed cells agree' in said[-1]
    samples = result.samples
    assert 1 <= samples.draws <= 64
    assert samples.spec == core.window.spec
    told = np.isfinite(result.grid_map.probability)  # of the others the samples say nothing new
    assert np.array_equal(samples.known, told)
    assert 0 < np.count_nonzero(told) < core.sampler.model.touched.size
    last = core.sampler.states[0].cells.reshape(samples.known.shape)  # of the last round
    bits = [samples.words[:, :, 0] >> np.uint64(s) & np.uint64(1) for s in range(64)]
    assert any(np.array_equal(cells * told, last * told) for cells in bits)
    assert (worker.status.scans, worker.status.rays) == (6, 144)
    assert worker.status.n_bytes > worker.status.index_bytes > worker.status.rays * 15


def test_refining_again_replaces_what_is_at_work_and_keeps_its_map(make):
    worker = make(map_every_s=0.0)
    first = scans(6)
    worker.refine(first, ENDLESS)
    until(lambda: worker.result is not None and worker.result.draws > 20)
    before = worker.result.number
    assert worker.refine([*first, *scans(2, start=6)], ENDLESS) is True
    until(lambda: worker.status.scans == 8 and worker.status.state == 'sampling')
    # In the burn-in of the new run the old map stays; then a better one comes.
    until(lambda: worker.result.scans == 8)
    assert worker.result.number > before
    assert worker.result.draws >= 2


def test_the_map_of_before_a_correction_is_replaced_soon(make):
    """Scans that were placed anew: a few sweeps of the burn-in say more than a wrong map."""
    worker = make(
        config=replace(CONFIG, chain=replace(CONFIG.chain, burn_in=10**7)), map_every_s=0.01
    )
    some = scans(6)
    worker.refine(some, ENDLESS)
    until(lambda: worker.result is not None and worker.status.progress.sweeps > 5)
    column = worker.result.grid_map.spec.column0
    moved = [PlacedScan.at(one.scan, Pose2D(0.3, 0.1).compose(one.pose)) for one in some]
    worker.refine(moved, ENDLESS)
    until(lambda: worker.result.grid_map.spec.column0 == column + 3)
    assert worker.status.progress.counted == 0


def test_the_first_map_is_renewed_before_any_sweep_counts(make):
    worker = make(
        config=replace(CONFIG, chain=replace(CONFIG.chain, burn_in=10**7)), map_every_s=0.0
    )
    worker.refine(scans(6), ENDLESS)
    until(lambda: worker.result is not None and worker.result.number > 3)
    assert worker.status.progress.counted == 0
    worker.stop()
    until(lambda: idle(worker, 'stopped'))
    assert worker.result.final


def test_a_run_that_is_replaced_after_a_few_sweeps_leaves_the_map_of_before(make, monkeypatch):
    worker, limits = make(map_every_s=1e6), StopConfig(max_sweeps=40, r_hat=0.0)
    worker.refine(scans(6), limits)
    until(lambda: idle(worker, 'sweeps'))
    before, run = worker.result, Refinement.run

    def few_sweeps(self, stop, cancelled):
        *_, last = run(self, StopConfig(max_sweeps=8, r_hat=0.0))
        until(cancelled)
        yield last._replace(reason='cancelled')

    monkeypatch.setattr(Refinement, 'run', few_sweeps)
    worker.refine(scans(7), limits)
    until(lambda: worker.status.state == 'sampling')
    monkeypatch.undo()
    worker.refine(scans(8), limits)
    until(lambda: idle(worker, 'sweeps') and worker.status.scans == 8)
    # One as soon as a sweep counts and the last one, both of the third order.
    assert (worker.result.number, worker.result.scans) == (before.number + 2, 8)


def test_the_same_scans_go_on_counting(make):
    worker, some = make(), scans(4)
    worker.refine(some, StopConfig(max_sweeps=30, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps'))
    worker.refine(list(some), StopConfig(max_sweeps=30, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps') and worker.status.progress.sweeps == 60)
    assert worker.status.progress.counted == 55


def test_the_status_knows_of_the_chains_while_an_index_is_built(make, monkeypatch):
    """An order that comes meanwhile goes on from them, and can say so."""
    worker, some = make(), scans(5)
    stop = StopConfig(max_sweeps=30, max_time=1e6, r_hat=0.0)
    worker.refine(some[:4], stop)
    until(lambda: worker.status.stopped == 'sweeps')
    assert worker.status.chain_sweeps == 30
    building, go_on, take = threading.Event(), threading.Event(), Refinement.take

    def slowly(self, scans, **how):
        building.set()
        assert go_on.wait(20.0)
        return take(self, scans, **how)

    monkeypatch.setattr(Refinement, 'take', slowly)
    worker.refine(some, stop)
    assert building.wait(20.0)
    assert (worker.status.state, worker.status.chain_sweeps) == ('indexing', 30)
    assert worker.status.progress is None
    go_on.set()
    until(lambda: worker.status.stopped == 'sweeps')
    assert (worker.status.scans, worker.status.chain_sweeps) == (5, 60)
    worker.clear()
    until(lambda: worker.status.chain_sweeps == 0)


def test_stop_brings_a_last_map_at_once(make):
    worker = make(map_every_s=1e6)
    assert worker.stop() is False
    worker.refine(scans(6), ENDLESS)
    until(lambda: worker.status.progress is not None and worker.status.progress.counted > 10)
    assert worker.result.number == 1
    assert worker.stop() is True
    until(lambda: idle(worker, 'stopped'), 2.0)
    assert worker.result.number == 2
    assert worker.result.final


def test_cleared_is_cleared(make):
    """No map of before may come back, neither from the run at work nor as a warm start."""
    worker, some = make(map_every_s=0.0), scans(6)
    worker.refine(some, ENDLESS)
    until(lambda: worker.result is not None)
    worker.clear()
    assert worker.result is None
    worker.refine(some, StopConfig(max_sweeps=7, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps'))
    assert worker.status.progress.sweeps == 7
    assert worker.result.draws == 4  # two sweeps count, and the last map is of these alone
    worker.clear()
    until(lambda: worker.status.stopped == '')
    time.sleep(0.05)
    assert worker.result is None


def test_state_is_written_when_asked_and_at_the_end(make, tmp_path):
    state, said = tmp_path / 'chains.npz', []
    some, limits = scans(6), StopConfig(max_sweeps=30, r_hat=0.0)
    worker = make(state_file=state, log=said.append)
    worker.save_state()  # nothing yet: no file
    worker.refine(some, ENDLESS)
    # Before any sweep counts, the last map would be the one from before.
    until(lambda: worker.status.progress is not None and worker.status.progress.counted > 0)
    assert not state.exists()
    worker.save_state()
    until(state.exists)
    worker.close()
    assert worker.status.stopped == 'shut down'
    assert worker.result.final
    at_end = worker.status.progress.sweeps

    other = make(state_file=state, log=said.append)
    other.refine(scans(6), limits)
    until(lambda: idle(other, 'sweeps'))
    assert other.status.progress.sweeps == at_end + 30
    assert said[0] == f'continues from {state}'
    assert said[1].startswith('refined 6 scans')
    assert len(said) == 2

    third = make(state_file=state, log=said.append)
    third.refine(scans(5), limits)
    until(lambda: idle(third, 'sweeps'))
    assert third.status.progress.sweeps == 30
    assert said[-2].startswith(f'starts new chains: {state}: ')


def test_what_no_return_means_is_said_once(make):
    """The share of the beams is another one with every scan: nothing new."""
    said, limits = [], StopConfig(max_sweeps=10, r_hat=0.0)
    worker = make(config=replace(CONFIG, window=NodeWindowConfig(resolution=0.1)), log=said.append)
    some = scans(8)
    for k, placed in enumerate(some):
        ranges = placed.scan.ranges_m.copy()
        ranges[k % 2 :: 2 + k % 3] = np.inf
        some[k] = PlacedScan(replace(placed.scan, ranges_m=ranges), placed.belief)
    shares = set()
    for count in (4, 6, 8):
        worker.refine(some[:count], limits)
        until(lambda n=count: worker.status.scans == n and idle(worker, 'sweeps'))
        shares.add(worker.status.no_return.found.share)
    assert len(shares) == 3
    told = [line.split(',')[0] for line in said if not line.startswith('refined ')]
    assert told == ['no_return auto: ignore']


def test_what_is_yet_to_be_forgotten_is_not_told(make, monkeypatch):
    """An order right after `clear` begins anew, also while the thread is still at the last one."""
    go_on, held = threading.Event(), threading.Event()
    run = Refinement.run

    def waits(refinement, *limits):
        for progress in run(refinement, *limits):
            yield progress
            held.set()
            go_on.wait(20.0)

    monkeypatch.setattr(Refinement, 'run', waits)
    worker = make()
    worker.refine(scans(3), ENDLESS)
    assert held.wait(20.0)
    assert worker.status.chain_sweeps > 0
    worker.clear()
    assert worker.status.chain_sweeps == 0
    assert worker.status.understood == (None, None)
    worker.refine(scans(4), StopConfig(max_sweeps=10, r_hat=0.0))
    assert worker.status.chain_sweeps == 0
    go_on.set()
    until(lambda: idle(worker, 'sweeps'))
    assert worker.status.chain_sweeps == 10
