"""Factors of poses: derivatives against differences, products against matrices."""

import math

import numpy as np
import pytest

from ogm_mcmc.geometry import Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.trajectory.alike import Alike
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.moves import Moves, relative_poses

COUNT, STEP = 4, 1e-6


@pytest.fixture(params=['independent', 'alike'])
def factors(request: pytest.FixtureRequest) -> PoseFactors:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(COUNT, 3, 3))
    beliefs = [
        PoseBelief(Pose2D(*rng.normal(size=3)), root[k] @ root[k].T + 0.2 * np.eye(3))
        for k in range(COUNT)
    ]
    odometry = rng.normal(size=(COUNT, 3))
    moves = Moves.of_odometry(odometry, np.array([0, 2, 1, 3]), share=0.1, least=(0.3, 0.2, 0.1))
    found = PoseFactors.of(beliefs, (1.0, 1.0, 1.0), moves)
    if request.param == 'independent':
        return found
    alike = Alike(np.array([0, 2]), np.array([2, 1]), np.array([0.9, 0.9, 0.5]), 0.1)
    return found._replace(alike=alike)


def dense(times: object) -> np.ndarray:
    columns = []
    for i in range(3 * COUNT):
        unit = np.zeros(3 * COUNT)
        unit[i] = 1.0
        columns.append(times(unit.reshape(COUNT, 3)).reshape(-1))  # type: ignore[operator]
    return np.array(columns).T


def test_the_gradient_is_that_of_the_density(factors: PoseFactors) -> None:
    poses = np.random.default_rng(4).normal(scale=0.3, size=(COUNT, 3)) + factors.mean
    numeric = np.zeros((COUNT, 3))
    for k in range(COUNT):
        for axis in range(3):
            step = np.zeros((COUNT, 3))
            step[k, axis] = STEP
            up, down = factors.log_density(poses + step), factors.log_density(poses - step)
            numeric[k, axis] = (up - down) / (2.0 * STEP)
    np.testing.assert_allclose(factors.linearised(poses).gradient, numeric, rtol=1e-5, atol=1e-5)


def test_products_and_blocks_belong_to_one_symmetric_matrix(factors: PoseFactors) -> None:
    at = factors.linearised(factors.mean)
    matrix = dense(lambda x: factors.times(at, x))
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    for k in range(COUNT):
        own = slice(3 * k, 3 * k + 3)
        np.testing.assert_allclose(matrix[own, own], at.blocks[k], rtol=1e-9, atol=1e-9)


def test_noise_has_the_precision_as_its_covariance(factors: PoseFactors) -> None:
    at = factors.linearised(factors.mean)
    rng = np.random.default_rng(5)
    drawn = np.array([factors.noise(at, rng).reshape(-1) for _ in range(8000)])
    matrix = dense(lambda x: factors.times(at, x))
    size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    assert np.abs((drawn.T @ drawn / len(drawn) - matrix) / size).max() < 0.06


def test_particles_count_with_mean_and_covariance() -> None:
    samples = PoseSamples.checked(np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]))
    belief = PoseBelief(Pose2D(9.0, 9.0), None, samples)
    factors = PoseFactors.of([belief], (1.0, 1.0, 1.0))
    np.testing.assert_allclose(factors.mean, [(1.0, 0.0, 0.0)])
    assert factors.precision[0, 0, 0] == pytest.approx(1.0, rel=1e-5)


def test_a_move_is_seen_from_the_first_pose() -> None:
    first, second = np.array([(1.0, 1.0, np.pi / 2.0)]), np.array([(1.0, 3.0, np.pi)])
    np.testing.assert_allclose(
        relative_poses(first, second), [(2.0, 0.0, np.pi / 2.0)], atol=1e-12
    )


def test_a_covariance_of_zeros_is_none_at_all() -> None:
    said = PoseFactors.of([PoseBelief(Pose2D(), np.zeros((3, 3)))], (0.3, 0.3, 0.1))
    unsaid = PoseFactors.of([PoseBelief(Pose2D())], (0.3, 0.3, 0.1))
    np.testing.assert_array_equal(said.precision, unsaid.precision)


def beliefs_off_by(times: float, count: int = 400) -> tuple[PoseFactors, np.ndarray]:
    """Return factors of beliefs that are off by so many times what they say, and the truth."""
    rng = np.random.default_rng(8)
    root = np.array([[0.1, 0.0, 0.0], [0.05, 0.2, 0.0], [0.01, 0.0, 0.03]])
    truth = rng.normal(size=(count, 3))
    off = times * rng.normal(size=(count, 3)) @ root.T
    beliefs = [PoseBelief(Pose2D(*pose), root @ root.T) for pose in truth + off]
    return PoseFactors.of(beliefs, (0.3, 0.3, 0.1)), truth


@pytest.mark.parametrize('times', [0.5, 1.0, 3.0])
def test_poses_show_how_good_beliefs_are(times: float) -> None:
    said, truth = beliefs_off_by(times)
    sure = np.tile(1e9 * np.eye(3), (len(truth), 1, 1))
    found = said.doubt(truth, sure, said)
    assert np.sqrt(found) == pytest.approx(times, rel=0.1)
    doubted = said.doubted(found)
    np.testing.assert_allclose(doubted.precision, said.precision / found)
    # Of itself, not of what it was made into: again is the same.
    assert doubted.doubt(truth, sure, doubted) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize('share', [0.4, 2.5])
def test_beliefs_are_judged_though_poses_follow_them(share: float) -> None:
    """Scans that are as sure as the beliefs: poses lie half way, and EM still finds the share."""
    said, truth = beliefs_off_by(math.sqrt(share), count=20_000)
    rng = np.random.default_rng(9)
    blocks = said.precision.copy()
    roots = np.linalg.cholesky(np.linalg.inv(blocks))
    seen = truth + np.einsum('kij,kj->ki', roots, rng.normal(size=truth.shape))
    factor = 1.0
    for _ in range(60):
        now = said.doubted(factor)
        right = np.einsum('kij,kj->ki', now.precision, said.mean)
        right += np.einsum('kij,kj->ki', blocks, seen)
        poses = np.linalg.solve(now.precision + blocks, right[..., None])[..., 0]
        factor = said.doubt(poses, blocks, now)
    assert factor == pytest.approx(share, rel=0.1)


def test_scans_that_tell_nothing_leave_beliefs_as_they_are() -> None:
    said, _ = beliefs_off_by(2.0)
    nothing = np.zeros((len(said.mean), 3, 3))
    assert said.doubt(said.mean, nothing, said) == pytest.approx(1.0)


def test_few_beliefs_are_not_doubted_much_and_unsaid_ones_never() -> None:
    said, truth = beliefs_off_by(0.0, count=2)
    sure = np.tile(1e9 * np.eye(3), (2, 1, 1))
    assert said.doubt(truth, sure, said) == pytest.approx(10.0 / 12.0, rel=1e-3)
    unsaid = PoseFactors.of([PoseBelief(Pose2D())], (0.3, 0.3, 0.1))
    assert unsaid.doubt(np.ones((1, 3)), sure[:1], unsaid) == 1.0
    np.testing.assert_array_equal(unsaid.doubted(9.0).precision, unsaid.precision)
