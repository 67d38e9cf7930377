"""Beliefs as samples: moments, singular and wrapped beliefs, how many are enough."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.geometry import Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.geometry.pose_sampling import (
    at_most,
    draw_gaussian,
    merged,
    quasi_normals,
    random_normals,
    samples_for_accuracy,
    samples_of,
    spread_of,
    systematic,
)

approx = pytest.approx

TURNED = np.array([[0.04, 0.01, 0.002], [0.01, 0.02, -0.001], [0.002, -0.001, 0.01]])


def rng():
    return np.random.default_rng(7)


@given(st.lists(st.floats(-2.0, 2.0), min_size=9, max_size=9))
@REPEATABLE
def test_spread_times_its_transpose_is_the_covariance(entries):
    root = np.array(entries).reshape(3, 3)
    covariance = root @ root.T
    spread = spread_of(covariance)
    scale = max(1.0, float(np.abs(covariance).max()))
    assert spread @ spread.T == approx(covariance, abs=1e-9 * scale)


@pytest.mark.parametrize('normals', [random_normals, quasi_normals])
def test_moments_of_the_draws(normals):
    """Standard errors at 20 000 independent draws; the quasi-random ones are far better."""
    mean, count = Pose2D(3.0, -2.0, 0.5), 20_000
    samples = draw_gaussian(mean, TURNED, count, rng(), normals)
    assert samples.weights == approx(np.full(count, 1.0 / count))
    errors = samples.poses.mean(axis=0) - (3.0, -2.0, 0.5)
    allowed = 4.0 if normals is random_normals else 1.0
    assert np.abs(errors) == approx(0.0, abs=allowed * math.sqrt(0.04 / count))
    assert np.cov(samples.poses.T) == approx(TURNED, abs=allowed * 0.06 / math.sqrt(count))


def test_quasi_random_draws_need_fewer():
    """Mean error of the mean over 200 clouds of 50: random draws would take twice as many."""

    def error(normals):
        generator = rng()
        clouds = (draw_gaussian(Pose2D(), TURNED, 50, generator, normals) for _ in range(200))
        return np.mean([np.abs(cloud.poses.mean(axis=0)).max() for cloud in clouds])

    assert error(quasi_normals) < error(random_normals) / math.sqrt(2.0)


def test_quasi_random_draws_are_normal_in_each_direction():
    """Kolmogorov's distance of 1000 evenly spread points is far below that of random ones."""
    points = np.sort(quasi_normals(rng(), 1000), axis=0)
    shares = 0.5 * np.vectorize(math.erfc)(-points / math.sqrt(2.0))
    steps = (np.arange(1000) + 0.5)[:, None] / 1000
    assert np.abs(shares - steps).max() < 0.005


@pytest.mark.parametrize('quasi', [False, True])
def test_a_singular_belief_stays_in_its_directions(quasi):
    """A robot on rails: only the way along the diagonal is uncertain."""
    covariance = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]) * 0.09
    belief = PoseBelief(Pose2D(1.0, 2.0, 0.3), covariance)
    poses = samples_of(belief, rng(), count=200, quasi=quasi).poses
    assert poses[:, 0] - 1.0 == approx(poses[:, 1] - 2.0, abs=1e-9)
    assert poses[:, 2] == approx(0.3, abs=1e-9)
    assert poses[:, 0].std() == approx(0.3, rel=0.2)


def test_rounding_below_zero_is_no_spread():
    samples = draw_gaussian(Pose2D(), np.diag([1.0, 0.0, -1e-12]), 50, rng())
    assert np.isfinite(samples.poses).all()
    assert np.abs(samples.poses[:, 1:]).max() == 0.0


