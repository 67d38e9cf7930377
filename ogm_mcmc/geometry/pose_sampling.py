"""Beliefs about a pose as weighted samples ([pose] section V-A)."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry.pose import Pose2D, PoseBelief, PoseSamples

__all__ = [
    'at_most',
    'draw_gaussian',
    'merged',
    'quasi_normals',
    'random_normals',
    'samples_for_accuracy',
    'samples_of',
    'systematic',
]

Normals = Callable[[np.random.Generator, int], Float64Array]

# Eigenvalues below this share of the largest one are rounding: the belief is flat in there.
FLAT = 1e-12

# 1 / g, 1 / g^2, 1 / g^3 with g^4 = g + 1: the most evenly spread additive steps in 3D that are
# known (the golden ratio's generalisation).
STEPS = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])

QUANTILE = NormalDist().inv_cdf

# More particles than anybody sends.
NO_LIMIT = 2**62

# The truth is within so many standard errors in 95 of 100 cases.
TWO_SIDED_95 = 1.959964


def random_normals(rng: np.random.Generator, count: int) -> Float64Array:
    """Independent standard normals (count, 3)."""
    return rng.standard_normal((count, 3))


def quasi_normals(rng: np.random.Generator, count: int) -> Float64Array:
    """Evenly spread standard normals (count, 3).

    A sequence of additive steps in the unit cube, shifted at random (so that errors average out
    over scans and no draw is preferred), through the inverse normal distribution.
    """
    points = (rng.random(3) + STEPS * np.arange(1, count + 1)[:, None]) % 1.0
    # Keep off the ends, where the quantile is infinite.
    shares = np.clip(points, 1e-12, 1.0 - 1e-12).ravel().tolist()
    return np.array(list(map(QUANTILE, shares))).reshape(count, 3)


def spread_of(covariance: Float64Array) -> Float64Array:
    """Return S (3, 3) with S S^T = covariance; a singular one is fine, rounding below 0 cut."""
    values, vectors = np.linalg.eigh(covariance)
    values = np.where(values > FLAT * max(float(values[-1]), 0.0), values, 0.0)
    spread: Float64Array = vectors * np.sqrt(values)
    return spread


def draw_gaussian(
    mean: Pose2D,
    covariance: Float64Array,
    count: int,
    rng: np.random.Generator,
    normals: Normals = random_normals,
) -> PoseSamples:
    """Draw equally weighted poses from a Gaussian over x, y, yaw; yaw is wrapped."""
    poses = normals(rng, count) @ spread_of(covariance).T
    poses += (mean.x_m, mean.y_m, mean.yaw_rad)
    poses[:, 2] = (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return PoseSamples(poses, np.full(count, 1.0 / count))


def samples_for_accuracy(covariance: Float64Array, lever_m: float, accuracy_m: float) -> int:
    """Return how many independent draws make the mean of a beam's end as accurate as asked for.

    The mean of M draws of standard deviation s is within `accuracy_m` of the true one in 95 of 100
    cases for M = (1.96 s / accuracy)^2. Of an end `lever_m` away, s^2 is at most the greatest
    variance of the position plus that of the yaw times lever^2.
    """
    position = float(np.linalg.eigvalsh(covariance[:2, :2])[-1])
    variance = position + lever_m**2 * float(covariance[2, 2])
    return max(1, math.ceil(TWO_SIDED_95**2 * variance / accuracy_m**2))


def merged(samples: PoseSamples, negligible: float = 0.0) -> PoseSamples:
    """Join equal poses; leave out the lightest that together weigh at most `negligible`.

    A resampled cloud is full of copies, and one that was not for long is full of poses nobody
    believes in any more. The rest keeps its proportions.
    """
    poses, members = np.unique(samples.poses, axis=0, return_inverse=True)
    weights = np.zeros(poses.shape[0])
    np.add.at(weights, members.ravel(), samples.weights)
    if poses.shape[0] == 1:
        return PoseSamples(poses, np.ones(1))
    lightest_first = np.argsort(weights, kind='stable')
    dropped = np.cumsum(weights[lightest_first]) <= negligible
    used = np.ones(weights.size, np.bool_)
    used[lightest_first[dropped]] = False
    kept = weights[used]
    return PoseSamples(poses[used], np.ones(1) if kept.size == 1 else kept / kept.sum())


def systematic(samples: PoseSamples, count: int, offset: float = 0.5) -> Float64Array:
    """Resample to `count` equally weighted poses (count, 3).

    Low-variance sampling with one offset in [0, 1): a particle of weight w appears floor or
    ceil of count * w times. 0.5, the middle, keeps it free of chance.
    """
    positions = (np.arange(count) + offset) / count
    edges = np.cumsum(samples.weights)
    edges[-1] = 1.0
    chosen: Float64Array = samples.poses[np.searchsorted(edges, positions, side='right')]
    return chosen


def at_most(samples: PoseSamples, count: int, offset: float) -> PoseSamples:
    """Return a cloud, or `count` poses that stand for one that is larger.

    They are drawn systematically along the direction in which the cloud is longest (`offset` in
    [0, 1) is the chance), so that they are spread as it is.
    """
    if samples.weights.size <= count:
        return samples
    along = spread_of(samples.covariance())[:2, 2]
    order = np.argsort(samples.poses[:, :2] @ along, kind='stable')
    ordered = PoseSamples(samples.poses[order], samples.weights[order])
    return merged(PoseSamples(systematic(ordered, count, offset), np.full(count, 1.0 / count)))


def samples_of(
    belief: PoseBelief,
    rng: np.random.Generator,
    *,
    count: int,
    quasi: bool,
    accuracy_m: float = 0.0,
    lever_m: float = 0.0,
    negligible: float = 0.0,
    max_particles: int = NO_LIMIT,
) -> PoseSamples:
    """Turn a belief into samples: its particles; draws from its Gaussian; or its mean alone.

    `count` draws, or with an accuracy above 0 as many as that takes, up to `count`. Of a cloud of
    more than `max_particles` so many that are drawn from it.
    """
    if belief.particles is not None:
        cloud = belief.particles
        if cloud.weights.size > max_particles:
            return at_most(cloud, max_particles, float(rng.random()))
        return merged(cloud, negligible)
    covariance = belief.covariance
    if covariance is None or not covariance.any():
        mean = belief.mean
        return PoseSamples(np.array([[mean.x_m, mean.y_m, mean.yaw_rad]]), np.ones(1))
    if accuracy_m > 0.0:
        count = min(count, samples_for_accuracy(covariance, lever_m, accuracy_m))
    normals = quasi_normals if quasi else random_normals
    return draw_gaussian(belief.mean, covariance, count, rng, normals)
