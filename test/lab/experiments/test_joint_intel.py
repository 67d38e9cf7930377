"""Refining Intel: that only even beams move poses, and what is compared with what."""

import numpy as np
import pytest
from support.rooms import path_through, scans_of

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.evaluation.trajectories import Relations, absolute_errors
from ogm_mcmc.lab.experiments import joint_intel

TRUTH = path_through(8)
CONFIG = TrajectoryConfig(draws=2)


@pytest.fixture
def recorded() -> joint_intel.Recorded:
    first = np.arange(7)
    relations = Relations(first, first + 1, np.zeros((7, 3)))
    exact = Relations(*(of[:2] for of in relations))
    return joint_intel.Recorded(
        scans_of(TRUTH, 240, 0.01), TRUTH, np.arange(8), relations, TRUTH + 0.3, exact,
        0.1 * np.arange(8),
    )  # fmt: skip


def test_odd_beams_move_no_pose(recorded: joint_intel.Recorded) -> None:
    rng = np.random.default_rng(0)
    start = TRUTH + rng.normal(size=TRUTH.shape) * (0.05, 0.05, 0.02)
    poses = joint_intel.refined(recorded, start, (0.05, 0.05, 0.02), CONFIG).poses
    for scan in recorded.scans:
        scan.ranges_m[1::2] = rng.uniform(1.0, 5.0, 120)
    again = joint_intel.refined(recorded, start, (0.05, 0.05, 0.02), CONFIG).poses
    np.testing.assert_array_equal(again, poses)
    assert absolute_errors(poses, TRUTH).distance_m.mean() < 0.01


def test_starts_are_as_far_off_as_they_say(recorded: joint_intel.Recorded) -> None:
    starts = {name: poses - TRUTH for name, poses, _ in joint_intel.starts_of(recorded, 1)}
    assert list(starts) == ['given', 'noise', 'drift', 'rough']
    assert np.abs(starts['given']).max() == 0.0
    assert 0.02 < starts['noise'][:, :2].std() < 0.08
    assert 0.2 < np.abs(starts['drift'][:, :2]).max() <= 0.3


def test_rows_of_relations_name_their_number(recorded: joint_intel.Recorded) -> None:
    line, exact = joint_intel.relations_rows('given', recorded, TRUTH, 0.017)
    steps = np.hypot(*np.diff(TRUTH[:, :2], axis=0).T)
    assert line['ours'] == pytest.approx(steps.mean())
    assert exact['ours'] == pytest.approx(steps[:2].mean())
    assert (line['published'], exact['published']) == (0.017, None)
    assert line['remark'].endswith('7 relations')
    assert exact['remark'].endswith('2 exact relations')
