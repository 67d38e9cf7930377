"""Scans are kept by what was found of beams, and those go that an index has no room for."""

import itertools
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan
from support.workers import CONFIG, idle, until

from ogm_mcmc.config import (
    ForwardModelConfig,
    KeepConfig,
    RecordingConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.config.nodes import NodeModelConfig
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowFullError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow

pytestmark = pytest.mark.usefixtures('compiled')

FOUND = replace(
    CONFIG,
    model=NodeModelConfig(sigma=0.0, grazing=-1.0),
    window=WindowConfig(0.1, max_memory_mb=1),
)
ONCE = StopConfig(max_sweeps=6, r_hat=0.0)


def noisy():
    """Scans of a square room, readings that err by more than sigma is when nobody has looked."""
    rng = np.random.default_rng(3)
    bearings = np.linspace(-math.pi, math.pi, 60, endpoint=False)
    while True:
        x, y, yaw = rng.uniform(-1.5, 1.5, 3)
        ux, uy = np.cos(bearings + yaw), np.sin(bearings + yaw)
        ranges = np.minimum(
            (2.0 - np.sign(ux) * x) / np.abs(ux), (2.0 - np.sign(uy) * y) / np.abs(uy)
        )
        ranges = np.maximum(ranges + rng.normal(0.0, 0.25, 60), 0.05)
        scan = fan(*ranges, bearing=bearings[0], increment=bearings[1] - bearings[0])
        yield PlacedScan.at(scan, Pose2D(x, y, yaw))


def along_a_wall():
    """Scans along a wall that fills its cells in part, which most beams graze."""
    bearings = math.pi / 2.0 + math.radians(2.0) * np.arange(-40, 41)
    for number in itertools.count():
        y = 0.495 - 0.017 * (number % 30)
        scan = fan(
            *(1.095 - y) / np.sin(bearings), bearing=bearings[0], increment=math.radians(2.0)
        )
        yield PlacedScan.at(scan, Pose2D(0.013 * (number % 61), y, 1e-3 * number))


def filled(come, config, keep='coverage'):
    """A recording into which scans come until it is full, by sigma as it is set."""
    recording = Recording(RecordingConfig(KeepConfig(keep)), config)
    for placed in come:
        recording.add(placed)
        if recording.let_go:
            return recording
    raise AssertionError('expected to be full')


def needed(recording, model):
    """Bytes of a window of what is kept."""
    window = RayWindow(FOUND.window, model)
    return window.sum_of_sizes(recording.snapshot()).n_bytes


@pytest.mark.parametrize('keep', ['coverage', 'latest'])
@pytest.mark.parametrize('come', [noisy, along_a_wall])
def test_what_was_recorded_is_sampled_whatever_is_found(make, come, keep):
    """Sigma or grazing that is found makes the index larger than scans were kept for."""
    recording = filled(come(), FOUND, keep)
    asked, warned = len(recording), []
    worker = make(config=FOUND, warn=warned.append)
    worker.refine(recording.snapshot(), ONCE, recording)
    until(lambda: worker.status.state == 'idle' and worker.status.stopped)
    status = worker.status
    assert (status.error, status.stopped) == ('', 'sweeps')
    assert len(recording) == asked  # the worker has a copy
    assert needed(recording, status.model) > 1e6
    assert 1 < status.scans < asked
    assert status.scans + status.left_out == asked
    assert worker.result.scans == status.scans
    assert warned == [
        f'{status.scans} of {asked} scans sampled: window.max_memory_mb is too small'
    ]
    # The recording lets go about what the worker did, and says so; then what is left is sampled.
    recording.understand(*status.understood)
    assert status.scans <= len(recording) < asked
    assert f'sigma {status.model.sigma:.3g}' in str(recording.values())
    worker.refine(recording.snapshot(), ONCE, recording)
    until(lambda: worker.status is not status and idle(worker, 'sweeps'))
    assert worker.status.left_out < 0.2 * status.left_out  # what fewer say is a little different


def test_sizes_follow_what_was_found_last():
    recording = filled(noisy(), FOUND)
    before, sizes = len(recording), []
    for sigma, grazing in ((0.2, 0.0), (0.21, 0.0), (0.02, 0.0), (0.02, 0.1)):
        model = replace(FOUND.model, sigma=sigma, grazing=grazing)
        recording.understand(None, model)
        sizes.append(needed(recording, model))
        assert recording.size.n_bytes <= 1e6
        if sigma != 0.21:  # no more than a tenth is not counted anew
            assert recording.size.n_bytes == sizes[-1]
    assert len(recording) < before
    assert sizes[2] < sizes[1]
    assert recording.copy().values() == recording.values()
    assert Recording(RecordingConfig()).fewer([], None, ForwardModelConfig()) == []


def test_a_last_scan_that_is_too_large_is_refused(make):
    placed = PlacedScan.at(fan(*[80.0] * 24, increment=0.25, range_max_m=90.0), Pose2D())
    recording = Recording(RecordingConfig())
    recording.add(placed)
    worker = make(config=FOUND)
    worker.refine([placed], ONCE, recording)
    until(lambda: idle(worker, 'error'))
    assert 'expected at most max_memory_mb = 1' in worker.status.error


@pytest.mark.parametrize(('reason', 'max_time'), [('stopped', 1e6), ('time', 0.01)])
def test_choosing_fewer_scans_ends_when_it_is_told_to(make, monkeypatch, reason, max_time):
    said, tries, worker = [], [], None
    recording, take = filled(noisy(), FOUND), Refinement.take

    def full(refinement, scans, **how):
        tries.append(len(scans))
        if len(tries) == 1:
            return take(refinement, scans[:3], **how)
        if reason == 'stopped':
            worker.stop()
        else:
            time.sleep(2.0 * max_time)
        raise WindowFullError('full')

    monkeypatch.setattr(Refinement, 'take', full)
    worker = make(config=FOUND, log=said.append)
    worker.refine(recording.snapshot(), ONCE, recording)
    until(lambda: idle(worker, 'sweeps'))
    before = worker.result
    worker.refine(recording.snapshot(), replace(ONCE, max_time=max_time), recording)
    until(lambda: idle(worker, reason))
    assert len(tries) == 2
    assert said[-1] == f'ended while scans were chosen that an index has room for ({reason})'
    assert worker.result is before


def test_chains_that_no_index_was_left_for_are_counted_no_more(make, monkeypatch, tmp_path):
    """Nor is the state file, which is of an earlier time, read for those that follow."""
    said, some = [], list(itertools.islice(noisy(), 8))
    worker = make(config=FOUND, state_file=tmp_path / 'chains.npz', log=said.append)
    recording = Recording(RecordingConfig(), FOUND)
    for one in some:
        recording.add(one)
    worker.refine(some[:6], ONCE)
    until(lambda: idle(worker, 'sweeps'))
    posterior = Refinement._posterior

    def fails(refinement, *rest):
        monkeypatch.setattr(Refinement, '_posterior', posterior)
        raise WindowFullError('full')

    monkeypatch.setattr(Refinement, '_posterior', fails)
    worker.refine(some, ONCE, recording)
    until(lambda: idle(worker, 'sweeps') and worker.status.left_out)
    assert worker.status.chain_sweeps == ONCE.max_sweeps
    assert not [line for line in said if 'chains.npz' in line]
