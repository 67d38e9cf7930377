"""The worker without ROS: what it hands over, keeps, forgets and writes, and when."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import ROOM, noisy_drive

from ogm_mcmc.config import (
    ChainConfig,
    PosesConfig,
    SamplerConfig,
    StopConfig,
    TrajectoryConfig,
    WindowConfig,
)
from ogm_mcmc.config.nodes import NodeWindowConfig
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.warm_up import warm_up_poses, warm_up_sampling
from ogm_mcmc.engine.worker import RefineWorker
from ogm_mcmc.errors import WindowError
from ogm_mcmc.evaluation import confusion_counts
from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.trajectory.points import xyyaw

CONFIG = SamplerConfig(
    window=WindowConfig(resolution=0.1), chain=ChainConfig(burn_in=5, start='free')
)
ENDLESS = StopConfig(max_sweeps=10**8, max_time=1e6, r_hat=0.0)


def scans(count, beams=24, start=0):
    """Scans of a round room of 1 m, from places along a line."""
    angles = 2.0 * np.pi * np.arange(beams) / beams
    result = []
    for i in range(start, start + count):
        x = 0.02 * i
        ranges = -x * np.cos(angles) + np.sqrt(1.0 - (x * np.sin(angles)) ** 2)
        scan = Scan.checked(
            ranges.astype(np.float32),
            angle_min_rad=0.0,
            angle_increment_rad=2.0 * np.pi / beams,
            range_min_m=0.0,
            range_max_m=3.0,
            stamp_ns=1_000_000_000 + i,
        )
        result.append(PlacedScan(scan, PoseBelief(Pose2D(x + 0.03, 0.04))))
    return result


def until(condition, timeout_s=20.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, 'not in time'
        time.sleep(0.002)


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile what has a deadline here before the clock runs."""
    warm_up_sampling(CONFIG)
    assert warm_up_poses() > 2


@pytest.fixture
def make():
    """Make workers that are closed whatever happens."""
    made = []

    def one(**options):
        made.append(RefineWorker(options.pop('config', CONFIG), **options))
        return made[-1]

    yield one
    for worker in made:
        worker.close()
        assert not worker.running
        assert worker.failure is None


def idle(worker, stopped):
    return worker.status.state == 'idle' and worker.status.stopped == stopped


def test_the_last_map_is_what_the_core_samples(make):
    worker, limits = make(map_every_s=0.0), StopConfig(max_sweeps=40, r_hat=0.0)
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
    assert worker.status.progress.sweeps == 40
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
    assert worker.status.n_bytes > worker.status.rays * 15


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
    assert (worker.result.number, worker.result.scans) == (before.number + 1, 8)


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

    def slowly(self, scans):
        building.set()
        assert go_on.wait(20.0)
        return take(self, scans)

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
    assert said == [f'not refined: {worker.status.error}']
    assert worker.status.no_return.value == 'clear'  # as asked: the recording can go by it
    assert worker.result is before
    worker.refine(scans(4), StopConfig(max_sweeps=5, r_hat=0.0))
    until(lambda: idle(worker, 'error') and 'max_sweeps is 5' in worker.status.error)
    worker.refine(scans(4), StopConfig(max_sweeps=10, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps') and worker.status.error == '')


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
    until(state.exists, 2.0)
    worker.close()
    assert worker.status.stopped == 'shut down'
    assert worker.result.final
    at_end = worker.status.progress.sweeps

    other = make(state_file=state, log=said.append)
    other.refine(scans(6), limits)
    until(lambda: idle(other, 'sweeps'))
    assert other.status.progress.sweeps == at_end + 30
    assert said == [f'continues from {state}']

    third = make(state_file=state, log=said.append)
    third.refine(scans(5), limits)
    until(lambda: idle(third, 'sweeps'))
    assert third.status.progress.sweeps == 30
    assert said[-1].startswith(f'starts new chains: {state}: ')


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
    assert [line.split(',')[0] for line in said] == ['no_return auto: ignore']


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
    assert said == ['not refined: no patch fits']
    worker.refine(some, limits)
    until(lambda: idle(worker, 'sweeps'))
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
    worker, said, go_on = RefineWorker(CONFIG), [], threading.Event()
    worker.log = said.append
    worker.refine(scans(3), StopConfig(max_sweeps=10, r_hat=0.0))
    until(lambda: idle(worker, 'sweeps'))
    before, take = worker.result, Refinement.take
    monkeypatch.setattr(Refinement, 'take', lambda *a: go_on.wait(30.0) and take(*a))
    worker.refine(scans(4), ENDLESS)
    until(lambda: worker.status.state == 'indexing')
    started = time.monotonic()
    worker.close()
    assert time.monotonic() - started > 0.9
    assert worker.running  # so it was not waited for
    assert worker.result is before
    assert said == ['stopped while the index was being built']
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


def wall_f1(result):
    """Best F1 of a map, walls being the cells that one runs through."""
    spec = result.grid_map.spec
    x = spec.origin_x_m - 0.05 + (np.arange(spec.width) + 0.5) * spec.resolution_m
    y = (spec.origin_y_m - 0.05 + (np.arange(spec.height) + 0.5) * spec.resolution_m)[:, None]
    nearest = np.full((spec.height, spec.width), np.inf)
    for ax, ay, bx, by in ROOM:
        dx, dy = bx - ax, by - ay
        along = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - ax - along * dx, y - ay - along * dy))
    walls = nearest <= 0.45 * spec.resolution_m
    inside = (x > -0.3) & (x < 6.3) & (y > -0.3) & (y < 4.3)
    probability = np.nan_to_num(result.grid_map.probability, nan=0.0)[inside]
    return confusion_counts(probability, walls[inside]).best().f1


