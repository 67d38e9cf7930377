"""End points of beams, by hand."""

import numpy as np
import pytest

from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.trajectory.points import ScanPoints, poses_of, xyyaw


def scan(*ranges: float) -> Scan:
    return Scan.checked(
        np.array(ranges, np.float32),
        angle_min_rad=0.0,
        angle_increment_rad=np.pi / 2.0,
        range_min_m=0.1,
        range_max_m=10.0,
    )


def test_only_beams_that_returned_are_points() -> None:
    points = ScanPoints.of([scan(1.0, np.inf, np.nan), scan(0.05, 2.0, 11.0)])
    np.testing.assert_allclose(points.local, [(1.0, 0.0), (0.0, 2.0)], atol=1e-7)
    assert points.scan.tolist() == [0, 1]
    assert points.starts.tolist() == [0, 1, 2]


def test_points_are_placed_by_the_pose_of_their_scan() -> None:
    points = ScanPoints.of([scan(1.0), scan(1.0)])
    placed = points.placed(np.array([(1.0, 2.0, np.pi / 2.0), (5.0, 0.0, np.pi)]))
    np.testing.assert_allclose(placed, [(1.0, 3.0), (4.0, 0.0)], atol=1e-7)


def test_far_points_are_left_out() -> None:
    assert ScanPoints.of([scan(1.0, 5.0)], max_range_m=4.0).local.shape == (1, 2)


def test_no_return_at_all_is_refused() -> None:
    with pytest.raises(WindowError, match='no beam of 2 scans returned'):
        ScanPoints.of([scan(np.inf), scan(np.nan)])


def test_poses_come_back_from_rows() -> None:
    poses = [Pose2D(1.0, 2.0, 3.0), Pose2D(-1.0, 0.0, -3.0)]
    back = xyyaw(poses_of(xyyaw(poses) + np.array([0.0, 0.0, 2.0 * np.pi])))
    np.testing.assert_allclose(back, xyyaw(poses))
