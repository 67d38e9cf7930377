"""A robot that scans while it moves: the way, the drift, the loop that closes."""

import itertools
import math

import numpy as np
import pytest

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.simulation import (
    WORLDS,
    Driving,
    Exploration,
    GridWorld,
    Lidar,
    drive,
    explore,
    generate_floor,
    rasterised,
    tour_of,
    walk,
)

SQUARE = np.array([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0)], np.float64)
LIDAR = Lidar(beams=4, noise_m=0.0, dropout=0.0)


def driven(driving, tour=SQUARE, seed=0):
    nothing = np.full(LIDAR.beams, np.inf)
    return list(drive(lambda pose: nothing, tour, LIDAR, driving, np.random.default_rng(seed)))


def test_one_tour_at_the_rate_of_the_sensor():
    scans = driven(Driving(rate_hz=40.0, speed_m_s=1.0, turn_rad_s=1.0))
    stamps = np.array([one.scan.stamp_ns for one in scans])
    assert set(np.diff(stamps)) == {25_000_000}
    # 16 m and three quarter turns, at 1 m/s and 1 rad/s.
    assert len(scans) / 40.0 == pytest.approx(16.0 + 1.5 * math.pi, abs=0.2)
    for one, other in itertools.pairwise(scans):
        step = math.hypot(other.truth.x_m - one.truth.x_m, other.truth.y_m - one.truth.y_m)
        assert step <= 1.0 / 40.0 + 1e-9
        assert other.speed_m_s == pytest.approx(40.0 * step, abs=1e-6)
    assert (scans[-1].truth.x_m, scans[-1].truth.y_m) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert scans[-1].corrected is not None
    assert [one.corrected for one in scans[:-1]] == [None] * (len(scans) - 1)


def test_it_goes_on_for_as_long_as_asked_and_stands_at_waypoints():
    scans = driven(Driving(rate_hz=10.0, duration_s=80.0, stand_s=1.0))
    assert len(scans) == 800
    closed = [one for one in scans if one.corrected is not None]
    assert len(closed) >= 2
    assert all(
        len(a.corrected.poses) < len(b.corrected.poses) for a, b in itertools.pairwise(closed)
    )
    at_corner = [
        one for one in scans[:200] if math.dist((one.truth.x_m, one.truth.y_m), (4, 0)) < 1e-6
    ]
    assert len(at_corner) >= 10


def test_a_way_that_is_no_loop_is_gone_back():
    scans = driven(Driving(rate_hz=10.0), tour=SQUARE[:3])
    assert max(one.truth.y_m for one in scans) == pytest.approx(4.0)
    assert (scans[-1].truth.x_m, scans[-1].truth.y_m) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_poses_drift_until_the_loop_closes():
    scans = driven(Driving(duration_s=60.0, drift=2.0, drifting=True))
    errors = [math.dist((s.said.x_m, s.said.y_m), (s.truth.x_m, s.truth.y_m)) for s in scans]
    closing = [k for k, one in enumerate(scans) if one.corrected is not None]
    assert errors[0] == 0.0
    assert errors[closing[0] - 1] > 0.05
    for k in closing:
        assert errors[k] == pytest.approx(0.0, abs=1e-9)
    corrected = scans[closing[0]].corrected
    nodes = [one for one in scans[: closing[0] + 1] if one.is_node]
    assert corrected.stamps_ns == tuple(one.scan.stamp_ns for one in nodes)
    assert corrected.poses == tuple(one.truth for one in nodes)
    # What SLAM says moves as odometry does, but where the loop closes.
    for k, (one, other) in enumerate(itertools.pairwise(scans), 1):
        if k not in closing:
            a = one.odometry.inverse().compose(other.odometry)
            b = one.said.inverse().compose(other.said)
            assert (a.x_m, a.y_m, a.yaw_rad) == pytest.approx((b.x_m, b.y_m, b.yaw_rad), abs=1e-9)


def test_without_drift_odometry_is_the_truth_from_its_own_origin():
    scans = driven(Driving(drift=0.0))
    start = scans[0].truth
    assert scans[0].odometry == Pose2D()
    for one in scans:
        there = start.compose(one.odometry)
        assert (there.x_m, there.y_m) == pytest.approx((one.truth.x_m, one.truth.y_m), abs=1e-9)


@pytest.mark.parametrize('rate_hz', [5.0, 40.0])
def test_the_drift_does_not_depend_on_the_rate(rate_hz):
    """Standard deviation of the heading after 30 m, of 40 drives: about 0.02 * 0.8 * sqrt(38)."""
    straight = np.array([(0.0, 0.0), (30.0, 0.0)])
    driving = Driving(rate_hz=rate_hz, drift=1.0, duration_s=37.5)
    ends = [driven(driving, straight, seed)[-1].odometry.yaw_rad for seed in range(40)]
    assert np.std(ends) == pytest.approx(0.02 * 0.8 * math.sqrt(38.0), rel=0.35)


def test_a_tour_of_a_grid_stays_in_the_free_space():
    world = generate_floor(9)
    tour = tour_of(world, explore(world, Exploration(max_stops=6), np.random.default_rng(1)))
    assert np.array_equal(tour, tour[::-1])
    for pose in walk(tour, period_s=0.1, speed_m_s=0.5, turn_rad_s=3.0):
        x, y = world.cell_position(pose)
        assert not world.occupied[int(y), int(x)]


@pytest.mark.parametrize('name', sorted(WORLDS))
def test_the_walk_of_a_building_stays_off_its_walls(name):
    building = WORLDS[name]()
    world = GridWorld.from_map(rasterised(building, 0.1))
    for pose in walk(building.waypoints, period_s=0.25, speed_m_s=0.5, turn_rad_s=3.0):
        x, y = (int(v) for v in world.cell_position(pose))
        assert not world.occupied[y - 2 : y + 3, x - 2 : x + 3].any()


def test_numbers_that_no_robot_has():
    with pytest.raises(ConfigError, match='rate_hz is 0'):
        Driving(rate_hz=0.0)
    with pytest.raises(ConfigError, match='drift is -1'):
        Driving(drift=-1.0)
