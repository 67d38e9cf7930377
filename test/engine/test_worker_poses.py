"""The worker where poses are refined, too."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import ROOM, noisy_drive
from support.workers import CONFIG, ENDLESS, idle, until

from ogm_mcmc.config import PosesConfig, StopConfig, TrajectoryConfig
from ogm_mcmc.config.nodes import NodeModelConfig
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.kept_poses import WAITS
from ogm_mcmc.engine.poses_beside import PosesBeside
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.sensor_fit import fit_sensor
from ogm_mcmc.engine.worker import RefineWorker
from ogm_mcmc.errors import WindowError
from ogm_mcmc.evaluation import confusion_counts
from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.trajectory.points import xyyaw

# What has a deadline here is compiled before the clock runs.
pytestmark = pytest.mark.usefixtures('compiled')


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
    limits, found, sensor = StopConfig(max_sweeps=60, max_time=30.0, r_hat=0.0), {}, {}
    chain = replace(CONFIG.chain, sensor='fitted')
    config = replace(CONFIG, model=NodeModelConfig(), chain=chain)
    for poses in ('fixed', 'joint'):
        settings = PosesConfig(poses, TrajectoryConfig(draws=10))
        worker = make(config=config, poses=settings, map_every_s=100.0)
        worker.refine(placed, limits)
        until(lambda worker=worker: worker.status.state == 'idle' and worker.result, 60.0)
        found[poses] = worker.result
        assert worker.status.stopped == 'sweeps'
        sensor[poses] = worker.status.sensor
    # What the beams are like is found at the poses of the end, not at those they came with.
    assert sensor['fixed'] == fit_sensor(placed, config)[1]
    assert sensor['joint'] == fit_sensor(worker._runner._poses.placed(placed), config)[1]
    assert sensor['joint'].sigma.high_95 < sensor['fixed'].sigma.low_95
    low, spread, high = found['joint'].trajectory.points
    assert 0.0 < low < spread < high < 0.05
    assert found['fixed'].trajectory is None
    trajectory = found['joint'].trajectory
    poses = xyyaw([belief.mean for belief in trajectory.beliefs])
    assert absolute_errors(poses, truth).distance_m.mean() < 0.01
    assert trajectory.stamps_ns == list(range(1, 17))
    moved = trajectory.correction.compose(placed[-1].pose)
    assert moved.x_m == pytest.approx(trajectory.beliefs[-1].mean.x_m)
    assert wall_f1(found['joint']) > wall_f1(found['fixed']) + 0.04


LIMITS = StopConfig(max_sweeps=12, max_time=1e6, r_hat=0.0)
JOINT = PosesConfig('joint', TrajectoryConfig(draws=2))


class Gate:
    """Holds poses back until it is opened, or they are no longer wanted."""

    def __init__(self, monkeypatch):
        self.opened, self.begun = threading.Event(), []
        run = PoseRefinement.run

        def held(refinement, max_time_s=np.inf, cancelled=None):
            if cancelled is None:
                yield from run(refinement)
                return
            self.begun.append(refinement)
            while not self.opened.wait(0.002) and not cancelled():
                pass
            if not cancelled():
                yield from run(refinement, max_time_s, cancelled)

        monkeypatch.setattr(PoseRefinement, 'run', held)


@pytest.fixture
def gate(monkeypatch):
    return Gate(monkeypatch)


def waits(worker):
    """Whether all that can be done at the given poses is done, and shown."""
    return worker.status.state == 'refining poses' and worker.result is not None


def alone(placed):
    """Poses of scans as they are estimated by themselves."""
    poses = PoseRefinement(placed, JOINT.trajectory)
    for _ in poses.run():
        pass
    return poses


def poses_in(result):
    return [belief.mean for belief in result.trajectory.beliefs]


def test_a_map_at_the_given_poses_comes_first_and_chains_go_on_at_joint_ones(make, gate):
    said, (_, placed) = [], noisy_drive()
    worker = make(poses=JOINT, map_every_s=0.0, log=said.append)
    worker.refine(placed, LIMITS)
    until(lambda: waits(worker))
    first = worker.result
    assert first.trajectory is None
    assert not first.final
    assert worker.status.poses_of_map == 'as given; joint ones are being estimated'
    core = Refinement(CONFIG)
    core.take(placed)
    list(core.run(LIMITS))
    shown = core.known_map(core.sampler.present_estimate())
    assert np.array_equal(first.grid_map.probability, shown.probability, equal_nan=True)
    gate.opened.set()
    until(lambda: idle(worker, 'sweeps'))
    assert worker.result.final
    assert poses_in(worker.result) == alone(placed).estimator.trajectory()
    assert all(belief.covariance is not None for belief in worker.result.trajectory.beliefs)
    assert worker.status.poses_of_map == 'joint'
    assert worker.status.progress.sweeps == 12  # limits count from there
    assert worker.status.chain_sweeps == 24  # of chains that went on
    assert [line.split(' after ')[0] for line in said if 'after' in line] == ['poses joint']
    assert '16 scans moved by ' in next(line for line in said if 'poses joint' in line)
    before = worker.result.number
    worker.refine(list(placed), LIMITS)
    until(lambda: idle(worker, 'sweeps') and worker.result.number > before)
    assert worker.status.progress.sweeps == 24  # nothing to estimate: the same chains count on
    assert len(gate.begun) == 1


def test_chains_rest_while_poses_are_estimated(make, gate, monkeypatch):
    monkeypatch.setattr('ogm_mcmc.engine.order_runner.RESTS_AT', 3)
    _, placed = noisy_drive()
    worker = make(poses=JOINT)
    worker.refine(placed, ENDLESS)
    until(lambda: waits(worker))
    assert 3 <= worker.status.progress.counted < 1000
    gate.opened.set()
    until(lambda: worker.result.trajectory is not None)
    # At joint poses they do not: neither for the draws of deviations nor afterwards.
    until(lambda: worker.status.progress.counted > 10)


def test_stopping_meanwhile_leaves_the_map_of_then_and_what_was_found(make, gate, tmp_path):
    state, (_, placed) = tmp_path / 'chains.npz', noisy_drive()
    worker = make(poses=JOINT, state_file=state)
    worker.refine(placed, ENDLESS)
    until(lambda: worker.result is not None and gate.begun)
    assert worker.stop()
    until(lambda: idle(worker, 'stopped'))
    assert worker.result.final
    assert worker.result.trajectory is None
    assert not state.exists()  # chains at these poses are not what is gone on with
    gate.opened.set()
    worker.refine(placed, LIMITS)
    until(lambda: idle(worker, 'sweeps'))
    assert poses_in(worker.result) == alone(placed).estimator.trajectory()
    assert gate.begun[0] is gate.begun[1]  # gone on with
    assert state.exists()


def test_clearing_meanwhile_forgets_poses_too(make, gate):
    _, placed = noisy_drive()
    worker = make(poses=JOINT)
    worker.refine(placed, ENDLESS)
    until(lambda: worker.result is not None and gate.begun)
    worker.clear()
    until(lambda: worker.status.state == 'idle' and worker.status.poses_of_map == '')
    gate.opened.set()
    assert worker.result is None
    worker.refine(placed, LIMITS)
    until(lambda: idle(worker, 'sweeps'))
    assert worker.result.trajectory is not None
    assert gate.begun[0] is not gate.begun[1]


def test_scans_that_came_since_lie_beside_those_estimated(make, gate):
    """What was estimated is shown at once; the next estimate is of all of them."""
    _, placed = noisy_drive()
    worker = make(poses=JOINT)
    gate.opened.set()
    worker.refine(placed[:12], LIMITS)
    until(lambda: idle(worker, 'sweeps'))
    found = worker._runner._poses.placed(placed[:12])
    gate.opened.clear()
    worker.refine(placed, LIMITS)
    until(lambda: worker.status.scans == 16 and waits(worker) and worker.result.scans == 16)
    assert worker.status.poses_of_map == 'joint; joint ones are being estimated'
    assert worker.result.trajectory is not None
    now = worker._runner._refinement._taken
    assert all(one is other for one, other in zip(now[:12], found, strict=True))
    correction = found[11].pose.compose(placed[11].pose.inverse())
    assert [one.pose for one in now[12:]] == [correction.compose(one.pose) for one in placed[12:]]
    gate.opened.set()
    until(lambda: idle(worker, 'sweeps') and worker.result.final)
    assert poses_in(worker.result) == alone(placed).estimator.trajectory()


@pytest.mark.parametrize('when', ['meanwhile', 'afterwards'])
def test_a_correction_is_shown_and_poses_are_estimated_from_there(make, gate, when):
    _, placed = noisy_drive()
    worker = make(poses=JOINT)
    if when == 'afterwards':
        gate.opened.set()
    worker.refine(placed, LIMITS)
    until(lambda: idle(worker, 'sweeps') if when == 'afterwards' else waits(worker))
    gate.opened.clear()
    step = Pose2D(0.5, -0.2, 0.1)
    moved = [PlacedScan(one.scan, one.belief.carried_to(step.compose(one.pose))) for one in placed]
    worker.refine(moved, LIMITS)
    until(lambda: len(gate.begun) == 2 and waits(worker) and worker.result.trajectory is None)
    assert [one.pose for one in worker._runner._refinement._taken] == [one.pose for one in moved]
    gate.opened.set()
    until(lambda: idle(worker, 'sweeps') and worker.result.final)
    assert poses_in(worker.result) == alone(moved).estimator.trajectory()


def test_poses_that_are_being_corrected_are_not_estimated_until_they_are_settled(make, gate):
    said, (_, placed) = [], noisy_drive()
    gate.opened.set()
    worker = make(poses=JOINT, log=said.append)
    for _ in range(2):
        worker.refine(placed, ENDLESS, settled=False)
        until(lambda: worker.status.progress and worker.status.progress.counted > 40)  # no rest
    assert gate.begun == []
    assert worker.status.poses_of_map == 'as given; joint ones wait until no scan is moved'
    assert [line.split(':')[0] for line in said] == [WAITS.split(':')[0]]
    worker.refine(placed, LIMITS)
    until(lambda: idle(worker, 'sweeps'))
    assert worker.result.trajectory is not None


def test_time_for_poses_is_part_of_the_time(make, gate):
    said, (_, placed) = [], noisy_drive()
    worker = make(poses=JOINT, log=said.append)
    worker.refine(placed, replace(LIMITS, max_time=0.5))
    until(lambda: idle(worker, 'sweeps'))
    assert worker.result.final
    assert worker.result.trajectory is None
    assert len(gate.begun) == 1
    assert said[-1].startswith('the map lies at the poses given: joint ones were not there yet')


def test_the_end_does_not_wait_for_poses(gate):
    worker = RefineWorker(CONFIG, JOINT)
    worker.refine(noisy_drive()[1], ENDLESS)
    until(lambda: worker.result is not None and gate.begun)
    worker.close()
    assert not worker.running
    assert worker.result.final
    assert not [thread for thread in threading.enumerate() if thread.name == 'poses']


def test_chains_at_joint_poses_are_resumed_after_a_restart(make, gate, tmp_path):
    state, (_, placed) = tmp_path / 'chains.npz', noisy_drive()
    gate.opened.set()
    first = make(poses=JOINT, state_file=state)
    first.refine(placed, LIMITS)
    until(lambda: idle(first, 'sweeps'))
    first.close()
    said = []
    gate.opened.clear()
    other = make(poses=JOINT, state_file=state, log=said.append)
    other.refine([PlacedScan(*one) for one in placed], LIMITS)
    until(lambda: waits(other))
    assert said == []  # that the file is not of the given poses is nothing to tell
    gate.opened.set()
    until(lambda: idle(other, 'sweeps'))
    assert other.status.progress.sweeps == 24
    assert said[0] == f'continues from {state}'


@pytest.mark.parametrize(
    ('error', 'said'),
    [(MemoryError(), 'no memory'), (np.linalg.LinAlgError('singular'), 'singular')],
)
def test_poses_that_cannot_be_estimated_leave_the_map_at_those_given(
    make, monkeypatch, error, said
):
    warned = []

    def fails(*_, **__):
        raise error

    monkeypatch.setattr('ogm_mcmc.engine.poses_beside.PoseRefinement', fails)
    worker = make(poses=JOINT, warn=warned.append)
    worker.refine(noisy_drive()[1], LIMITS)
    until(lambda: idle(worker, 'sweeps'))
    assert warned == [f'poses not estimated: {said}']
    assert worker.result.final


def test_joint_poses_that_cannot_be_sampled_leave_the_map_at_those_given(make, monkeypatch):
    warned, (_, placed) = [], noisy_drive()
    take = Refinement.take

    def refuses(refinement, scans, *args, **options):
        if scans[0].pose != placed[0].pose:
            raise WindowError('too far apart')
        return take(refinement, scans, *args, **options)

    monkeypatch.setattr(Refinement, 'take', refuses)
    worker = make(poses=JOINT, warn=warned.append)
    for _ in range(2):
        worker.refine(placed, LIMITS)
        until(lambda: idle(worker, 'sweeps') and worker.result.final)
        assert worker.result.trajectory is None
    assert set(warned) == {'joint poses not used: too far apart'}


def test_a_bug_in_poses_is_not_swallowed(monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr('ogm_mcmc.engine.poses_beside.PoseRefinement', broken)
    worker = RefineWorker(CONFIG, JOINT)
    worker.refine(noisy_drive()[1], ENDLESS)
    until(lambda: worker.failure is not None)
    assert isinstance(worker.failure, ZeroDivisionError)
    worker.close()


def test_poses_are_gone_on_with_past_scans_that_were_never_begun(gate):
    told, (_, placed) = threading.Event(), noisy_drive()
    beside = PosesBeside(JOINT.trajectory, None, told.set)
    beside.want(placed)
    assert beside.moves
    beside.begin(1e6)
    until(lambda: gate.begun)
    beside.want(placed[:8])
    beside.want(placed)
    gate.opened.set()
    assert beside.moves
    beside.begin(1e6)
    assert told.wait(20.0)
    until(lambda: not beside.moves or beside.found)
    assert gate.begun[1] is gate.begun[0]
    assert beside.take().given is placed
    until(lambda: beside.found or not beside.awaited)
    beside.take()
    beside.want(placed)
    assert not beside.awaited  # all is done
    beside.close(20.0)
