"""Moves between scans: their tails, their scales, and that a slip of the wheels moves nothing."""

import numpy as np
import pytest

from ogm_mcmc.trajectory.moves import CAUTION, HEAVY_TAILS, LEAST_SCALE, Moves, relative_poses
from ogm_mcmc.trajectory.points import wrapped

ORDER = np.arange(300)


def walked(count: int = 300) -> np.ndarray:
    """Return poses (count, 3) of a walk."""
    rng = np.random.default_rng(1)
    poses = np.cumsum(rng.normal(size=(count, 3)) * (0.5, 0.1, 0.3), axis=0)
    return wrapped(poses)


def shaken(poses: np.ndarray, sigma: tuple[float, float, float]) -> np.ndarray:
    rng = np.random.default_rng(2)
    return wrapped(poses + rng.normal(size=poses.shape) * np.array(sigma) / np.sqrt(2.0))


def test_far_off_a_student_move_says_little_and_near_by_what_a_normal_one_says() -> None:
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    normal = Moves.of_odometry(poses, [0, 1], share=0.0, least=(0.1, 0.1, 0.1))
    heavy = normal._replace(freedom=HEAVY_TAILS)
    for off, weight in ((0.0, 2.0), (1.0, 6.0 / 103.0)):
        error = np.array([(off, 0.0, 0.0)])
        squares = heavy.squares(error)
        assert heavy.weights(squares) == pytest.approx(weight)
        assert normal.weights(squares) == pytest.approx(1.0)
    away = poses + np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    assert normal.log_densities(away) == pytest.approx(-50.0)
    assert heavy.log_densities(away) == pytest.approx(-3.0 * np.log1p(100.0 / 3.0))


def likeliest_scale(moves: Moves, poses: np.ndarray, caution: float) -> float:
    """Return the scale under which moves between known poses are likeliest, among many.

    With them so many more that fit a scale of 1, of weight 1.
    """
    tried = np.geomspace(0.1, 20.0, 400)
    said = [
        moves.scaled(np.array([scale])).log_densities(poses).sum()
        - 1.5 * moves.first.size * np.log(scale)
        - 1.5 * caution * (np.log(scale) + 1.0 / scale)
        for scale in tried
    ]
    return float(tried[int(np.argmax(said))])


@pytest.mark.parametrize('times', [1.0, 3.0])
def test_poses_that_are_known_show_how_good_moves_are(times: float) -> None:
    truth = walked()
    sigma = (0.02, 0.02, 0.01)
    moves = Moves.of_odometry(
        shaken(truth, tuple(times * s for s in sigma)), ORDER,
        share=0.0, least=sigma, freedom=HEAVY_TAILS,
    )  # fmt: skip
    sure = np.tile(1e9 * np.eye(3), (len(truth), 1, 1))
    scales = np.ones(1)
    for _ in range(30):
        scales = moves.shown_scales(truth, sure, scales)
    # Of normal errors the scale of a Student distribution is a little smaller.
    assert 0.5 * times**2 < likeliest_scale(moves, truth, 0.0) < times**2
    likeliest = likeliest_scale(moves, truth, CAUTION)
    if times == 1.0:  # no source is surer than it says
        assert likeliest < 1.0
        assert scales[0] == LEAST_SCALE
    else:
        assert scales[0] == pytest.approx(likeliest, rel=0.01)


def test_poses_that_nothing_else_tells_of_leave_scales_as_they_are() -> None:
    truth = walked()
    moves = Moves.of_localizer(truth, ORDER)
    nothing = np.tile(1e-12 * np.eye(3), (len(truth), 1, 1))
    scales = np.full(1, 2.0)
    for _ in range(3):
        scales = moves.shown_scales(truth, nothing, scales)
    # Weights of two in the middle of heavy tails, and no error to make up for them.
    assert 1.0 <= scales[0] <= 2.0


def test_sources_keep_scales_of_their_own() -> None:
    truth = walked()
    good = Moves.of_localizer(truth, ORDER)
    both = good.and_those(Moves.of_wheels(shaken(truth, (1.0, 1.0, 0.4)), ORDER))
    assert both.n_sources == 2
    sure = np.tile(1e9 * np.eye(3), (len(truth), 1, 1))
    scales = np.ones(2)
    for _ in range(20):
        scales = both.shown_scales(truth, sure, scales)
    assert scales[0] == LEAST_SCALE
    assert scales[1] > 20.0
    scaled = both.scaled(scales)
    np.testing.assert_allclose(scaled.precision[0] * scales[0], both.precision[0])
    np.testing.assert_allclose(scaled.precision[-1] * scales[1], both.precision[-1])


@pytest.mark.parametrize('turned', [False, True])
def test_sources_keep_tails_of_their_own(turned: bool) -> None:
    """Normal moves stay normal beside those of a localizer, and its own stay heavy."""
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    heavy = Moves.of_localizer(poses, np.arange(2))
    normal = Moves.of_odometry(poses, np.arange(2), share=0.0, least=(0.1, 0.1, 0.1))
    pair = (normal, heavy) if turned else (heavy, normal)
    both = Moves.none().and_those(pair[0]).and_those(pair[1])
    away = poses + np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    alone = [float(one.log_densities(away)[0]) for one in pair]
    assert both.log_densities(away) == pytest.approx(alone)
    squares = np.array([0.0, 4.0])
    expected = [one.weights(squares[[k]])[0] for k, one in enumerate(pair)]
    assert both.weights(squares) == pytest.approx(expected)
    assert both.scaled(np.array([2.0, 3.0])).log_densities(away) == pytest.approx(
        [
            one.scaled(np.array([s])).log_densities(away)[0]
            for one, s in zip(pair, (2, 3), strict=True)
        ]
    )


def test_scans_without_odometry_have_no_moves() -> None:
    poses = walked(5)
    poses[2] = np.nan
    moves = Moves.of_wheels(poses, np.array([0, 1, 2, 3, 4]))
    np.testing.assert_array_equal(moves.first, [0, 3])
    np.testing.assert_array_equal(moves.second, [1, 4])
    np.testing.assert_allclose(moves.errors(poses), 0.0, atol=1e-12)
    assert Moves.none().n_sources == 0
    np.testing.assert_allclose(moves.move, relative_poses(poses[[0, 3]], poses[[1, 4]]))
