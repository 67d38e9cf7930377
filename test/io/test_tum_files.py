"""Beliefs about trajectories to files and back."""

from pathlib import Path

import numpy as np
import pytest

from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.io.trajectory_files import read_trajectory
from ogm_mcmc.io.tum_files import read_deviations, write_beliefs

COVARIANCE = np.diag([0.04, 0.01, 0.0001])


def test_poses_come_back(tmp_path: Path) -> None:
    path = tmp_path / 'refined.txt'
    beliefs = [PoseBelief(Pose2D(1.5, -2.0, 3.1)), PoseBelief(Pose2D(0.0, 0.0, -1.0))]
    assert write_beliefs(path, [1_000_000_001, 2_500_000_000], beliefs) == [path]
    found = read_trajectory(path)
    assert list(found.stamps_ns) == [1_000_000_001, 2_500_000_000]
    for pose, belief in zip(found.poses, beliefs, strict=True):
        assert pose.x_m == belief.mean.x_m
        assert pose.yaw_rad == pytest.approx(belief.mean.yaw_rad, abs=1e-12)
    assert read_deviations(path, 2) is None


def test_deviations_lie_beside_them(tmp_path: Path) -> None:
    path = tmp_path / 'refined.txt'
    _, beside = write_beliefs(path, [0], [PoseBelief(Pose2D(), COVARIANCE)])
    assert beside.name == 'refined_deviations.csv'
    assert beside.read_text().splitlines() == [
        'stamp_s,x_m,y_m,yaw_rad',
        '0.000000000,0.20000000,0.10000000,0.01000000',
    ]
    np.testing.assert_allclose(read_deviations(path, 1), [(0.2, 0.1, 0.01)])


def test_deviations_of_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'refined.txt'
    _, beside = write_beliefs(path, [0], [PoseBelief(Pose2D(), COVARIANCE)])
    with pytest.raises(PoseError, match='each of 2 poses'):
        read_deviations(path, 2)
    beside.write_text('stamp_s,x_m,y_m,yaw_rad\n0,1,2,-1\n')
    with pytest.raises(PoseError, match='from 0 on'):
        read_deviations(path, 1)
    beside.write_text('stamp_s,x_m,y_m,yaw_rad\n0,1,two,1\n')
    with pytest.raises(PoseError, match='four numbers'):
        read_deviations(path, 1)