def test_yaw_wraps():
    belief = PoseBelief(Pose2D(0.0, 0.0, math.pi - 0.01), np.diag([0.0, 0.0, 0.04]))
    samples = samples_of(belief, rng(), count=500, quasi=True)
    yaw = samples.poses[:, 2]
    assert yaw.min() >= -math.pi
    assert yaw.max() < math.pi
    assert (yaw > 0).any()
    assert (yaw < 0).any()
    assert samples.mean().yaw_rad == approx(math.pi - 0.01, abs=0.02)


@pytest.mark.parametrize('covariance', [None, np.zeros((3, 3))])
def test_a_known_pose_is_one_sample(covariance):
    samples = samples_of(PoseBelief(Pose2D(1, 2, 3), covariance), rng(), count=9, quasi=True)
    assert samples.poses.tolist() == [[1.0, 2.0, 3.0]]
    assert samples.weights.tolist() == [1.0]


def test_particles_are_used_as_they_are_and_copies_joined():
    cloud = PoseSamples.checked(
        [[1.0, 0.0, 0.0], [0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [9.0, 9.0, 0.0]], [0.1, 0.6, 0.3, 0.0]
    )
    belief = PoseBelief(cloud.mean(), cloud.covariance(), cloud)
    samples = samples_of(belief, rng(), count=3, quasi=True)
    found = {tuple(p): w for p, w in zip(samples.poses.tolist(), samples.weights, strict=True)}
    assert found == {(0.0, 0.0, 0.5): approx(0.6), (1.0, 0.0, 0.0): approx(0.4)}


def test_particles_of_next_to_no_weight_are_left_out():
    poses, weights = np.arange(15.0).reshape(5, 3), np.array([0.5, 4e-4, 0.4993, 3e-4, 0.0])
    whole = merged(PoseSamples(poses, weights))
    assert whole.poses[:, 0].tolist() == [0.0, 3.0, 6.0, 9.0]
    fewer = merged(PoseSamples(poses, weights), 5e-4)
    assert fewer.poses[:, 0].tolist() == [0.0, 3.0, 6.0]
    assert fewer.weights == approx(np.array([0.5, 4e-4, 0.4993]) / 0.9997)
    fewest = merged(PoseSamples(poses, weights), 7.1e-4)
    assert fewest.poses[:, 0].tolist() == [0.0, 6.0]
    one = merged(PoseSamples(poses[:2], np.array([1.0 - 1e-9, 1e-9])), 1e-3)
    assert (one.poses.tolist(), one.weights.tolist()) == ([[0.0, 1.0, 2.0]], [1.0])


def test_a_cloud_of_one_place_is_a_known_pose():
    cloud = PoseSamples.checked(np.tile([1.0, 2.0, 0.5], (30, 1)))
    samples = merged(cloud)
    assert samples.weights.tolist() == [1.0]
    assert samples.poses.tolist() == [[1.0, 2.0, 0.5]]


def test_number_of_draws_on_paper():
    """(1.96 * 0.5 / 0.1)^2 = 96.04; the variance is 0.09 + (4 m)^2 * 0.01 = 0.25."""
    covariance = np.diag([0.09, 0.04, 0.01])
    assert samples_for_accuracy(covariance, 4.0, 0.1) == 97
    assert samples_for_accuracy(np.zeros((3, 3)), 4.0, 0.1) == 1


def test_that_many_draws_are_as_accurate_as_promised():
    """In 95 of 100 clouds the mean is within the accuracy: 1000 clouds, four standard errors."""
    covariance, accuracy = np.diag([0.25, 0.0, 0.0]), 0.1
    count = samples_for_accuracy(covariance, 0.0, accuracy)
    generator = rng()
    means = [
        draw_gaussian(Pose2D(), covariance, count, generator).poses[:, 0].mean()
        for _ in range(1000)
    ]
    inside = np.mean(np.abs(means) <= accuracy)
    assert inside == approx(0.95, abs=4.0 * math.sqrt(0.95 * 0.05 / 1000))


def test_accuracy_never_takes_more_than_the_number_of_samples():
    belief = PoseBelief(Pose2D(), np.diag([1.0, 1.0, 0.1]))
    few = samples_of(belief, rng(), count=500, quasi=True, accuracy_m=0.5, lever_m=1.0)
    capped = samples_of(belief, rng(), count=50, quasi=True, accuracy_m=0.01, lever_m=1.0)
    assert few.weights.size == samples_for_accuracy(belief.covariance, 1.0, 0.5) < 20
    assert capped.weights.size == 50


@given(
    weights=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20).filter(lambda w: sum(w) > 1e-3),
    count=st.integers(1, 60),
    offset=st.floats(0.0, 0.999),
)
@settings(derandomize=True, deadline=None)
def test_systematic_resampling_counts(weights, count, offset):
    share = np.array(weights) / sum(weights)
    poses = np.arange(3.0 * share.size).reshape(-1, 3)
    chosen = systematic(PoseSamples(poses, share), count, offset)
    assert chosen.shape == (count, 3)
    for pose, weight in zip(poses, share, strict=True):
        times = int((chosen == pose).all(axis=1).sum())
        assert math.floor(count * weight - 1e-9) <= times <= math.ceil(count * weight + 1e-9)


