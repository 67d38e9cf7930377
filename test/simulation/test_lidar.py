"""Ranges to walls, exact on paper; noise and lost returns as asked for."""

import itertools
import math

import numpy as np
import pytest

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.simulation import (
    WORLDS,
    Building,
    Lidar,
    rasterised,
    record,
    true_ranges,
    walk,
)

ROOM = np.array([(0, 0, 4, 0), (4, 0, 4, 3), (4, 3, 0, 3), (0, 3, 0, 0)], np.float64)


def test_ranges_in_a_room_on_paper():
    bearings = np.array([0.0, math.pi / 2, math.pi, -math.pi / 2, math.atan2(2, 3)])
    ranges = true_ranges(ROOM, Pose2D(1.0, 1.0), bearings)
    assert ranges == pytest.approx(np.array([3.0, 2.0, 1.0, 1.0, math.sqrt(13)]))
    turned = true_ranges(ROOM, Pose2D(1.0, 1.0, math.pi / 2), bearings[:1])
    assert turned == pytest.approx(np.array([2.0]))


def plain_ranges(walls, pose, bearings):
    """Solve p + r d = a + s (b - a) for all beams and walls at once."""
    heading = pose.yaw_rad + bearings
    dx, dy = np.cos(heading)[:, None], np.sin(heading)[:, None]
    ax, ay = walls[:, 0] - pose.x_m, walls[:, 1] - pose.y_m
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    across = dx * ey - dy * ex
    with np.errstate(divide='ignore', invalid='ignore'):
        distance, along = (ax * ey - ay * ex) / across, (ax * dy - ay * dx) / across
    met = (across != 0.0) & (distance > 0.0) & (along >= 0.0) & (along <= 1.0)
    return np.where(met, distance, np.inf).min(axis=1)


@pytest.mark.parametrize('name', sorted(WORLDS))
def test_ranges_are_those_of_the_plain_equations(name):
    building = WORLDS[name]()
    bearings = Lidar(beams=300).bearings()
    for x, y in building.waypoints[:20]:
        pose = Pose2D(float(x) + 0.1, float(y) - 0.07, 0.3 * float(x))
        ranges = true_ranges(building.walls, pose, bearings)
        assert ranges == pytest.approx(plain_ranges(building.walls, pose, bearings), rel=1e-9)


@pytest.mark.parametrize('yaw', [0.0, 2.9, -40.0])
def test_rising_bearings_find_what_others_find(yaw):
    """More than one turn of them, few, and from a place on a wall or at its end."""
    walls, rng = WORLDS['ring']().walls, np.random.default_rng(2)
    corner, middle = walls[5, :2], 0.5 * (walls[7, :2] + walls[7, 2:])
    for x, y in (corner, middle, (8.27, 8.28), (-5.0, 3.0)):
        for bearings in (np.linspace(-4.0, 9.0, 301), np.array([0.5, 0.5, 6.0]), np.empty(0)):
            order, pose = rng.permutation(bearings.size), Pose2D(float(x), float(y), yaw)
            ranges = true_ranges(walls, pose, bearings)
            assert np.array_equal(ranges[order], true_ranges(walls, pose, bearings[order]))


def test_nothing_there_is_inf():
    assert np.isinf(true_ranges(ROOM[:1], Pose2D(1.0, 1.0), np.array([0.0, 1.0]))).all()


def test_a_wall_seen_through_a_door():
    walls = np.array([(2, 0, 2, 1), (2, 2, 2, 3), (5, 0, 5, 3)], np.float64)
    through = true_ranges(walls, Pose2D(1.0, 1.5), np.array([0.0]))
    beside = true_ranges(walls, Pose2D(1.0, 0.5), np.array([0.0]))
    assert (through[0], beside[0]) == (pytest.approx(4.0), pytest.approx(1.0))


