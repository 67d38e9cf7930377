"""Odometry, the filter's likelihood, and whether its beliefs are honest."""

import math

import numpy as np
import pytest

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridSpec, Pose2D
from ogm_mcmc.simulation import (
    Exploration,
    GridWorld,
    Lidar,
    Motion,
    OdometryNoise,
    ParticleFilter,
    ParticleFilterSettings,
    WorldFit,
    generate_floor,
    motion_between,
    record_exploration,
    record_localized,
)
from ogm_mcmc.simulation.localization_kernels import scan_log_likelihoods


def test_motions_lead_where_they_should():
    rng = np.random.default_rng(1)
    for _ in range(50):
        start, end = (Pose2D(*rng.uniform(-3, 3, 3)) for _ in range(2))
        there = motion_between(start, end).applied(start)
        assert (there.x_m, there.y_m) == (pytest.approx(end.x_m), pytest.approx(end.y_m))
        assert math.cos(there.yaw_rad - end.yaw_rad) == pytest.approx(1.0)
    turn = motion_between(Pose2D(1, 1, 0.2), Pose2D(1, 1, 1.2))
    assert turn == pytest.approx((1.0, 0.0, 0.0))


def test_noise_has_the_spread_it_is_given():
    noise = OdometryNoise(0.1, 0.2, 0.3, 0.4)
    first, way, second = noise.sampled(Motion(0.5, 2.0, -1.0), 100_000, np.random.default_rng(2))
    assert first.mean() == pytest.approx(0.5, abs=0.01)
    assert first.std() == pytest.approx(math.hypot(0.1 * 0.5, 0.2 * 2.0), rel=0.02)
    assert way.std() == pytest.approx(math.sqrt(0.6**2 + 0.2**2 + 0.4**2), rel=0.02)
    assert second.std() == pytest.approx(math.hypot(0.1, 0.4), rel=0.02)
    still = noise.measured(Motion(0.0, 0.0, 0.0), np.random.default_rng(2))
    assert still == (0.0, 0.0, 0.0)
    with pytest.raises(ConfigError, match='turn_per_m'):
        OdometryNoise(turn_per_m=-1.0)


def test_likelihood_of_a_scan_beam_by_beam():
    """Against the exact ranges of the world and the three-part density written out."""
    rng = np.random.default_rng(3)
    occupied = (rng.random((30, 40)) < 0.05).astype(np.uint8)
    world = GridWorld(GridSpec(1.0, 40, 30), occupied)
    poses = np.column_stack(
        (rng.uniform(0, 40, 20), rng.uniform(0, 30, 20), rng.uniform(-3, 3, 20))
    )
    bearings, reach = np.linspace(-3.0, 3.0, 9), 12.0
    ranges = np.array([1.0, 2.5, np.inf, 4.0, 7.5, 11.0, np.inf, 3.0, 0.5])
    got = np.empty(20)
    scan_log_likelihoods(occupied, poses, bearings, ranges, reach, 0.5, 0.8, 0.1, 0.2, got)
    for pose, value in zip(poses, got, strict=True):
        expected = 0.0
        exact = world.ranges(Pose2D(*pose), bearings, reach)
        for z, d in zip(ranges, exact, strict=True):
            if np.isinf(z):
                expected += math.log(0.2 if np.isfinite(d) else 0.9)
                continue
            density = 0.1 / reach
            if np.isfinite(d):
                normal = math.exp(-0.5 * ((z - d) / 0.8) ** 2) / (0.8 * math.sqrt(2 * math.pi))
                density += 0.7 * normal
            expected += math.log(density)
        assert value == pytest.approx(expected)


def test_resampling_keeps_the_belief():
    settings = ParticleFilterSettings(particles=4000)
    still = OdometryNoise(0.0, 0.0, 0.0, 0.0)
    fit = WorldFit(generate_floor(10), 0.2, 0.05, 0.05)
    pf = ParticleFilter(fit, settings, still, np.random.default_rng(4))
    pf.start(Pose2D(20.0, 20.0))
    pf.weights = np.exp(-20.0 * (pf.poses[:, 0] - 20.1) ** 2 / 0.01)
    pf.weights /= pf.weights.sum()
    before = pf.belief()
    assert pf.effective_particles() < 2000
    pf.move(Motion(0.0, 0.0, 0.0))
    after = pf.belief()
    assert pf.effective_particles() == pytest.approx(4000)
    assert after.mean.x_m == pytest.approx(before.mean.x_m, abs=2e-3)
    assert after.covariance[0, 0] == pytest.approx(before.covariance[0, 0], rel=0.1)


@pytest.fixture(scope='module')
def localized():
    world, lidar = generate_floor(8), Lidar(180, range_max_m=7.5, noise_m=0.03, dropout=0.0)
    settings = Exploration(max_stops=40)
    known = record_exploration(world, lidar, settings, np.random.default_rng(1))
    believed = record_localized(world, lidar, settings, np.random.default_rng(1))
    return list(known), list(believed)


@pytest.mark.jit
def test_the_same_way_and_scans_as_with_known_poses(localized):
    known, believed = localized
    assert [one.pose for one in known] == [one.truth for one in believed]
    for one, other in zip(known, believed, strict=True):
        assert one.scan.stamp_ns == other.placed.scan.stamp_ns
        assert np.array_equal(one.scan.ranges_m, other.placed.scan.ranges_m)


@pytest.mark.jit
def test_beliefs_are_near_the_truth_and_say_how_near(localized):
    _, believed = localized
    errors, squared = [], []
    for one in believed:
        mean, true = one.placed.pose, one.truth
        turn = (mean.yaw_rad - true.yaw_rad + math.pi) % (2 * math.pi) - math.pi
        error = np.array([mean.x_m - true.x_m, mean.y_m - true.y_m, turn])
        errors.append(math.hypot(error[0], error[1]))
        squared.append(error @ np.linalg.solve(one.placed.belief.covariance, error))
    drift = math.hypot(
        believed[-1].odometry.x_m - believed[-1].truth.x_m,
        believed[-1].odometry.y_m - believed[-1].truth.y_m,
    )
    assert max(errors) < 0.2
    assert drift > 5 * max(errors)
    # Three degrees of freedom: an honest belief has 3 on average. Ours claims rather too little.
    assert 0.3 < np.mean(squared) < 6.0
    spread = [math.sqrt(one.placed.belief.covariance[0, 0]) for one in believed]
    assert 0.01 < np.median(spread) < 0.1


@pytest.mark.parametrize(
    'settings',
    [{'particles': 0}, {'beams': 0}, {'power': 0.0}, {'sigma_m': 0.0}, {'clutter': 0.0}],
)
def test_filters_that_cannot_be(settings):
    with pytest.raises(ConfigError):
        ParticleFilterSettings(**settings)
