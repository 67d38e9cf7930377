"""Points on lines as a quadratic model of poses, against dense matrices."""

import numpy as np
from support.rooms import path_through, scans_of

from ogm_mcmc.trajectory.points import ScanPoints
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

COUNT = 6
STAGE = Stage(side_m=0.4, cut_m=0.1, flatness=0.3, steps=1)
TRUTH = path_through(COUNT)
POINTS = ScanPoints.of(scans_of(TRUTH, 90, 0.01))


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


def test_noise_has_the_precision_as_its_covariance() -> None:
    system = SurfelSystem.around(POINTS, TRUTH, STAGE)
    rng = np.random.default_rng(1)
    drawn = np.array([system.noise(rng).reshape(-1) for _ in range(4000)])
    matrix = dense(system)
    size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    assert np.abs((drawn.T @ drawn / len(drawn) - matrix) / size).max() < 0.08


def test_the_spread_of_points_scatters_as_its_doubt_says() -> None:
    found, doubt = [], 0.0
    for seed in range(40):
        points = ScanPoints.of(scans_of(TRUTH, 90, 0.01, seed))
        system = SurfelSystem.around(points, TRUTH, STAGE)
        found.append(system.variance)
        doubt = system.doubt
    # Doubt counts each point once, though its four squares err in part apart.
    assert 0.4 < np.std(found) / np.mean(found) / doubt < 1.3
