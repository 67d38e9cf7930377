"""Errors of trajectories, by hand."""

import numpy as np
import pytest

from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation.trajectories import (
    absolute_errors,
    coverage,
    relation_errors,
    relations_at,
    relative_errors,
)

TRUTH = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, np.pi / 2.0), (1.0, 2.0, np.pi), (4.0, 2.0, 3.0)])


def moved(poses: np.ndarray, x: float, y: float, turn: float) -> np.ndarray:
    cosine, sine = np.cos(turn), np.sin(turn)
    return np.column_stack(
        (
            x + cosine * poses[:, 0] - sine * poses[:, 1],
            y + sine * poses[:, 0] + cosine * poses[:, 1],
            poses[:, 2] + turn,
        )
    )


def test_a_rigid_motion_is_no_error() -> None:
    whole = moved(TRUTH, 3.0, -2.0, 2.5)
    for errors in (absolute_errors(whole, TRUTH), relative_errors(whole, TRUTH)):
        assert errors.summary() == pytest.approx(dict.fromkeys(errors.summary(), 0.0), abs=1e-6)


def test_one_pose_off_counts_as_evo_has_it() -> None:
    # Symmetric about the middle: the best rigid motion is none.
    truth = np.array([(-1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    poses = truth + np.array([(0.0, 0.1, 0.2), (0.0, -0.2, 0.0), (0.0, 0.1, 0.0)])
    errors = absolute_errors(poses, truth)
    np.testing.assert_allclose(errors.distance_m, [0.1, 0.2, 0.1], atol=1e-12)
    np.testing.assert_allclose(errors.turn_rad, [0.2, 0.0, 0.0], atol=1e-12)
    assert errors.summary()['rmse_m'] == pytest.approx(np.sqrt(0.02))
    assert errors.summary()['max_deg'] == pytest.approx(np.degrees(0.2))


def test_a_turn_of_the_first_pose_moves_what_it_sees() -> None:
    poses = TRUTH.copy()
    poses[0, 2] = 0.1
    errors = relative_errors(poses, TRUTH)
    assert errors.distance_m[0] == pytest.approx(2.0 * np.sin(0.05))
    np.testing.assert_allclose(errors.turn_rad, [0.1, 0.0, 0.0], atol=1e-12)


def test_relations_count_where_both_ends_have_a_pose() -> None:
    rows = [
        (10, 20, 1, 0, 0, 0, 0, np.pi / 2.0),
        (20, 25, 9, 9, 0, 0, 0, 0),
        (30.0005, 20, 2, 0, 0, 0, 0, -1.5),
    ]
    relations = relations_at(np.array(rows), [30.0, 10.0, 20.0])
    assert relations.first.tolist() == [1, 0]
    assert relations.second.tolist() == [2, 2]
    errors = relation_errors(TRUTH[[2, 0, 1]], relations)
    # The third line: from (1, 2) heading left, (1, 0) lies 2 m to the left.
    np.testing.assert_allclose(errors.distance_m, [0.0, np.hypot(2.0, 2.0)], atol=1e-6)
    np.testing.assert_allclose(errors.turn_rad, [0.0, np.pi / 2.0 - 1.5], atol=1e-6)


def test_coverage_is_the_share_within_two_deviations() -> None:
    off = np.array([(0.1, -3.0), (-0.1, 1.9)])
    assert coverage(off, np.ones((2, 2))).tolist() == [1.0, 0.5]


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(GridError, match='expected as many'):
        absolute_errors(TRUTH[:2], TRUTH)
