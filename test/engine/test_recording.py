"""What is kept for sampling, by scans, seconds, beams and memory; what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import (
    ForwardModelConfig,
    KeepConfig,
    PatchConfig,
    RecordingConfig,
    SamplerConfig,
    WindowConfig,
)
from ogm_mcmc.config.nodes import NodeWindowConfig
from ogm_mcmc.engine.no_returns import NoReturnChoice, NoReturns
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.sampling import RayWindow

SECOND = 1_000_000_000
LATEST = KeepConfig(keep='latest')


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
    recording = Recording(RecordingConfig(window=LATEST, **limits))
    for i in range(10):
        recording.add(at(0.0, stamp_s=i))
    assert kept(recording) == expected
    assert recording.n_rays == 3 * len(expected)
    assert recording.let_go.total() == 10 - len(expected)
    recording.clear()
    assert (len(recording), recording.n_rays, recording.let_go.total()) == (0, 0, 0)


@pytest.mark.parametrize('patch', [PatchConfig(), PatchConfig(size=9, margin=4)])
@pytest.mark.parametrize('stride', [1, 2])
@pytest.mark.parametrize('keep', ['latest', 'coverage'])
def test_the_size_is_that_of_the_window_of_what_is_kept(patch, stride, keep):
    """Rays are counted exactly; the box is the very window; pairs and memory are upper bounds."""
    config = SamplerConfig(window=WindowConfig(resolution=0.1, beam_stride=stride), patch=patch)
    recording = Recording(RecordingConfig(KeepConfig(keep), max_scans=6), config)
    rng = np.random.default_rng(3)
    for i in range(40):
        ranges = rng.uniform(0.2, 5.0, 8)
        ranges[rng.random(8) < 0.2] = np.nan
        where = float(rng.uniform(-4.0, 4.0))
        recording.add(at(where, *ranges, y=where / 3, increment=0.7, stamp_s=i))
        window = RayWindow(config.window, config.model, margin=patch.window_margin)
        window.add(recording.snapshot())
        assert len(recording) <= 6
        assert recording.n_rays == sum(p.scan.ranges_m.size for p in recording.snapshot())
        assert recording.size.rays == window.index.n_rays
        assert recording.size.box == window.spec.box
        assert window.index.n_pairs <= recording.size.pairs <= 1.3 * window.index.n_pairs + 10
        assert recording.size.n_bytes <= 1e6 * config.window.max_memory_mb


def test_memory_is_a_limit_like_the_others():
    config = SamplerConfig(window=WindowConfig(resolution=0.01, max_memory_mb=1.0))
    recording = Recording(RecordingConfig(LATEST), config)
    for i in range(60):
        recording.add(at(0.0, *[5.0] * 20, increment=0.003, stamp_s=i))
        assert recording.size.n_bytes <= 1_000_000
    assert 10 < len(recording) < 60
    assert kept(recording) == list(range(60))[-len(recording) :]
    assert recording.let_go == {'older': 60 - len(recording)}


def test_likelihoods_beside_the_index_are_counted_where_cells_are_drawn_one_by_one():
    gaussian = ForwardModelConfig(kind='gaussian')
    zones, sizes = [], []
    for model, patch in (
        (gaussian, PatchConfig()),
        (gaussian, PatchConfig(size=9)),
        (ForwardModelConfig(), PatchConfig()),
    ):
        recording = Recording(
            RecordingConfig(LATEST, max_scans=2), SamplerConfig(model, patch=patch)
        )
        for i in range(4):
            recording.add(at(0.5 * i, stamp_s=i))
        recording.understand(NoReturnChoice.of('auto', NoReturns(100, 90)))  # counts anew
        size = recording.size
        zones.append(size.n_bytes - size._replace(zones=0).n_bytes)
        sizes.append(size)
    assert zones == [(24 + 2 * 32) * sizes[0].rays + 8 * sizes[0].pairs, 0, 0]
    assert sizes[0].pairs > 0


def test_beams_that_are_ignored_take_no_memory():
    sampler = SamplerConfig(window=NodeWindowConfig(resolution=0.1))
    recording = Recording(RecordingConfig(), sampler)
    recording.add(at(0.0, 1.0, math.inf, math.inf))
    asked = [recording.size.rays]
    for choice in (
        NoReturnChoice.of('auto', NoReturns(0, 0)),  # not sure: they may come to count
        NoReturnChoice.of('auto', NoReturns(100, 90)),
        None,
        NoReturnChoice.of('auto', NoReturns(100, 10)),
        NoReturnChoice.of('ignore', NoReturns(0, 0)),
    ):
        recording.understand(choice)
        asked.append(recording.size.rays)
    assert asked == [3, 3, 1, 1, 3, 1]
    recording.add(at(0.5, 1.0, math.inf, math.inf))
    assert recording.copy().size.rays == recording.size.rays == 2
    assert recording.let_go.total() == 0
    fresh = Recording(
        RecordingConfig(), replace(sampler, window=NodeWindowConfig(0.1, no_return='ignore'))
    )
    for placed in recording.snapshot():
        fresh.add(placed)
    assert recording.size == fresh.size


def test_beams_that_come_to_count_drive_scans_out_at_once():
    """Without a return they needed no memory while they were ignored."""
    sampler = SamplerConfig(window=NodeWindowConfig(0.1, max_memory_mb=1.0))
    recording = Recording(RecordingConfig(), sampler)
    recording.understand(NoReturnChoice.of('auto', NoReturns(100, 90)))
    for i in range(200):
        recording.add(at(0.02 * i, 1.0, *[math.inf] * 30, stamp_s=i))
    assert len(recording) == 200
    recording.understand(NoReturnChoice.of('auto', NoReturns(100, 10)))
    assert recording.size.n_bytes <= 1e6
    assert 1 < len(recording) < 200
    assert recording.let_go['thinned'] == 200 - len(recording)


def test_what_cannot_be_measured_by_what_was_found_stays_as_it_was():
    """Beams that reach too far, once they count: who samples them says so, no other thread."""
    recording = Recording(RecordingConfig(), SamplerConfig(window=NodeWindowConfig(0.1)))
    recording.understand(NoReturnChoice.of('auto', NoReturns(100, 90)))
    placed = at(0.0, 1.0, math.inf)
    far = replace(placed.scan, range_max_m=20_000.0)
    recording.add(placed)
    recording.add(PlacedScan(far, placed.belief))
    before = recording.size
    assert before.rays == 2
    for _ in range(2):
        recording.understand(NoReturnChoice.of('auto', NoReturns(100, 10)))
        assert recording.size == before
    recording.add(at(0.5, 1.0, math.inf))  # as before, too
    assert recording.size.rays == 3


def test_a_stray_pose_drives_nobody_out():
    config = SamplerConfig(window=WindowConfig(resolution=0.1, max_memory_mb=1.0))
    recording = Recording(RecordingConfig(LATEST), config)
    for i in range(5):
        recording.add(at(0.2 * i, stamp_s=i))
    size = recording.size
    with pytest.raises(GridError, match=r'need a window of \d+ MB: expected at most max_memory_'):
        recording.add(at(5000.0, y=5000.0, stamp_s=5))
    with pytest.raises(GridError, match='too far from the map'):
        recording.add(at(1e300, stamp_s=6))
    assert kept(recording) == [0, 1, 2, 3, 4]
    assert (recording.size, recording.let_go.total()) == (size, 0)
    # A long walk, on the other hand, leaves behind what lies too far back.
    for i in range(400):
        recording.add(at(0.8 * i, stamp_s=10 + i, y=0.8 * i))
    assert 10 < len(recording) < 300
    assert kept(recording)[-1] == 409


def test_scans_that_say_nothing_take_no_room():
    recording = Recording(RecordingConfig(), SamplerConfig())
    recording.add(at(0.0, np.nan, -1.0))
    assert (len(recording), recording.n_rays, recording.size.n_bytes) == (1, 2, 0)


# -- by coverage ----------------------------------------------------------------------------------


def places(recording):
    return sorted({round(p.pose.x_m) for p in recording.snapshot()})


def test_a_robot_that_stands_does_not_push_the_building_out():
    recording = Recording(RecordingConfig(max_scans=50))
    for i in range(40):
        recording.add(at(float(i), stamp_s=i))
    for i in range(2000):
        recording.add(at(40.0, stamp_s=40 + i / 40))
        assert len(recording) <= 50
    assert places(recording) == list(range(41))
    assert recording.let_go.total() == 2040 - len(recording)
    assert recording.let_go['covered'] > 1900
    # One that was there a minute ago and looks again sees what is there now.
    recording.add(at(40.0, stamp_s=200.0))
    assert recording.let_go['renewed'] == 1
    assert recording.snapshot()[-1].scan.stamp_ns == 200 * SECOND


def test_nothing_is_computed_of_a_scan_that_does_not_come_in(monkeypatch):
    recording = Recording(RecordingConfig(max_scans=10), SamplerConfig())
    for i in range(20):
        recording.add(at(0.0, stamp_s=i / 40))
    monkeypatch.setattr(RayWindow, 'size_of', None)
    before = len(recording)
    recording.add(at(0.0, stamp_s=1.0))
    assert len(recording) == before


def test_everything_is_kept_while_there_is_room():
    recording = Recording(RecordingConfig(max_scans=100))
    for i in range(100):
        recording.add(at(0.0, stamp_s=i / 40))
    assert (len(recording), recording.let_go.total()) == (100, 0)
    assert recording.values()['kept'] == 'all: there is room'
    recording.add(at(0.0, stamp_s=3.0))
    values = recording.values()
    assert values['kept'] == 'at most 90 scans of each place of 0.1 m and heading of 0.1 rad'
    assert (values['scans let go'], values['let go: thinned']) == (11, 11)
    # More may come again as soon as the limit is another.
    recording.configure(RecordingConfig(max_scans=200))
    for i in range(100):
        recording.add(at(0.0, stamp_s=4.0 + i / 40))
    assert len(recording) == 190


def test_there_is_room_again_when_scans_became_too_old():
    recording = Recording(RecordingConfig(max_scans=20, max_seconds=10.0))
    for i in range(40):
        recording.add(at(0.0, stamp_s=i / 40))
    assert recording.coverage.most is not None
    recording.add(at(5.0, stamp_s=30.0))
    assert recording.coverage.most is None
    for i in range(10):
        recording.add(at(5.0, stamp_s=30.1 + i / 40))
    assert kept(recording) == [30] * 11


def test_the_memory_of_an_hour_stays_within_its_limit():
    """The limits hold at every moment, the way stays covered, every scan is accounted for."""
    config = SamplerConfig(window=WindowConfig(resolution=0.01, max_memory_mb=1.0))
    recording = Recording(RecordingConfig(max_scans=200, max_rays=500), config)
    for i in range(3000):
        recording.add(at(10.0 + 10.0 * np.sin(i / 100.0), stamp_s=i / 10))
        assert len(recording) <= 200
        assert recording.n_rays <= 500
        assert recording.size.n_bytes <= 1_000_000
        assert len(recording) + recording.let_go.total() == i + 1
    where = sorted(placed.pose.x_m for placed in recording.snapshot())
    assert np.diff([0.0, *where, 20.0]).max() < 2.0 * recording.coverage.cell_m < 2.0


def test_minimum_travel_is_that_of_slam_toolbox():
    window = KeepConfig(minimum_travel_distance=0.45, minimum_travel_heading=0.5)
    recording = Recording(RecordingConfig(window))
    for i in range(21):
        recording.add(at(0.1 * i, stamp_s=i))
    assert [round(p.pose.x_m, 2) for p in recording.snapshot()] == [0.01, 0.51, 1.01, 1.51, 2.01]
    scan = at(2.0, stamp_s=30.0)
    recording.add(PlacedScan.at(scan.scan, Pose2D(2.0, 0.01, 0.6)))
    recording.add(at(2.0, stamp_s=31.0, frame_id='rear'))
    assert len(recording) == 7
    assert recording.let_go == {'too_near': 16}


def test_minimum_travel_is_of_each_sensor_by_itself():
    recording = Recording(RecordingConfig(KeepConfig(minimum_travel_distance=0.45)))
    for i in range(11):
        for frame in ('front', 'rear'):
            recording.add(at(0.1 * i, stamp_s=i, frame_id=frame))
    assert [p.scan.frame_id for p in recording.snapshot()] == ['front', 'rear'] * 3
    recording.clear()
    recording.add(at(1.0, stamp_s=20.0, frame_id='rear'))
    assert len(recording) == 1


# -- corrected ------------------------------------------------------------------------------------


def test_the_same_scans_at_other_poses():
    config = SamplerConfig(window=WindowConfig(resolution=0.1))
    recording, fresh = (Recording(RecordingConfig(), config) for _ in range(2))
    scans = [at(0.3 * i, 1.0, 2.0, np.inf, stamp_s=i, increment=0.5) for i in range(8)]
    moved = [PlacedScan.at(p.scan, Pose2D(p.pose.x_m, 0.5 * i)) for i, p in enumerate(scans)]
    for one, other in zip(scans, moved, strict=True):
        recording.add(one)
        fresh.add(other)
    recording.replace([*scans[:4], *moved[4:]])
    assert recording.snapshot() == [*scans[:4], *moved[4:]]
    recording.replace(moved)
    assert (recording.size, recording.n_rays) == (fresh.size, fresh.n_rays)
    assert recording.let_go.total() == 0
    far = PlacedScan.at(moved[0].scan, Pose2D(9e5, 9e5))
    with pytest.raises(GridError, match='expected what max_memory_mb = 2000 can hold'):
        recording.replace([far, *moved[1:]])
    assert recording.snapshot() == moved


def test_scans_read_anew_stay_in_their_place():
    """A reading that turns out to say nothing needs no memory where such beams are ignored."""
    config = SamplerConfig(window=WindowConfig(resolution=0.1, no_return='ignore'))
    recording, expected = (Recording(RecordingConfig(), config) for _ in range(2))
    for i in range(3):
        recording.add(at(0.2 * i, 1.0, 3.5, stamp_s=i))
        expected.add(at(0.2 * i, 1.0, math.inf if i != 1 else 3.5, stamp_s=i))
    before = recording.snapshot()

    def read(scan):
        if scan.stamp_ns == SECOND:
            return scan
        return replace(scan, ranges_m=np.where(scan.ranges_m == 3.5, np.inf, scan.ranges_m))

    recording.read_anew(read)
    after = recording.snapshot()
    assert [new.scan.ranges_m.tolist() for new in after] == [
        old.scan.ranges_m.tolist() for old in expected.snapshot()
    ]
    assert after[1] is before[1]
    assert (recording.size, recording.n_rays) == (expected.size, 6)
    assert recording.let_go.total() == 0
    recording.read_anew(lambda scan: scan)
    assert all(new is old for new, old in zip(recording.snapshot(), after, strict=True))