def test_joint_poses_make_a_better_map_within_the_deadline(make):
    truth, placed = noisy_drive()
    limits, found = StopConfig(max_sweeps=60, max_time=30.0, r_hat=0.0), {}
    for poses in ('fixed', 'joint'):
        settings = PosesConfig(poses, TrajectoryConfig(draws=10))
        worker = make(poses=settings, map_every_s=100.0)
        worker.refine(placed, limits)
        until(lambda worker=worker: worker.status.state == 'idle' and worker.result, 60.0)
        found[poses] = worker.result
        assert worker.status.stopped == 'sweeps'
    assert found['fixed'].trajectory is None
    trajectory = found['joint'].trajectory
    poses = xyyaw([belief.mean for belief in trajectory.beliefs])
    assert absolute_errors(poses, truth).distance_m.mean() < 0.01
    assert trajectory.stamps_ns == list(range(1, 17))
    moved = trajectory.correction.compose(placed[-1].pose)
    assert moved.x_m == pytest.approx(trajectory.beliefs[-1].mean.x_m)
    assert wall_f1(found['joint']) > wall_f1(found['fixed']) + 0.04


def test_poses_are_refined_no_longer_than_half_of_the_time_and_gone_on_with(make):
    _, placed = noisy_drive()
    # So many draws would take minutes.
    settings = PosesConfig('joint', TrajectoryConfig(draws=10_000))
    worker = make(poses=settings)
    worker.refine(placed, StopConfig(max_sweeps=10**8, max_time=1.0, r_hat=0.0))
    until(lambda: idle(worker, 'time'), 60.0)
    first, refinement = worker.status.poses, worker._poses.refinement
    # Half a second, and the round of draws in which it was over.
    assert 0.5 <= first.seconds < 30.0
    chains = worker._refinement.sampler
    worker.refine(placed, StopConfig(max_sweeps=10**8, max_time=1.0, r_hat=0.0))
    until(lambda: worker._refinement.sampler is not chains and idle(worker, 'time'), 60.0)
    # Not begun anew: the clock of the same estimator went on.
    assert worker._poses.refinement is refinement
    assert worker.status.poses.seconds > first.seconds + 0.5


def test_stopping_while_poses_are_refined_leaves_a_map_of_then(make):
    _, placed = noisy_drive()
    worker = make(poses=PosesConfig('joint', TrajectoryConfig(draws=10_000)))
    worker.refine(placed, ENDLESS)
    until(lambda: worker.status.poses is not None)
    assert worker.stop()
    until(lambda: idle(worker, 'stopped'))
    assert worker.result.final
    assert len(worker.result.trajectory.beliefs) == 16
    worker.clear()
    until(lambda: worker.status.poses is None)
    assert worker.result is None