def test_noise_dropouts_and_range_limit():
    lidar = Lidar(beams=20_000, range_max_m=3.2, noise_m=0.05, dropout=0.1)
    ranges = lidar.measure(ROOM, Pose2D(2.0, 1.5), np.random.default_rng(0))
    exact = true_ranges(ROOM, Pose2D(2.0, 1.5), lidar.bearings())
    lost = np.isnan(ranges)
    assert lost.mean() == pytest.approx(0.1, abs=0.01)
    assert (ranges[~lost] - exact[~lost]).std() == pytest.approx(0.05, rel=0.05)
    near = Lidar(beams=360, range_max_m=1.8, noise_m=0.0, dropout=0.0)
    seen = near.measure(ROOM, Pose2D(2.0, 1.5), np.random.default_rng(0))
    exact = true_ranges(ROOM, Pose2D(2.0, 1.5), near.bearings())
    assert np.array_equal(np.isinf(seen), exact > 1.8)


def test_too_near_clutter_and_field_of_view():
    lidar = Lidar(beams=20_001, range_min_m=1.2, noise_m=0.0, dropout=0.0, clutter=0.25)
    exact = true_ranges(ROOM, Pose2D(2.0, 1.5), lidar.bearings())
    ranges = lidar.measure(ROOM, Pose2D(2.0, 1.5), np.random.default_rng(0))
    same = ranges == np.where(exact < 1.2, -np.inf, exact).astype(np.float32)
    assert (~same).mean() == pytest.approx(0.25, abs=0.01)
    anything = ranges[~same]
    assert anything.min() >= 1.2
    assert anything.mean() == pytest.approx((1.2 + 12.0) / 2, rel=0.02)
    front = Lidar(beams=181, field_of_view_rad=math.pi)
    assert front.bearings()[[0, 90, 180]] == pytest.approx([-math.pi / 2, 0.0, math.pi / 2])
    around = Lidar(beams=4)
    assert around.bearings() == pytest.approx([-math.pi, -math.pi / 2, 0.0, math.pi / 2])
    scan = front.scan(np.ones(181, np.float32), 7, 'front')
    assert (scan.angle_min_rad, scan.stamp_ns) == (pytest.approx(-math.pi / 2), 7)


def test_true_map_of_a_building():
    """The room of 4 m x 3 m in cells of 0.5 m: a ring of walls around 7 x 5 free ones."""
    off = np.tile([0.1, 0.1], 2)
    room = Building(ROOM + off, np.array([(1.0, 1.0), (2.0, 1.0)]))
    truth = rasterised(room, 0.5)
    assert (truth.probability == 0.0).sum() == 7 * 5
    assert (truth.probability == 1.0).sum() == 9 * 7 - 7 * 5
    assert np.isnan(truth.probability[0]).all()
    column, row = truth.spec.cell_of(4.1, 3.1)
    assert truth.probability[row, column] == 1.0
    office = rasterised(WORLDS['office'](), 0.05)
    assert (office.probability == 0.0).sum() * 0.05**2 == pytest.approx(180.0, rel=0.05)


@pytest.mark.parametrize(
    'settings',
    [
        {'beams': 0},
        {'range_max_m': 0.0},
        {'noise_m': -1.0},
        {'dropout': 1.0},
        {'clutter': -0.1},
        {'field_of_view_rad': 7.0},
    ],
)
def test_a_lidar_that_cannot_be(settings):
    with pytest.raises(ConfigError):
        Lidar(**settings)


def test_walk_turns_goes_and_arrives():
    corner = np.array([(0, 0), (1, 0), (1, 1)], np.float64)
    poses = list(walk(corner, period_s=0.1, speed_m_s=1.0, turn_rad_s=1.0))
    steps = [math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in itertools.pairwise(poses)]
    assert max(steps) == pytest.approx(0.1)
    assert sum(steps) == pytest.approx(2.0)
    assert (poses[-1].x_m, poses[-1].y_m) == (pytest.approx(1.0), pytest.approx(1.0))
    assert poses[-1].yaw_rad == pytest.approx(math.pi / 2)


def test_the_walk_through_the_office_touches_no_wall():
    building = WORLDS['office']()
    rng = np.random.default_rng(1)
    lidar = Lidar(beams=72, noise_m=0.0, dropout=0.0)
    closest = min(float(scan.ranges_m.min()) for scan, _ in record(building, lidar, rng))
    assert closest > 0.15
