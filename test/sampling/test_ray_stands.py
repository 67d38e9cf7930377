"""Scans of a robot that stands and jitters are taken from one pose, and nearly nothing is lost."""

import math

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, RayWindow
from ogm_mcmc.sampling.ray_stands import GRAIN, settled

CONFIG = WindowConfig(resolution=0.2)
REACH_M = 5.0
GRAIN_M = GRAIN * CONFIG.resolution
MODEL = ForwardModelConfig(sigma=0.1)
PLACE = Pose2D(4.4 * GRAIN_M, 3.6 * GRAIN_M, 0.3)


def jittering(count, size_m, seed=1, place=PLACE):
    rng = np.random.default_rng(seed)
    scans = []
    for _ in range(count):
        ranges = 2.0 + 0.5 * np.cos(np.arange(16)) + rng.normal(0.0, 0.02, 16)
        scan = fan(*ranges, bearing=-3.0, increment=0.37, range_max_m=REACH_M)
        dx, dy, turn = size_m * rng.uniform(-1.0, 1.0, 3)
        pose = Pose2D(place.x_m + dx, place.y_m + dy, place.yaw_rad + turn / REACH_M)
        scans.append(PlacedScan.at(scan, pose))
    return scans


def window_of(scans, merge=True, pieces=1000):
    limits = CellBox(-28, -28, 28, 28)
    window = RayWindow(CONFIG, MODEL, merge=merge, limits=limits)
    for at in range(0, len(scans), pieces):
        window.add(scans[at : at + pieces])
    return window


def test_the_first_scan_of_a_place_says_where_the_others_are():
    scans = jittering(20, 1e-6)
    taken, new = settled(scans, {}, CONFIG)
    assert {placed.pose for placed in taken} == {scans[0].pose} == set(new.values())
    assert [placed.scan for placed in taken] == [placed.scan for placed in scans]
    assert taken[0] is scans[0]
    again, more = settled(scans[::-1], new, CONFIG)
    assert {placed.pose for placed in again} == {scans[0].pose}
    assert more == {}


def test_scans_of_a_drive_stay_where_they_are():
    step = 1.01 * GRAIN_M
    scans = [one._replace(belief=one.belief._replace(mean=Pose2D(step * i, 0.0, 0.3)))
             for i, one in enumerate(jittering(30, 0.0))]  # fmt: skip
    turn = 1.01 * GRAIN_M / REACH_M
    scans += [one._replace(belief=one.belief._replace(mean=Pose2D(-1.0, 0.0, turn * i)))
              for i, one in enumerate(jittering(30, 0.0))]  # fmt: skip
    taken, _ = settled(scans, {}, CONFIG)
    assert all(before is after for before, after in zip(scans, taken, strict=True))


def test_no_end_of_a_beam_moves_further_than_said():
    scans = jittering(200, 3.0 * GRAIN_M)
    taken, new = settled(scans, {}, CONFIG)
    moved = []
    for before, after in zip(scans, taken, strict=True):
        bearing = before.scan.bearings()
        ends = [
            complex(pose.x_m, pose.y_m) + REACH_M * np.exp(1j * (pose.yaw_rad + bearing))
            for pose in (before.pose, after.pose)
        ]
        moved.append(np.abs(ends[1] - ends[0]).max())
    assert 0.5 * GRAIN_M < max(moved) < (math.sqrt(2.0) + 1.0) * GRAIN_M
    # Jitter has a bounded number of places, however long it goes on.
    assert len(new) < 7**3
    _, more = settled(jittering(2000, 1.5 * GRAIN_M, seed=2), {}, CONFIG)
    assert len(more) <= 4**3


def test_a_robot_that_jitters_costs_what_one_that_stands_costs():
    still, shaken = (window_of(jittering(60, size_m), pieces=7) for size_m in (0.0, 1e-6))
    for name, mine, theirs in zip(still.index._fields, shaken.index, still.index, strict=True):
        if name != 'rays' and mine.dtype != np.float32:
            assert mine.shape == theirs.shape, name
    assert shaken.n_merged == still.n_merged > 0.9 * still.n_beams
    assert shaken.index.n_bytes == still.index.n_bytes


def test_maps_are_as_likely_as_with_every_pose_to_the_last_bit():
    scans = jittering(40, 1e-5)
    merged, exact = window_of(scans, pieces=9), window_of(scans, merge=False)
    assert exact.n_merged == 0
    rng = np.random.default_rng(3)
    maps = [(rng.random(exact.index.n_cells) < share).astype(np.uint8)
            for share in (0.0, 0.02, 0.1) for _ in range(4)]  # fmt: skip
    said = []
    for window in (merged, exact):
        model = CellModel(window.index, math.log(0.2 / 0.8), window.spec.width)
        said.append(np.array([model.log_likelihood(model.start(cells)) for cells in maps]))
    # Nats a beam, of up to twelve between maps.
    assert np.abs(said[0] - said[1]).max() / exact.n_beams < 2e-3


def test_a_place_is_that_of_scans_of_one_reach():
    """Two sensors at one spot, of 3 and 5 m: .9 and .54 rad are as many turns of theirs."""
    here = [Pose2D(0.0, 0.0, yaw) for yaw in (0.9, 0.9 * 3.0 / 5.0)]
    scans = [
        PlacedScan.at(fan(1.0, increment=0.1, range_max_m=reach_m), pose)
        for pose, reach_m in zip(here, (3.0, 5.0), strict=True)
    ]
    taken, new = settled(scans, {}, CONFIG)
    assert [placed.pose for placed in taken] == here == list(new.values())


def test_a_window_that_refuses_scans_has_not_seen_their_places():
    window = window_of([])
    scans = jittering(2, 1e-6)
    endless = fan(1.0, 2.0, bearing=0.0, increment=0.1, range_max_m=math.inf)
    with pytest.raises(GridError, match='range_max'):
        window.add([scans[0], PlacedScan.at(endless, PLACE)])
    window.add(scans[1:])
    assert window._stands.popitem()[1] == scans[1].pose


def test_a_pose_beyond_all_windows_is_refused_as_ever():
    far = PlacedScan.at(jittering(1, 0.0)[0].scan, Pose2D(1e308, 0.0, 0.0))
    with pytest.raises(GridError):
        window_of([far])
