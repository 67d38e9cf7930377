"""Trajectories to TUM files and back."""

from pathlib import Path

import numpy as np
import pytest

from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.io.tum_files import read_tum, write_tum

COVARIANCE = np.diag([0.04, 0.01, 0.0001])


def test_poses_come_back(tmp_path: Path) -> None:
    path = tmp_path / 'refined.tum'
    beliefs = [PoseBelief(Pose2D(1.5, -2.0, 3.1)), PoseBelief(Pose2D(0.0, 0.0, -1.0))]
    assert write_tum(path, [1_000_000_001, 2_500_000_000], beliefs) == [path]
    stamps, poses = read_tum(path)
    np.testing.assert_allclose(stamps, [1.000000001, 2.5], rtol=1e-12)
    np.testing.assert_allclose(poses, [(1.5, -2.0, 3.1), (0.0, 0.0, -1.0)], atol=1e-6)
    assert path.read_text().splitlines()[0].startswith('1.000000001 1.500000 -2.000000 0 0 0 0.99')


def test_deviations_lie_beside_them(tmp_path: Path) -> None:
    path = tmp_path / 'refined.tum'
    written = write_tum(path, [0], [PoseBelief(Pose2D(), COVARIANCE)])
    assert written[1].read_text().splitlines() == [
        'stamp_s,x_m,y_m,yaw_rad',
        '0.000000000,0.200000,0.100000,0.010000',
    ]


def test_anything_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'poses.tum'
    path.write_text('1 2 3\n')
    with pytest.raises(LogError, match='expected 8'):
        read_tum(path)
