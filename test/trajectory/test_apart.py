"""Deviations of poses without what all of them have in common."""

import numpy as np
import pytest

from ogm_mcmc.trajectory.apart import moved_as_one, without_common_motion

POSES = np.array([(0.0, 0.0, 0.3), (4.0, 0.0, 2.0), (4.0, 2.0, -1.0), (0.0, 2.0, 0.0)])


def test_a_rigid_motion_of_all_poses_is_nothing():
    shift, turn = np.array([0.3, -0.2]), 0.01
    moved = np.column_stack((-turn * POSES[:, 1], turn * POSES[:, 0], np.full(4, turn)))
    moved[:, :2] += shift
    left = without_common_motion(np.stack((moved, -2.0 * moved)), POSES)
    np.testing.assert_allclose(left, 0.0, atol=1e-15)


def test_what_is_left_of_one_pose_that_errs():
    """Middle (2, 1), squared levers 5 each: a step of 1 along x turns all by 1 / 20."""
    drawn = np.zeros((1, 4, 3))
    drawn[0, 0, 0] = 1.0
    left = without_common_motion(drawn, POSES)[0]
    assert np.allclose(left[:, 2], -0.05)
    assert np.allclose(left[0, :2], (0.75 - 0.05, 0.1))
    assert np.allclose(left[2, :2], (-0.25 + 0.05, -0.1))
    assert np.allclose(without_common_motion(left[None], POSES)[0], left)


def test_headings_at_one_place():
    drawn = np.zeros((1, 2, 3))
    drawn[0, :, 2] = 0.1, 0.3
    left = without_common_motion(drawn, np.zeros((2, 3)))
    assert np.allclose(left[0, :, 2], (-0.1, 0.1))


def test_all_poses_are_moved_by_what_is_asked_and_keep_what_they_are_apart():
    drawn = np.random.default_rng(3).normal(size=POSES.shape)
    motion = np.array([0.4, -0.2, 0.05])
    moved = moved_as_one(drawn, POSES, motion)
    apart = without_common_motion(drawn[None], POSES)[0]
    assert np.allclose(without_common_motion(moved[None], POSES)[0], apart)
    common = moved - apart
    assert np.allclose(common[:, :2].mean(axis=0), motion[:2])
    assert np.allclose(common[:, 2], 0.05)
    middle = POSES[:, :2].mean(axis=0)
    for pose, (x, y, _) in zip(POSES, common, strict=True):
        east, north = pose[:2] - middle
        assert (x, y) == pytest.approx((0.4 - 0.05 * north, -0.2 + 0.05 * east))
