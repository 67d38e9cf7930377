"""Looking scans up in what others saw."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.rooms import drifted, path_through, scans_of

from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory import correlative
from ogm_mcmc.trajectory.correlative import (
    LookUp,
    look_up_along,
    look_up_in_turn,
    recheck,
    relocate,
)
from ogm_mcmc.trajectory.correlative_kernels import paint_free
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.moves import Moves
from ogm_mcmc.trajectory.points import ScanPoints, poses_of

TRUTH = path_through(8)
POINTS = ScanPoints.of(scans_of(TRUTH, 120, 0.01))
NEAR = LookUp(reach_m=0.8, reach_rad=0.2)


def factors_around(poses: np.ndarray) -> PoseFactors:
    return PoseFactors.of([PoseBelief(pose) for pose in poses_of(poses)], (0.5, 0.5, 0.1))


def test_far_poses_are_found_one_after_the_other() -> None:
    start = TRUTH + np.random.default_rng(0).uniform(-1, 1, TRUTH.shape) * (0.5, 0.5, 0.15)
    start[0] = TRUTH[0]
    found = look_up_in_turn(POINTS, factors_around(start), np.arange(len(TRUTH)), NEAR)
    assert np.hypot(*(start - TRUTH)[:, :2].T).mean() > 0.3
    off = found - TRUTH
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert np.abs(off[:, 2]).max() < 0.03


def test_moves_lead_back_into_the_map_that_odometry_left() -> None:
    """Each step errs by 15 cm to the same side: the last is off by more than is looked at."""
    odometry = drifted(TRUTH, (0.12, 0.09, 0.03))
    assert np.hypot(*(odometry - TRUTH)[-1, :2]) > 0.8
    order = np.arange(len(TRUTH))
    found = look_up_along(POINTS, odometry, Moves.of_wheels(odometry, order), order, NEAR)
    assert np.abs(found - TRUTH).max() < 0.1


def test_a_field_is_made_wider_where_moves_lead_out_of_it() -> None:
    """All start at one place: the moves alone say how far the others are."""
    order = np.arange(len(TRUTH))
    start = np.tile(TRUTH[0], (len(TRUTH), 1))
    found = look_up_along(POINTS, start, Moves.of_wheels(TRUTH, order), order, NEAR)
    assert np.abs(found - TRUTH).max() < 0.1


def test_a_scan_astray_is_put_back_and_no_other_is_moved() -> None:
    astray = TRUTH.copy()
    astray[3] += (0.7, -0.5, 0.1)
    found = relocate(POINTS, astray, factors_around(TRUTH), NEAR)
    moved = np.flatnonzero(np.abs(found - astray).max(axis=1) > 0.0)
    assert moved.tolist() == [3]
    assert np.abs(found[3] - TRUTH[3]).max() < 0.1


def test_poses_that_fit_better_elsewhere_are_given_up_and_no_others() -> None:
    """One scan is off by more than alignment reaches, one by more than is looked at near by."""
    astray = TRUTH.copy()
    astray[2] += (0.3, 0.0, 0.3)
    astray[5] += (1.2, -0.9, 0.6)
    around, far = LookUp(reach_m=0.5, reach_rad=0.4), LookUp(reach_m=2.0, reach_rad=0.8)
    found = recheck(POINTS, astray, factors_around(TRUTH), around, far)
    moved = np.flatnonzero(np.abs(found - astray).max(axis=1) > 0.0)
    assert moved.tolist() == [2, 5]
    assert np.abs(found[moved] - TRUTH[moved]).max() < 0.1
    again = recheck(POINTS, found, factors_around(TRUTH), around, far)
    np.testing.assert_array_equal(again, found)


def test_a_scan_that_fits_two_places_alike_lies_where_nobody_looked_through() -> None:
    """One scan saw a wall at 2 m on the right, at 3 m on the left, the other one long wall."""
    y = np.linspace(-1.0, 1.0, 41)
    seen = np.column_stack((np.where(y < 0.0, 2.0, 3.0), y))
    local = np.concatenate((seen, np.column_stack((np.ones_like(y), y))))
    starts = np.array([0, 41, 82])
    points = ScanPoints(local, np.repeat([0, 1], 41), starts)
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])  # the long wall at 2 m
    factors = factors_around(np.array([(0.0, 0.0, 0.0), (1.4, 0.0, 0.0)]))
    settings = LookUp(reach_m=0.8, reach_rad=0.05)
    blind = relocate(points, poses, factors, settings, np.array([1]))
    assert blind[1, 0] < 1.2
    knowing = relocate(points, poses, factors, replace(settings, in_free=0.01), np.array([1]))
    assert abs(knowing[1, 0] - 2.0) < 0.15


def test_beams_make_free_what_they_pass_and_nothing_else() -> None:
    field = np.zeros((20, 30), np.float32)
    field[10, 8], field[10, 9] = 0.3, 0.8  # something was seen here, a little and for sure
    paint_free(field, 2.5, 10.5, np.array([22.5, 2.6]), np.array([10.5, 10.5]), 4.0, 0.5, -2.0)
    expected = np.zeros_like(field)
    expected[10, 2:19] = -2.0
    expected[10, 9] = 0.8
    np.testing.assert_array_equal(field, expected.astype(np.float32))


def test_points_near_others_are_told_by_a_plain_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an array of no dimension the kernel would be compiled once more."""
    given: list[type] = []
    monkeypatch.setattr(correlative, 'paint_free', lambda *a: given.extend(map(type, a[5:])))
    relocate(POINTS, TRUTH, factors_around(TRUTH), replace(NEAR, in_free=0.5), np.array([1]))
    assert set(given) == {float}


@pytest.mark.parametrize(('usual', 'looked_at'), [(10.0, [4]), (-10.0, []), (0.0, [])])
def test_scans_fit_badly_where_most_fit_well_only(
    usual: float, looked_at: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A share of what is usual says nothing where points of most scans lie in free space."""
    far = LookUp(reach_m=4.0)
    found: list[int] = []

    def look_up(field: Any, k: int, at: Any, factors: Any, *, wide: bool) -> tuple[float, Any]:
        found.extend([k] if field.settings is far else [])
        count = POINTS.starts[k + 1] - POINTS.starts[k]
        return float(count * (usual - 9.0 * (k == 4))), at

    monkeypatch.setattr(correlative._Field, 'look_up', look_up)
    recheck(POINTS, TRUTH, factors_around(TRUTH), NEAR, far)
    assert found == looked_at
