"""How firmly points hold poses, against dense matrices and plain differences."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from support.rooms import path_through, scans_of

from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.curvature import (
    DAMPING,
    LEAST_HELD,
    LEAST_SHOWN,
    ROUGHLY,
    SMOOTHED,
    drawn_deviation,
    held_share,
    in_common,
    map_squares,
    numbers_fitted,
    shown_variance,
    widening,
)
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.normal_equations import NormalEquations
from ogm_mcmc.trajectory.points import ScanPoints, poses_of
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

COUNT = 6
STAGE = Stage(side_m=0.2, cut_m=0.05, flatness=0.3, steps=1)
TRUTH = path_through(COUNT)
FACTORS = PoseFactors.of([PoseBelief(pose) for pose in poses_of(TRUTH)], (0.05, 0.05, 0.03))


def dense(times) -> np.ndarray:
    units = np.eye(3 * COUNT).reshape(-1, COUNT, 3)
    return np.array([times(unit).reshape(-1) for unit in units]).T


def around(points: ScanPoints) -> NormalEquations:
    system = SurfelSystem.around(points, TRUTH, STAGE)
    return NormalEquations.around(system, FACTORS, TRUTH)


def test_draws_are_solutions_of_the_matrix() -> None:
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    equations = around(points)
    system, at = equations.system, equations.at
    drawn = drawn_deviation(equations, np.random.default_rng(0))
    rng = np.random.default_rng(0)
    noise = system.noise(rng) + FACTORS.noise(at, rng)
    matrix = dense(system.times) + dense(lambda x: FACTORS.times(at, x))
    expected = np.linalg.solve(matrix, noise.reshape(-1))
    np.testing.assert_allclose(drawn.reshape(-1), expected, atol=5e-3 * np.abs(expected).max())


def test_only_what_points_hold_is_drawn_wider() -> None:
    """Points that scatter more, beliefs as they say: a sandwich, written down."""
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    equations = around(points)
    system, at = equations.system, equations.at
    assert 0.5 < system.slope < 1.0
    assert widening(system, 1.0) == 1.0
    assert widening(system, 0.4) == pytest.approx(system.slope / 0.4)
    rng = np.random.default_rng(6)
    drawn = [drawn_deviation(equations, rng, 3.0).reshape(-1) for _ in range(400)]
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


def test_where_rounding_alone_holds_poses_nothing_is_asked() -> None:
    """One scan by itself, shifted: its lines go with it, but for the last digit."""
    alone = TRUTH[:1]
    points = ScanPoints.of(scans_of(alone, 90, 0.02))
    system = SurfelSystem.around(points, alone, STAGE)
    square = map_squares(points, alone, system)
    for heading in np.linspace(0.0, np.pi, 7):
        shift = np.array([[np.cos(heading), np.sin(heading), 0.0]])
        assert shown_variance(system, square, shift) == 1.0
        assert held_share(system, points, alone, STAGE, shift) == 1.0
    turn = np.array([[0.0, 0.0, 1.0]])  # lines stay as they run
    assert shown_variance(system, square, turn) < 1.0
    assert held_share(system, points, alone, STAGE, turn) == LEAST_HELD


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
    equations = around(points)
    system, at = equations.system, equations.at
    rng = np.random.default_rng(2)
    drawn = [drawn_deviation(equations, rng, accuracy=ROUGHLY) for _ in range(200)]
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


def smoothing(system: SurfelSystem, at) -> np.ndarray:
    matrix = dense(system.times) + dense(lambda x: FACTORS.times(at, x))
    own = block_diag(*np.linalg.inv(system.blocks + at.blocks))
    once = np.eye(3 * COUNT) - DAMPING * own @ matrix
    return np.linalg.matrix_power(once, SMOOTHED)


def test_what_stretches_have_in_common_is_left_by_steps_of_jacobi() -> None:
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    equations = around(points)
    system, at = equations.system, equations.at
    moved = np.random.default_rng(3).normal(size=(COUNT, 3))
    found = in_common(equations, moved)
    np.testing.assert_allclose(found.reshape(-1), smoothing(system, at) @ moved.reshape(-1))


def test_what_stretches_have_in_common_is_drawn_wider_and_nothing_else() -> None:
    """Twice as wide: (I + S) times what points do to poses, to the last digit of a draw."""
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    equations = around(points)
    system, at = equations.system, equations.at
    rng = np.random.default_rng(0)
    drawn = drawn_deviation(equations, rng, 1.5, accuracy=1e-12, together=2.0)
    rng = np.random.default_rng(0)
    of_points, of_beliefs = 1.5 * system.noise(rng), FACTORS.noise(at, rng)
    matrix = dense(system.times) + dense(lambda x: FACTORS.times(at, x))
    by_points = np.linalg.solve(matrix, of_points.reshape(-1))
    expected = by_points + smoothing(system, at) @ by_points
    expected += np.linalg.solve(matrix, of_beliefs.reshape(-1))
    np.testing.assert_allclose(drawn.reshape(-1), expected, rtol=1e-6, atol=1e-9)


def test_shown_variance_is_a_sum_over_squares() -> None:
    """Against sums written down: entries by their squares, the mean of every line taken out."""
    points = ScanPoints.of(scans_of(TRUTH, 90, 0.02))
    system = SurfelSystem.around(points, TRUTH, STAGE)
    square = map_squares(points, TRUTH, system)
    ends = np.floor(points.placed(TRUTH)[system.point] / 1.6).tolist()
    assert len({(a, *end) for a, end in zip(square, ends, strict=True)}) == square.max() + 1
    moved = np.random.default_rng(3).normal(size=(COUNT, 3))
    along = (system.jacobian * moved[system.scan]).sum(axis=1)
    pulls: dict[int, float] = {}
    for a, v in enumerate(system.surfel):
        line = system.surfel == v
        off = along[a] - np.average(along[line], weights=system.weight[line])
        pulls[square[a]] = pulls.get(square[a], 0.0) + system.weight[a] * system.residual[a] * off
    size = moved.reshape(-1) @ dense(system.times) @ moved.reshape(-1)
    expected = sum(pull**2 for pull in pulls.values()) / size / system.slope**2 / system.freedom
    assert shown_variance(system, square, moved) == pytest.approx(expected)
    assert shown_variance(system, square, np.zeros((COUNT, 3))) == 1.0
    exact = system._replace(residual=np.zeros_like(system.residual))
    assert shown_variance(exact, square, moved) == LEAST_SHOWN


@pytest.mark.parametrize(('shared_m', 'expected'), [(0.0, 1.0), (0.02, 5.0)])
def test_errors_that_squares_share_are_seen_where_they_add_up(
    shared_m: float, expected: float
) -> None:
    """The variance that is known: independent errors, or 20 of a square and scan that share one.

    With s^2 of a point by itself and t^2 shared by n, a mean has (s^2 / n + t^2) / (s^2 / n) times
    the variance, here 1 + 20 t^2 / s^2 where s^2 + t^2 is what single points show.
    """
    rng, squares, count = np.random.default_rng(1), 400, 20
    # Lines, a square each: half of the points of either scan, which are pulled apart.
    surfel = np.repeat(np.arange(squares), 2 * count)
    scan = np.tile(np.repeat((0, 1), count), squares)
    shared = shared_m * rng.standard_normal((squares, 2))[surfel, scan]
    own_m = 0.04
    residual = shared + own_m * rng.standard_normal(surfel.size)
    variance = own_m**2 + shared_m**2
    total = np.bincount(surfel) / variance
    residual -= (np.bincount(surfel, residual) / (2 * count))[surfel]
    nowhere = np.zeros((2, 3))
    system = SurfelSystem(
        residual=residual,
        jacobian=np.tile((1.0, 0.0, 0.0), (surfel.size, 1)),
        weight=np.full(surfel.size, 1.0 / variance),
        surfel=surfel,
        point=np.arange(surfel.size),
        scan=scan,
        total=total,
        blocks=np.zeros((2, 3, 3)),
        gradient=nowhere,
        variance=variance,
        slope=1.0,
        doubt=0.0,
        freedom=1.0,
    )
    apart = np.array(((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))
    known = (own_m**2 + count * shared_m**2) / variance
    assert known == pytest.approx(expected, rel=0.05)
    assert shown_variance(system, surfel, apart) == pytest.approx(known, rel=0.2)
