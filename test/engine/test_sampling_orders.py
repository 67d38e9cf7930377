"""Orders of recorded scans: corrections leave time to sample, and to find poses."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.workers import CONFIG, scans

from ogm_mcmc.config import RecordingConfig, StopConfig
from ogm_mcmc.engine import sampling_orders
from ogm_mcmc.engine.correction_rhythm import CORRECTING_S, QUIET_S
from ogm_mcmc.engine.corrections import Nodes
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.sampling_orders import SamplingOrders

LIMITS = StopConfig(max_time=30.0)
SCANS = 12


class Clock:
    """The monotonic clock, set by hand."""

    def __init__(self, monkeypatch):
        self.now_s = 1000.0
        stand_in = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(sampling_orders, 'time', stand_in)


class NotedOrders:
    """In place of a worker: notes what it is ordered to do."""

    def __init__(self):
        self.wanted = False
        self.places, self.left_s, self.settled, self.kept = [], [], [], []
        self.drifting = []

    def refine(self, some, stop, kept, *, settled, drifting):
        replaced, self.wanted = self.wanted, True
        self.places.append(round(some[0].pose.y_m, 2))
        self.left_s.append(stop.max_time)
        self.settled.append(settled)
        self.drifting.append(drifting)
        self.kept.append(kept)
        return replaced

    def stop(self):
        stopped, self.wanted = self.wanted, False
        return stopped

    def clear(self):
        self.wanted = False


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.fixture
def orders(clock):
    del clock
    recording = Recording(RecordingConfig(), CONFIG)
    made = SamplingOrders(NotedOrders(), recording, recording.snapshot, StopConfig())
    for placed in scans(SCANS):
        recording.add(placed)
        made.corrector.note(placed)
    return made


def moved_to(orders, y_m):
    """Have a trajectory place all recorded scans there; return how many moved."""
    recorded = orders.recording.snapshot()
    stamps = np.array([one.scan.stamp_ns for one in recorded])
    poses = np.array([(0.02 * k + 0.03, y_m, 0.0) for k in range(len(recorded))])
    return orders.correct(Nodes(stamps, poses), CONFIG.window.resolution).moved


def test_the_first_correction_counts_at_once_and_the_next_ones_together(orders, clock):
    assert not orders.sample(LIMITS)
    for y_m in (0.5, 1.0, 1.5):
        clock.now_s += 1.0
        assert moved_to(orders, y_m) == SCANS
        orders.sample_corrected()
    assert orders.worker.places == [0.04, 0.5]
    assert round(orders.recording.snapshot()[0].pose.y_m, 2) == 1.5
    clock.now_s += CORRECTING_S - 2.0
    orders.sample_corrected()
    assert orders.worker.places == [0.04, 0.5, 1.5]
    assert orders.worker.kept == [orders.recording] * 3
    # What was said of the time holds, however often scans are corrected.
    assert orders.worker.left_s == pytest.approx([30.0, 29.0, 30.0 - 1.0 - CORRECTING_S])
    assert orders.limits == LIMITS


def test_poses_of_odometry_drift_until_a_trajectory_corrects_them(orders, clock):
    orders.drifts = lambda: True
    orders.sample(LIMITS)
    clock.now_s += 1.0
    moved_to(orders, 0.5)
    orders.clear()
    orders.sample(LIMITS)
    assert orders.worker.drifting == [True, False, True]


def test_scans_that_hardly_moved_are_no_reason_to_begin_anew(orders, clock):
    orders.sample(LIMITS)
    clock.now_s += CORRECTING_S
    assert moved_to(orders, 0.04 + 0.2 * CONFIG.window.resolution) == 0
    orders.sample_corrected()
    assert len(orders.worker.places) == 1


@pytest.mark.parametrize('why', ['never asked for', 'stopped', 'cleared', 'time is up'])
def test_nothing_is_sampled_that_is_not_wanted(orders, clock, why):
    if why != 'never asked for':
        orders.sample(LIMITS)
    count = len(orders.worker.places)
    if why == 'stopped':
        assert orders.stop()
        assert not orders.stop()
    elif why == 'cleared':
        orders.clear()
        assert len(orders.corrector.track) == 0
    elif why == 'time is up':
        clock.now_s += LIMITS.max_time
    moved_to(orders, 0.5)
    clock.now_s += max(CORRECTING_S, QUIET_S)
    orders.sample_corrected()
    assert len(orders.worker.places) == count


def test_poses_are_estimated_once_the_trajectory_is_quiet(orders, clock):
    moved_to(orders, 0.5)
    clock.now_s += 1.0
    orders.sample(StopConfig(max_time=1e6))
    orders.sample_corrected()
    assert orders.worker.settled == [False]
    clock.now_s += QUIET_S - 1.0
    for _ in range(3):
        orders.sample_corrected()
    assert orders.worker.settled == [False, True]  # ordered once more, once
