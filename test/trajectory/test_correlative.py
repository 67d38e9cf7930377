"""Looking scans up in what others saw."""

import numpy as np
from support.rooms import path_through, scans_of

from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.correlative import LookUp, look_up_in_turn, recheck, relocate
from ogm_mcmc.trajectory.factors import PoseFactors
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
