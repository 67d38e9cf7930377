"""Errors that are alike: every belief stays as sure as it says, all together know no better."""

import numpy as np
import pytest

from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.trajectory.alike import Alike, effective_count, symmetric_roots
from ogm_mcmc.trajectory.factors import PoseFactors

NEVER = 1e-300  # anew


def normal(values: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * values**2) / np.sqrt(2.0 * np.pi)


def test_an_error_after_any_other_is_what_its_belief_says() -> None:
    """The integral of N(a) f(a, b) over a is 1 for every b: f leaves each N(0, I) as it is."""
    values = np.linspace(-9.0, 9.0, 1201)
    pairs = Alike(
        np.zeros(1201, np.int64) + np.arange(1201), np.full(1201, 1201), np.array([0.8, 0.0, 0.0])
    )
    for b in (0.0, 1.0, 2.5):
        errors = np.zeros((1202, 3))
        errors[:1201, 0], errors[1201, 0] = values, b
        f = np.exp(pairs.log_densities(errors))
        assert (normal(values) * f).sum() * (values[1] - values[0]) == pytest.approx(1.0)


def chain(correlation: tuple[float, float, float], anew: float) -> PoseFactors:
    """Return factors of four beliefs, each with another covariance."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 3, 3))
    beliefs = [
        PoseBelief(Pose2D(*rng.normal(size=3)), root[k] @ root[k].T + 0.2 * np.eye(3))
        for k in range(4)
    ]
    alike = Alike(np.array([0, 2, 1]), np.array([2, 1, 3]), np.array(correlation), anew)
    return PoseFactors.of(beliefs, (1.0, 1.0, 1.0))._replace(alike=alike)


def test_the_density_is_that_of_a_first_order_process() -> None:
    """Against the joint covariance of all poses, written down."""
    r = np.array([0.9, 0.7, 0.3])
    factors = chain(tuple(r), NEVER)
    roots = np.linalg.inv(symmetric_roots(factors.precision))
    place = np.array([0, 2, 1, 3])  # in the order 0, 2, 1, 3
    covariance = np.zeros((12, 12))
    for i in range(4):
        for j in range(4):
            apart = abs(int(place[i]) - int(place[j]))
            block = roots[i] @ np.diag(r**apart) @ roots[j]
            covariance[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = block
    precision = np.linalg.inv(covariance)
    rng = np.random.default_rng(2)
    off = rng.normal(size=(2, 4, 3)) * 0.3
    one, two = (factors.log_density(factors.mean + each) for each in off)
    expected = [-0.5 * each.ravel() @ precision @ each.ravel() for each in off]
    assert one - two == pytest.approx(expected[0] - expected[1])
    at = factors.linearised(factors.mean)
    products = [factors.times(at, unit.reshape(4, 3)).ravel() for unit in np.eye(12)]
    np.testing.assert_allclose(products, precision, rtol=1e-6, atol=1e-6)


def test_beliefs_that_err_alike_know_together_little_more_than_one() -> None:
    """The variance of a shift of all is what the count of independent errors says."""
    count = 200
    factors = PoseFactors.of([PoseBelief(Pose2D(), np.eye(3))] * count, (1.0, 1.0, 1.0))
    for correlation in (0.0, 0.9, 0.99):
        alike = Alike.in_order(np.arange(count), correlation)._replace(anew=NEVER)
        together = factors._replace(alike=alike)
        at = together.linearised(factors.mean)
        shift = np.zeros((count, 3))
        shift[:, 0] = 1.0
        precision = float((shift * together.times(at, shift)).sum()) / factors.precision[0, 0, 0]
        # Either end counts a little more.
        more = 2.0 * correlation / (1.0 + correlation)
        expected = effective_count(float(count), np.full(3, correlation))[0]
        assert precision == pytest.approx(expected, abs=more)


def test_a_jump_is_no_reason_to_tie_what_comes_after() -> None:
    pairs = Alike.in_order(np.arange(3), 0.99)
    smooth = pairs.weights(np.array([(1.0, 0.0, 0.0), (1.01, 0.0, 0.0), (1.0, 0.0, 0.0)]))
    jumped = pairs.weights(np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]))
    assert (smooth > 0.99).all()
    assert jumped[0] < 1e-6
    assert jumped[1] > 0.99


def process(correlation: float, count: int = 2000) -> np.ndarray:
    rng = np.random.default_rng(3)
    errors = rng.normal(size=(count, 3))
    for k in range(1, count):
        errors[k] = correlation * errors[k - 1] + np.sqrt(1.0 - correlation**2) * errors[k]
    return errors


@pytest.mark.parametrize('correlation', [0.0, 0.5, 0.95])
def test_poses_show_how_alike_errors_are(correlation: float) -> None:
    errors = process(correlation)
    errors[700] += 30.0  # one astray, and all after a jump
    errors[1200:] *= -1.0
    found = Alike.in_order(np.arange(len(errors)))
    for _ in range(20):
        found = found.shown(errors, np.zeros_like(errors))
    np.testing.assert_allclose(found.correlation, correlation, atol=0.05)


def test_few_pairs_and_no_pairs_say_little() -> None:
    errors = np.array([(1.0, 1.0, 1.0), (-1.0, -1.0, -1.0)])
    found = Alike.in_order(np.arange(2)).shown(errors, np.zeros((2, 3)))
    assert (found.correlation > 0.7).all()
    assert Alike.none().shown(errors, np.zeros((2, 3))).first.size == 0


def test_poses_that_nothing_else_tells_of_leave_it_as_it_is() -> None:
    """Beliefs are all there is: poses lie at their means, and what is left open is the prior."""
    pairs = Alike.in_order(np.arange(4000), 0.8)
    found = pairs.shown(np.zeros((4000, 3)), np.ones((4000, 3)))
    np.testing.assert_allclose(found.correlation, 0.8, atol=0.01)
