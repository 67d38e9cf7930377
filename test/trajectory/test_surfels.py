"""The alignment over surfels: against dense matrices, and in a room whose poses are known."""

import numpy as np
import pytest
from support.rooms import path_through, scans_of

from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints, poses_of
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem, align, solve

COUNT = 6
STAGE = Stage(side_m=0.4, cut_m=0.1, flatness=0.3, steps=1)
TRUTH = path_through(COUNT)
POINTS = ScanPoints.of(scans_of(TRUTH, 90, 0.01))


def factors_around(poses: np.ndarray, spread: tuple[float, float, float]) -> PoseFactors:
    return PoseFactors.of([PoseBelief(pose) for pose in poses_of(poses)], spread)


def dense(system: SurfelSystem) -> np.ndarray:
    units = np.eye(3 * COUNT).reshape(-1, COUNT, 3)
    return np.array([system.times(unit).reshape(-1) for unit in units]).T


def test_the_precision_is_that_of_points_less_the_mean_of_their_surfel() -> None:
    system = SurfelSystem.around(POINTS, TRUTH, STAGE)
    rows = np.zeros((system.weight.size, COUNT, 3))
    rows[np.arange(system.weight.size), system.scan] = system.jacobian
    rows = rows.reshape(len(rows), -1)
    expected = rows.T @ (system.weight[:, None] * rows)
    for v in np.unique(system.surfel):
        mine = system.surfel == v
        pull = system.weight[mine] @ rows[mine]
        expected -= np.outer(pull, pull) / system.weight[mine].sum()
    np.testing.assert_allclose(dense(system), expected, rtol=1e-7, atol=1e-4)


def test_moving_everything_changes_nothing() -> None:
    system = SurfelSystem.around(POINTS, TRUTH, STAGE)
    for rigid in ((1.0, 0.0), (0.0, 1.0)):
        x = np.tile((*rigid, 0.0), (COUNT, 1))
        np.testing.assert_allclose(system.times(x), 0.0, atol=1e-6)
    assert np.abs(system.gradient[:, :2].sum(axis=0)).max() < 1e-6


def test_solutions_are_those_of_the_matrix() -> None:
    system = SurfelSystem.around(POINTS, TRUTH, STAGE)
    factors = factors_around(TRUTH, (0.3, 0.3, 0.1))
    at = factors.linearised(TRUTH)
    right = np.random.default_rng(0).normal(size=(COUNT, 3))
    matrix = dense(system)
    for k in range(COUNT):
        own = slice(3 * k, 3 * k + 3)
        matrix[own, own] += factors.precision[k]
    found = solve(system, factors, at, right, most=200, accuracy=1e-9)
    np.testing.assert_allclose(
        found.reshape(-1), np.linalg.solve(matrix, right.reshape(-1)), rtol=1e-5, atol=1e-9
    )


def test_noise_has_the_precision_as_its_covariance() -> None:
    system = SurfelSystem.around(POINTS, TRUTH, STAGE)
    rng = np.random.default_rng(1)
    drawn = np.array([system.noise(rng).reshape(-1) for _ in range(4000)])
    matrix = dense(system)
    size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    assert np.abs((drawn.T @ drawn / len(drawn) - matrix) / size).max() < 0.08


@pytest.mark.parametrize('noise_m', [0.0, 0.01])
def test_perturbed_poses_find_their_way_back(noise_m: float) -> None:
    points = ScanPoints.of(scans_of(TRUTH, 180, noise_m))
    start = TRUTH + np.random.default_rng(2).normal(size=TRUTH.shape) * (0.05, 0.05, 0.02)
    factors, poses = factors_around(start, (0.3, 0.3, 0.1)), start
    for stage in (STAGE, STAGE._replace(side_m=0.2, cut_m=0.04)):
        for _ in range(8):
            poses, system = align(points, poses, factors, stage)
    before, after = absolute_errors(start, TRUTH), absolute_errors(poses, TRUTH)
    assert before.distance_m.mean() > 0.04
    assert after.distance_m.mean() < 0.002 + 0.2 * noise_m
    assert np.degrees(after.turn_rad.mean()) < 0.1
    if noise_m:
        # Across a wall the noise of a range counts in part only.
        assert 0.4 * noise_m < np.sqrt(system.variance) < 1.3 * noise_m


def test_scans_that_share_nothing_stay_as_believed() -> None:
    apart = np.array([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0)])
    points = ScanPoints.of(scans_of(TRUTH[:2], 2, 0.0))
    poses, _ = align(points, apart, factors_around(apart, (0.3, 0.3, 0.1)), STAGE)
    np.testing.assert_allclose(poses, apart)


def test_the_spread_of_points_scatters_as_its_doubt_says() -> None:
    found, doubt = [], 0.0
    for seed in range(40):
        points = ScanPoints.of(scans_of(TRUTH, 90, 0.01, seed))
        system = SurfelSystem.around(points, TRUTH, STAGE)
        found.append(system.variance)
        doubt = system.doubt
    # Doubt counts each point once, though its four squares err in part apart.
    assert 0.4 < np.std(found) / np.mean(found) / doubt < 1.3
