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
    assert read_deviations(path, found.stamps_ns) is None


def test_deviations_lie_beside_them(tmp_path: Path) -> None:
    path = tmp_path / 'refined.txt'
    _, beside = write_beliefs(path, [0], [PoseBelief(Pose2D(), COVARIANCE)])
    assert beside.name == 'refined_deviations.csv'
    assert beside.read_text().splitlines() == [
        'stamp_s,x_m,y_m,yaw_rad',
        '0.000000000,0.20000000,0.10000000,0.01000000',
    ]
    for apart in (False, True):
        found = read_deviations(path, np.array([400]), apart=apart)
        np.testing.assert_allclose(found, [(0.2, 0.1, 0.01)])


def test_deviations_without_what_all_poses_have_in_common(tmp_path: Path) -> None:
    path = tmp_path / 'refined.txt'
    write_beliefs(path, [0], [PoseBelief(Pose2D(), COVARIANCE)], np.array([(0.02, 0.03, 0.004)]))
    np.testing.assert_allclose(read_deviations(path, np.array([0])), [(0.2, 0.1, 0.01)])
    found = read_deviations(path, np.array([0]), apart=True)
    np.testing.assert_allclose(found, [(0.02, 0.03, 0.004)])


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('1,1,2,0\n2,1,2,0', 'deviations of 2 poses: expected those of 1 in .*refined.txt'),
        ('', 'deviations of 0 poses'),
        ('0.1,0.2,0.3', "line 2 has 3 of 4 numbers: '0.1,0.2,0.3'"),
        ('1,1,2,0,1,2,0', 'line 2 has 7 of 4 numbers'),
        ('\n# by hand\n1,1,2,-1  # sic', 'line 4 has 1, 2, -1'),
        ('\n\n2,1,2,1', 'line 4 is of 2 s'),
        ('\n1,1,,1', "line 3: expected numbers, not '1,1,,1'"),
        ('1,1,2,-1', 'line 2 has 1, 2, -1: expected standard deviations from 0 to 1000'),
        ('1,nan,2,1', 'line 2 has nan, 2, 1'),
        ('1,1,1e9,1', r'line 2 has 1, 1e\+09, 1'),
        ('1.002,1,2,1', 'line 2 is of 1.002 s: expected 1 s, the stamp of that pose'),
        ('nan,1,2,1', 'line 2 is of nan s'),
        ('1,1,two,1', "line 2: expected numbers, not '1,1,two,1'"),
    ],
)
def test_deviations_of_something_else_are_refused(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / 'refined_deviations.csv').write_text(f'stamp_s,x_m,y_m,yaw_rad\n{line}\n')
    with pytest.raises(PoseError, match=f'refined_deviations.csv: {said}') as refused:
        read_deviations(tmp_path / 'refined.txt', np.array([10**9]))
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('1,1,2,0\n', "line 1 is '1,1,2,0': expected stamp_s,x_m,y_m,yaw_rad, or stamp_s,"),
        ('# by hand\n\nstamp_s,yaw_rad,x_m,y_m\n1,0,1,2\n', "line 3 is 'stamp_s,yaw_rad,x_m,y_m'"),
        ('stamp_s,x_m,y_m,yaw_rad,x_apart_m\n1,1,2,0,1\n', 'line 1 is'),
        ('', "line 1 is ''"),
        ('\x00' * 200, r"line 1 is '(\\x00){80}':"),
    ],
)
def test_columns_are_known_by_their_names(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / 'refined_deviations.csv').write_text(text)
    with pytest.raises(PoseError, match=f'refined_deviations.csv: {said}') as refused:
        read_deviations(tmp_path / 'refined.txt', np.array([10**9]))
    assert len(str(refused.value).splitlines()) == 1


def test_remarks_and_blank_lines_are_passed_over(tmp_path: Path) -> None:
    text = '# by hand\n\nstamp_s, x_m, y_m, yaw_rad\n\n1, 0.1, 0.2, 0.3  # a guess\n'
    (tmp_path / 'refined_deviations.csv').write_text(text)
    found = read_deviations(tmp_path / 'refined.txt', np.array([10**9]))
    np.testing.assert_allclose(found, [(0.1, 0.2, 0.3)])
