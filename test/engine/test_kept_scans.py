"""A live map made anew at corrected poses: the loop that closes, scans that come meanwhile."""

import time

import numpy as np
import pytest

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.corrections import Nodes
from ogm_mcmc.engine.kept_scans import KeptScans
from ogm_mcmc.geometry import PlacedScan
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


def waited(kept):
    began = time.monotonic()
    while (remade := kept.taken()) is None:
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
    corrected = kept.correct(nodes_of(scans[-1].corrected), CONFIG)
    assert corrected.covered == len(scans)
    assert corrected.moved > 0.8 * len(scans)
    remade = waited(kept)
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
    assert kept.correct(nodes, CONFIG).moved > 0
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
    assert kept.correct(nodes, CONFIG).moved == 0
    assert kept.taken() is None


def test_a_newer_trajectory_waits_for_the_map_in_the_making_and_clear_ends_it(loop):
    _, scans = loop
    kept = KeptScans(100.0)
    for one in scans:
        kept.add(PlacedScan.at(one.scan, one.said))
    nodes = nodes_of(scans[-1].corrected)
    aside = Nodes(nodes.stamps_ns, nodes.poses + np.array([5.0, 0.0, 0.0]))
    far = Nodes(nodes.stamps_ns, nodes.poses + np.array([50.0, 0.0, 0.0]))
    for one in (aside, far, nodes):
        assert kept.correct(one, CONFIG).moved > 0
    first, last = waited(kept), waited(kept)
    assert first.pipeline.map().spec.origin_x_m > 4.0
    assert last.pipeline.map().spec.origin_x_m < 1.0  # the one in between was never made
    assert (kept.taken(), kept.busy) == (None, False)
    kept.correct(aside, CONFIG)
    kept.clear()
    assert (kept.taken(), kept.busy, len(kept.recording)) == (None, False, 0)
    assert kept.correct(nodes, CONFIG).covered == 0


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


def test_memory_for_ranges_is_a_limit(loop):
    _, scans = loop
    kept = KeptScans(1.0)
    kept.recording.configure(kept.recording.config.__class__(max_rays=120 * 60))
    for one in scans:
        kept.add(PlacedScan.at(one.scan, one.truth))
    assert len(kept.recording) <= 60
    assert len(kept.recording) + kept.recording.let_go.total() == len(scans)
    assert len(kept.corrector.track) == len(scans)