def test_systematic_resampling_by_hand():
    poses = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]])
    samples = PoseSamples(poses, np.array([0.5, 0.2, 0.3]))
    # Positions 1/8, 3/8, 5/8, 7/8 against the edges 0.5, 0.7, 1.
    assert systematic(samples, 4)[:, 0].tolist() == [0, 0, 1, 2]
    assert systematic(samples, 2, offset=0.0)[:, 0].tolist() == [0, 1]


def test_equal_weights_come_back_one_each():
    poses = np.arange(90.0).reshape(30, 3)
    samples = PoseSamples(poses, np.full(30, 1 / 30))
    assert systematic(samples, 30).tolist() == poses.tolist()


def cloud(count, rng, spread=(0.2, 0.1, 0.05)):
    """A cloud of uneven weights around a place, as particles of amcl are."""
    poses = np.array([3.0, -2.0, 0.5]) + rng.standard_normal((count, 3)) * spread
    return PoseSamples.checked(poses, rng.random(count))


def test_a_small_cloud_is_left_as_it_is():
    small = cloud(50, np.random.default_rng(1))
    assert at_most(small, 50, 0.5) is small


def test_a_large_cloud_is_represented():
    large = cloud(2000, np.random.default_rng(1))
    few = at_most(large, 200, 0.5)
    assert few.weights.size <= 200
    assert few.weights.sum() == approx(1.0)
    known = {tuple(pose) for pose in large.poses.tolist()}
    assert {tuple(pose) for pose in few.poses.tolist()} <= known
    # Independent draws would be off by 0.2 / sqrt(200) = 0.014 in x; evenly spread ones are not.
    assert few.mean().x_m == approx(large.mean().x_m, abs=0.003)
    assert few.mean().y_m == approx(large.mean().y_m, abs=0.02)
    assert np.diag(few.covariance()) == approx(np.diag(large.covariance()), rel=0.3)


def test_no_particle_is_preferred():
    """On average over the offset a particle weighs what it weighed."""
    large = cloud(40, np.random.default_rng(2))
    total = np.zeros(40)
    offsets = (np.arange(400) + 0.5) / 400
    for offset in offsets:
        few = at_most(large, 7, offset)
        rows = (large.poses[:, None] == few.poses[None]).all(axis=2).argmax(axis=0)
        np.add.at(total, rows, few.weights)
    assert total / offsets.size == approx(large.weights, abs=1 / 400)


def test_clouds_are_bounded_only_where_that_is_asked_for():
    belief = PoseBelief(Pose2D(), None, cloud(300, np.random.default_rng(3)))
    every = samples_of(belief, rng(), count=9, quasi=True)
    few = samples_of(belief, rng(), count=9, quasi=True, max_particles=20)
    assert every.weights.size == 300
    assert few.weights.size <= 20
