"""How firmly points hold poses, against dense matrices and plain differences."""

import numpy as np
import pytest
from support.rooms import path_through, scans_of

from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.curvature import (
    LEAST_HELD,
    ROUGHLY,
    drawn_deviation,
    held_share,
    numbers_fitted,
    widening,
)
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints, poses_of
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

COUNT = 6
STAGE = Stage(side_m=0.2, cut_m=0.05, flatness=0.3, steps=1)
TRUTH = path_through(COUNT)
FACTORS = PoseFactors.of([PoseBelief(pose) for pose in poses_of(TRUTH)], (0.05, 0.05, 0.03))


def dense(times) -> np.ndarray:
    units = np.eye(3 * COUNT).reshape(-1, COUNT, 3)
    return np.array([times(unit).reshape(-1) for unit in units]).T


def test_draws_are_solutions_of_the_matrix() -> None:
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    system, at = SurfelSystem.around(points, TRUTH, STAGE), FACTORS.linearised(TRUTH)
    drawn = drawn_deviation(system, FACTORS, at, np.random.default_rng(0))
    rng = np.random.default_rng(0)
    noise = system.noise(rng) + FACTORS.noise(at, rng)
    matrix = dense(system.times) + dense(lambda x: FACTORS.times(at, x))
    expected = np.linalg.solve(matrix, noise.reshape(-1))
    np.testing.assert_allclose(drawn.reshape(-1), expected, atol=5e-3 * np.abs(expected).max())


def test_only_what_points_hold_is_drawn_wider() -> None:
    """Points that scatter more, beliefs as they say: a sandwich, written down."""
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    system, at = SurfelSystem.around(points, TRUTH, STAGE), FACTORS.linearised(TRUTH)
    assert 0.5 < system.slope < 1.0
    assert widening(system, 1.0) == 1.0
    assert widening(system, 0.4) == pytest.approx(system.slope / 0.4)
    rng = np.random.default_rng(6)
    drawn = [drawn_deviation(system, FACTORS, at, rng, 3.0).reshape(-1) for _ in range(400)]
    of_points, of_beliefs = dense(system.times), dense(lambda x: FACTORS.times(at, x))
    bread = np.linalg.inv(of_points + of_beliefs)
    expected = np.diag(bread @ (9.0 * of_points + of_beliefs) @ bread)
    np.testing.assert_allclose(np.var(drawn, axis=0), expected, rtol=0.35)
    together = np.tile((1.0, 0.0, 0.0), COUNT) / COUNT
    shift = np.var(np.array(drawn) @ together)
    assert shift == pytest.approx(0.05**2 / COUNT, rel=0.35)  # what beliefs say, no wider


def test_scans_that_share_nothing_are_not_asked() -> None:
    apart = np.column_stack((100.0 * np.arange(COUNT), np.zeros((COUNT, 2))))
    points = ScanPoints.of(scans_of(TRUTH, 2, 0.0))
    system = SurfelSystem.around(points, apart, STAGE)
    assert held_share(system, points, apart, STAGE, np.ones((COUNT, 3))) == 1.0


def test_it_is_what_gradients_at_both_sides_show() -> None:
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    system = SurfelSystem.around(points, TRUTH, STAGE)
    step = 0.01 * np.random.default_rng(3).normal(size=(COUNT, 3))
    after = SurfelSystem.around(points, TRUTH + step, STAGE)
    before = SurfelSystem.around(points, TRUTH - step, STAGE)
    change = before.gradient * before.variance - after.gradient * after.variance
    expected = (change * step).sum() / 2.0 / system.variance
    expected /= step.reshape(-1) @ dense(system.times) @ step.reshape(-1)
    found = held_share(system, points, TRUTH, STAGE, step)
    assert found == pytest.approx(expected)
    assert LEAST_HELD < found < 1.0


def test_how_many_numbers_points_decide_is_a_trace() -> None:
    """Between none, where beliefs hold all, and three of each pose less where the map lies."""
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    system, at = SurfelSystem.around(points, TRUTH, STAGE), FACTORS.linearised(TRUTH)
    rng = np.random.default_rng(2)
    drawn = [drawn_deviation(system, FACTORS, at, rng, accuracy=ROUGHLY) for _ in range(200)]
    found = np.mean([numbers_fitted(system, one) for one in drawn])
    of_points, of_beliefs = dense(system.times), dense(lambda x: FACTORS.times(at, x))
    expected = np.trace(of_points @ np.linalg.inv(of_points + of_beliefs))
    assert found == pytest.approx(expected, rel=0.1)
    assert 1.0 < expected < 3 * COUNT


def test_points_that_poses_were_fitted_to_scatter_more_than_they_show() -> None:
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    plain = SurfelSystem.around(points, TRUTH, STAGE)
    fitted = SurfelSystem.around(points, TRUTH, STAGE, fitted=15.0)
    lines = np.count_nonzero(plain.total)
    left = 0.25 * plain.weight.size - 0.5 * lines
    assert fitted.variance == pytest.approx(plain.variance * left / (left - 15.0))
    np.testing.assert_allclose(fitted.gradient * fitted.variance, plain.gradient * plain.variance)
