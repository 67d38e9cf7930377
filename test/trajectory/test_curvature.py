"""How firmly points hold poses, against dense matrices and plain differences."""

import numpy as np
import pytest
from support.rooms import path_through, scans_of

from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.curvature import LEAST_HELD, drawn_deviation, held_share, widening
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
    """The first scan has no points: it is as sure as its belief, whatever the others show."""
    scans = scans_of(TRUTH, 90, 0.02)
    scans[0].ranges_m[:] = np.nan
    points = ScanPoints.of(scans)
    system, at = SurfelSystem.around(points, TRUTH, STAGE), FACTORS.linearised(TRUTH)
    wider = widening(system, at, 0.4)
    assert wider.shape == (COUNT, 1)
    assert wider[0] == 1.0
    assert 0.5 < system.slope < 1.0
    most = system.slope / 0.4
    assert (wider[1:] < most).all()
    assert (wider[1:] > 1.0 + 0.9 * (most - 1.0)).all()
    np.testing.assert_array_equal(widening(system, at, 1.0), np.ones((COUNT, 1)))


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
