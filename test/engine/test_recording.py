"""What is kept for sampling, by scans, seconds, beams and memory; what is refused."""

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import (
    PatchConfig,
    RecordingConfig,
    SamplerConfig,
    WindowConfig,
)
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.sampling import RayWindow

SECOND = 1_000_000_000


def at(x, *ranges, stamp_s=0.0, y=0.01, **changes):
    scan = fan(*(ranges or (1.0, 2.0, 3.0)), stamp_ns=round(stamp_s * SECOND), **changes)
    return PlacedScan(scan, PoseBelief(Pose2D(x + 0.01, y)))


def kept(recording):
    return [round(p.scan.stamp_ns / SECOND) for p in recording.snapshot()]


@pytest.mark.parametrize(
    ('limits', 'expected'),
    [
        ({}, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]),
        ({'max_scans': 3}, [7, 8, 9]),
        ({'max_seconds': 4.0}, [5, 6, 7, 8, 9]),
        ({'max_rays': 7}, [8, 9]),
        ({'max_rays': 1}, [9]),
        ({'max_rays': 12, 'max_seconds': 2.0}, [7, 8, 9]),
    ],
)
def test_the_oldest_go(limits, expected):
    recording = Recording(RecordingConfig(**limits))
    for i in range(10):
        recording.add(at(0.0, stamp_s=i))
    assert kept(recording) == expected
    assert recording.n_rays == 3 * len(expected)
    assert recording.let_go == 10 - len(expected)
    recording.clear()
    assert (len(recording), recording.n_rays, recording.let_go) == (0, 0, 0)


@pytest.mark.parametrize('patch', [PatchConfig(), PatchConfig(size=9, margin=4)])
@pytest.mark.parametrize('stride', [1, 2])
def test_the_size_is_that_of_the_window_of_what_is_kept(patch, stride):
    """Rays are counted exactly; the box is the very window; pairs and memory are upper bounds."""
    config = SamplerConfig(window=WindowConfig(resolution=0.1, beam_stride=stride), patch=patch)
    recording = Recording(RecordingConfig(max_scans=6), config)
    rng = np.random.default_rng(3)
    for i in range(40):
        ranges = rng.uniform(0.2, 5.0, 8)
        ranges[rng.random(8) < 0.2] = np.nan
        where = float(rng.uniform(-4.0, 4.0))
        recording.add(at(where, *ranges, y=where / 3, increment=0.7, stamp_s=i))
        window = RayWindow(config.window, config.model, margin=patch.window_margin)
        window.add(recording.snapshot())
        assert recording.size.rays == window.index.n_rays
        assert recording.size.box == window.spec.box
        assert window.index.n_pairs <= recording.size.pairs <= 1.3 * window.index.n_pairs + 10
        assert recording.size.n_bytes <= 1e6 * config.window.max_memory_mb


def test_memory_is_a_limit_like_the_others():
    config = SamplerConfig(window=WindowConfig(resolution=0.01, max_memory_mb=1.0))
    recording = Recording(RecordingConfig(), config)
    for i in range(60):
        recording.add(at(0.0, *[5.0] * 20, increment=0.003, stamp_s=i))
        assert recording.size.n_bytes <= 1_000_000
    assert 3 < len(recording) < 10
    assert kept(recording) == list(range(60))[-len(recording) :]
    assert recording.let_go == 60 - len(recording)


def test_a_stray_pose_drives_nobody_out():
    config = SamplerConfig(window=WindowConfig(resolution=0.1, max_memory_mb=1.0))
    recording = Recording(RecordingConfig(), config)
    for i in range(5):
        recording.add(at(0.2 * i, stamp_s=i))
    size = recording.size
    with pytest.raises(GridError, match=r'need a window of \d+ MB: expected at most max_memory_'):
        recording.add(at(5000.0, y=5000.0, stamp_s=5))
    with pytest.raises(GridError, match='too far from the map'):
        recording.add(at(1e300, stamp_s=6))
    assert kept(recording) == [0, 1, 2, 3, 4]
    assert (recording.size, recording.let_go) == (size, 0)
    # A long walk, on the other hand, leaves behind what lies too far back.
    for i in range(400):
        recording.add(at(0.8 * i, stamp_s=10 + i, y=0.8 * i))
    assert 10 < len(recording) < 300
    assert kept(recording)[-1] == 409


def test_scans_that_say_nothing_take_no_room():
    recording = Recording(RecordingConfig(), SamplerConfig())
    recording.add(at(0.0, np.nan, -1.0))
    assert (len(recording), recording.n_rays, recording.size.n_bytes) == (1, 2, 0)
