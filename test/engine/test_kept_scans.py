"""A live map made anew at corrected poses: the loop that closes, scans that come meanwhile."""

import threading
import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.corrections import Corrector, Nodes
from ogm_mcmc.engine.kept_scans import KeptScans
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.simulation import WORLDS, Driving, Lidar, drive, rasterised, true_ranges

CONFIG = MapperConfig(resolution=0.1)


@pytest.fixture(scope='module')
def loop():
    """A tour of the office whose poses drift until it is back."""
    building = WORLDS['office']()
    lidar = Lidar(beams=120, noise_m=0.01)
    bearings = lidar.bearings()
    driving = Driving(
        rate_hz=2.0, speed_m_s=1.0, turn_rad_s=3.0, drift=0.3, drifting=True, stand_s=0.0
    )
    rng = np.random.default_rng(4)
    return building, list(
        drive(lambda p: true_ranges(building.walls, p, bearings), building.waypoints, lidar,
              driving, rng)
    )  # fmt: skip


def nodes_of(corrected):
    rows = [(p.x_m, p.y_m, p.yaw_rad) for p in corrected.poses]
    return Nodes(np.array(corrected.stamps_ns, np.int64), np.array(rows))


def mapped(scans, config=CONFIG):
    pipeline = MappingPipeline(config)
    for placed in scans:
        pipeline.update(placed)
    return pipeline


def f1_of(pipeline, building):
    """F1 of the cells that are measured, occupied from 0.5 on."""
    truth = rasterised(building, CONFIG.resolution)
    box = truth.spec.box
    grid = pipeline.map().windowed(box)
    known = np.isfinite(grid.probability) & np.isfinite(truth.probability)
    called, is_wall = grid.probability[known] >= 0.5, truth.probability[known] >= 0.5
    hits = (called & is_wall).sum()
    return 2.0 * hits / (called.sum() + is_wall.sum())


def waited(kept, config=CONFIG):
    began = time.monotonic()
    while (remade := kept.taken(config)) is None:
        assert time.monotonic() - began < 60.0
        time.sleep(0.005)
    return remade


def test_a_loop_that_closes_makes_the_map_as_from_true_poses(loop):
    """Doubled walls before; after the correction F1 is within 0.01 of that from true poses."""
    building, scans = loop
    said = [PlacedScan.at(one.scan, one.said) for one in scans]
    kept, live = KeptScans(100.0), mapped(said)
    for placed in said:
        kept.add(placed)
    kept.correct(nodes_of(scans[-1].corrected), CONFIG)
    remade = waited(kept)
    assert remade.corrected.covered == len(scans)
    assert remade.corrected.moved > 0.8 * len(scans)
    assert remade.scans == len(scans)
    best = f1_of(mapped(PlacedScan.at(one.scan, one.truth) for one in scans), building)
    assert f1_of(live, building) < best - 0.2
    assert f1_of(remade.pipeline, building) > best - 0.01
    live.take_over(remade.pipeline)
    assert live.scans_used == len(scans)
    assert np.array_equal(
        live.map().probability, remade.pipeline.map().probability, equal_nan=True
    )


def test_scans_that_come_while_the_map_is_made_anew_are_in_it(loop):
    _, scans = loop
    early, late = scans[:100], scans[100:110]
    kept = KeptScans(100.0)
    for one in early:
        kept.add(PlacedScan.at(one.scan, one.said))
    true = [PlacedScan.at(one.scan, one.truth) for one in early]
    rows = [(p.pose.x_m, p.pose.y_m, p.pose.yaw_rad) for p in true]
    nodes = Nodes(np.array([p.scan.stamp_ns for p in true], np.int64), np.array(rows))
    assert not kept.busy
    kept.correct(nodes, CONFIG)
    assert kept.busy
    for one in late:
        kept.add(PlacedScan.at(one.scan, one.truth))
    remade = waited(kept)
    assert (remade.scans, kept.busy) == (110, False)
    placed = kept.recording.snapshot()
    assert len(placed) == 110
    same = mapped(placed)
    assert np.array_equal(
        same.map().probability, remade.pipeline.map().probability, equal_nan=True
    )
    # The same trajectory once more moves nothing, and nothing is made.
    kept.correct(nodes, CONFIG)
    again = waited(kept)
    assert (again.pipeline, again.corrected.moved, again.scans) == (None, 0, 0)
    assert kept.taken(CONFIG) is None


def test_a_newer_trajectory_waits_for_the_map_in_the_making_and_clear_ends_it(loop):
    _, scans = loop
    kept = KeptScans(100.0)
    for one in scans:
        kept.add(PlacedScan.at(one.scan, one.said))
    nodes = nodes_of(scans[-1].corrected)
    aside = Nodes(nodes.stamps_ns, nodes.poses + np.array([5.0, 0.0, 0.0]))
    far = Nodes(nodes.stamps_ns, nodes.poses + np.array([50.0, 0.0, 0.0]))
    for one in (aside, far, nodes):
        kept.correct(one, CONFIG)
    first, last = waited(kept), waited(kept)
    assert first.pipeline.map().spec.origin_x_m > 4.0
    assert last.pipeline.map().spec.origin_x_m < 1.0  # the one in between was never made
    assert (kept.taken(CONFIG), kept.busy) == (None, False)
    kept.correct(aside, CONFIG)
    kept.clear()
    assert (kept.taken(CONFIG), kept.busy, len(kept.recording)) == (None, False, 0)
    kept.correct(nodes, CONFIG)
    assert waited(kept).corrected.covered == 0


def test_trajectories_of_parts_are_all_applied(loop):
    """Only one that a later trajectory covers is never looked at."""
    _, scans = loop
    kept = KeptScans(100.0)
    for one in scans:
        kept.add(PlacedScan.at(one.scan, one.said))
    nodes = nodes_of(scans[-1].corrected)
    middle = nodes.stamps_ns.size // 2
    early = Nodes(nodes.stamps_ns[:middle], nodes.poses[:middle] + np.array([5.0, 0.0, 0.0]))
    late = Nodes(nodes.stamps_ns[middle:], nodes.poses[middle:] + np.array([9.0, 0.0, 0.0]))
    for one in (nodes, early, late):
        kept.correct(one, CONFIG)
    waited(kept)
    waited(kept)
    assert not kept.busy
    moved = [
        b.pose.x_m - a.truth.x_m for a, b in zip(scans, kept.recording.snapshot(), strict=True)
    ]
    assert np.median(moved[: len(scans) // 3]) == pytest.approx(5.0, abs=0.1)
    assert np.median(moved[-len(scans) // 3 :]) == pytest.approx(9.0, abs=0.1)


def test_placing_does_not_hold_up_the_node(loop, monkeypatch):
    _, scans = loop
    kept, go_on = KeptScans(100.0), threading.Event()
    for one in scans[:20]:
        kept.add(PlacedScan.at(one.scan, one.said))
    applied = Corrector.applied

    def slowly(self, *rest):
        assert go_on.wait(20.0)
        return applied(self, *rest)

    monkeypatch.setattr(Corrector, 'applied', slowly)
    kept.correct(nodes_of(scans[-1].corrected), CONFIG)
    kept.add(PlacedScan.at(scans[20].scan, scans[20].said))  # while scans are being placed
    assert kept.taken(CONFIG) is None
    go_on.set()
    assert waited(kept).scans == len(kept.recording) == 21


def same_map(one, other):
    return np.array_equal(one.map().probability, other.map().probability, equal_nan=True)


@pytest.mark.parametrize('waits', [False, True])
def test_settings_that_change_while_a_map_is_made_are_those_of_the_next_one(loop, waits):
    """Whether a trajectory waits, which moves nothing any more, or not."""
    _, scans = loop
    nearer = replace(CONFIG, max_range=2.0)
    kept = KeptScans(100.0)
    for one in scans[:60]:
        kept.add(PlacedScan.at(one.scan, one.said))
    nodes = nodes_of(scans[-1].corrected)
    kept.correct(nodes, CONFIG)
    if waits:
        kept.correct(nodes, nearer)
    else:
        kept.add(PlacedScan.at(scans[60].scan, scans[60].said))
    first = waited(kept, nearer)
    assert kept.busy
    last = waited(kept, nearer)
    assert not kept.busy
    expected = mapped(kept.recording.snapshot(), nearer)
    assert same_map(last.pipeline, expected)
    assert not same_map(first.pipeline, expected)
    assert first.pipeline.config == last.pipeline.config == nearer
    assert first.scans == last.scans == len(kept.recording)
    assert first.corrected.moved > 0
    assert last.corrected.covered == 60
    assert last.corrected.moved == (0 if waits else first.corrected.moved)


def test_a_trajectory_that_waits_is_made_with_the_settings_that_hold_then(loop):
    _, scans = loop
    nearer = replace(CONFIG, max_range=2.0)
    kept = KeptScans(100.0)
    for one in scans[:60]:
        kept.add(PlacedScan.at(one.scan, one.said))
    nodes = nodes_of(scans[-1].corrected)
    aside = Nodes(nodes.stamps_ns, nodes.poses + np.array([5.0, 0.0, 0.0]))
    kept.correct(aside, CONFIG)
    kept.correct(nodes, CONFIG)
    waited(kept, nearer)
    last = waited(kept, nearer)
    assert same_map(last.pipeline, mapped(kept.recording.snapshot(), nearer))
    assert (kept.taken(nearer), kept.busy) == (None, False)


def test_what_waits_is_done_after_a_failure(loop, monkeypatch):
    _, scans = loop
    kept = KeptScans(100.0)
    for one in scans[:20]:
        kept.add(PlacedScan.at(one.scan, one.said))
    applied = Corrector.applied

    def broken(self, *rest):
        monkeypatch.setattr(Corrector, 'applied', applied)
        raise RuntimeError('broken')

    monkeypatch.setattr(Corrector, 'applied', broken)
    nodes = nodes_of(scans[-1].corrected)
    for _ in range(2):
        kept.correct(nodes, CONFIG)
    with pytest.raises(RuntimeError, match='broken'):
        waited(kept)
    assert waited(kept).corrected.covered == 20


def test_what_goes_wrong_in_the_thread_is_seen(loop, monkeypatch):
    _, scans = loop
    kept = KeptScans(100.0)
    for one in scans[:50]:
        kept.add(PlacedScan.at(one.scan, one.said))

    def broken(self, scans, cancelled):
        raise RuntimeError('broken')

    monkeypatch.setattr(MappingPipeline, 'update_all', broken)
    kept.correct(nodes_of(scans[-1].corrected), CONFIG)
    with pytest.raises(RuntimeError, match='broken'):
        waited(kept)


def test_memory_of_scans_is_a_limit(loop):
    """Whatever it is used for: ranges, bearings, covariances, particles."""
    _, scans = loop
    plain = PlacedScan.at(scans[0].scan, scans[0].truth)
    cloud = PoseSamples.checked(np.zeros((50, 3)))
    bent = replace(plain.scan, bearings_rad=plain.scan.bearings())
    doubted = PlacedScan(bent, PoseBelief(plain.pose, np.eye(3), cloud))
    more = 120 * 8 + 9 * 8 + 50 * 4 * 8
    assert more < doubted.n_bytes - plain.n_bytes < more + 500
    room_for_poses = 512 * 32
    assert 256 < len(scans) <= 512
    kept = KeptScans((60 * plain.n_bytes + room_for_poses) / 1e6)
    for one in scans:
        kept.add(PlacedScan.at(one.scan, one.truth))
        assert kept.n_bytes <= kept.most_bytes
    assert kept.n_bytes == kept.recording.n_bytes + room_for_poses
    assert 50 <= len(kept.recording) <= 60
    assert kept.recording.n_bytes == sum(one.n_bytes for one in kept.recording.snapshot())
    assert len(kept.recording) + kept.recording.let_go.total() == len(scans)
    assert len(kept.corrector.track) == len(scans)
    kept.clear()
    assert kept.recording.n_bytes == 0


def test_poses_take_a_quarter_of_the_memory_at_most():
    kept = KeptScans(0.1)
    for k in range(4000):
        kept.add(PlacedScan.at(fan(1.0, stamp_ns=k * 10**9), Pose2D(float(k))))
        assert kept.n_bytes <= kept.most_bytes
    assert 12_500 < kept.corrector.track.n_bytes <= 25_000
    assert kept.recording.n_bytes > 50_000
    assert kept.corrector.track.spans(np.array([10**9, 3990 * 10**9])).all()


def test_what_scans_take_is_what_is_counted():
    def made(k):
        scan = fan(*np.linspace(1.0, 2.0, 200), increment=0.01, stamp_ns=10**18 + k)
        belief = PoseBelief(Pose2D(0.1 * k, 0.3 * k, 0.2), np.eye(3) * k)
        return PlacedScan(scan, belief)

    tracemalloc.start()
    scans = [made(k) for k in range(200)]
    took, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sum(one.n_bytes for one in scans) == pytest.approx(took, rel=0.25)
