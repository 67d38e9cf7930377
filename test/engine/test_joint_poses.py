"""Whether poses are estimated where that is left to the data."""

import math

import numpy as np
import pytest

from ogm_mcmc.cli.sample import _that_hold as that_hold
from ogm_mcmc.config import PosesConfig, TrajectoryConfig
from ogm_mcmc.engine.joint_poses import PoseRefinement, choose_joint
from ogm_mcmc.engine.kept_poses import KeptPoses
from ogm_mcmc.engine.poses_beside import PosesBeside
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, PoseSamples, Scan

CELL = 0.1


def placed(covariance: np.ndarray | None, beams: int = 30, **belief: object) -> list[PlacedScan]:
    scan = Scan.checked(
        np.ones(beams), angle_min_rad=0.0, angle_increment_rad=0.01,
        range_min_m=0.0, range_max_m=5.0,
    )  # fmt: skip
    return [PlacedScan(scan, PoseBelief(Pose2D(), covariance, **belief))] * 3


def spread(place_m: float, degrees: float) -> np.ndarray:
    return np.diag(np.square([place_m, place_m, math.radians(degrees)]))


@pytest.mark.parametrize(
    ('scans', 'joint', 'why'),
    [
        (placed(None), False, 'nothing says how sure'),
        (placed(np.zeros((3, 3))), False, 'nothing says how sure'),
        (placed(spread(0.04, 0.4)), False, 'only 4.0 cm and 0.40 degrees unsure'),
        (placed(spread(0.06, 0.4)), True, 'is 6.0 cm and 0.40 degrees unsure, 30 readings'),
        (placed(spread(0.04, 0.6)), True, '0.60 degrees'),
        (placed(spread(0.30, 5.0), beams=19), False, '19 readings a scan are too few'),
    ],
)
def test_poses_are_estimated_where_the_localizer_is_unsure(scans, joint, why):
    choice = choose_joint(scans, PosesConfig('auto'), CELL)
    assert choice.joint == joint
    assert why in choice.why
    assert choose_joint(scans, PosesConfig('joint'), CELL) == (True, '')
    assert choose_joint(scans, PosesConfig('fixed'), CELL) == (False, '')


@pytest.mark.parametrize('covariance', [None, spread(0.01, 0.1)])
def test_poses_of_odometry_are_estimated_whatever_they_say(covariance):
    """What odometry says is of its last steps, if anything: it drifts."""
    choice = choose_joint(placed(covariance), PosesConfig('auto'), CELL, drifting=True)
    assert choice == (
        True,
        'poses joint: they are those of odometry, which drifts, 30 readings a scan',
    )
    few = choose_joint(placed(covariance, beams=19), PosesConfig('auto'), CELL, drifting=True)
    assert few == (False, 'poses fixed: 19 readings a scan are too few')
    assert not choose_joint(placed(None), PosesConfig('fixed'), CELL, drifting=True).joint
    none = choose_joint([], PosesConfig('auto'), CELL, drifting=True)
    assert none == (False, 'poses fixed: 0 readings a scan are too few')


def test_particles_say_how_sure_they_are():
    cloud = PoseSamples.checked(np.array([(-0.2, 0.0, 0.0), (0.2, 0.0, 0.0)]))
    assert choose_joint(placed(None, particles=cloud), PosesConfig('auto'), CELL).joint


@pytest.mark.parametrize(
    ('first', 'stays', 'turns'),
    [
        (spread(0.06, 0.1), spread(0.04, 0.1), spread(0.03, 0.1)),  # m: 0.05 / 1.5
        (spread(0.01, 0.6), spread(0.01, 0.4), spread(0.01, 0.3)),  # degrees: 0.5 / 1.5
        (spread(0.04, 0.1), spread(0.07, 0.7), spread(0.08, 0.1)),
        (spread(0.04, 0.1), spread(0.07, 0.7), spread(0.01, 0.8)),
    ],
)
def test_a_choice_stays_until_beliefs_clearly_speak_against_it(first, stays, turns):
    """Else it flips near the threshold, and every flip moves the map and begins chains anew."""
    kept = KeptPoses(PosesConfig('auto'))
    chosen = kept.choose(placed(first), CELL).joint
    for _ in range(3):
        assert choose_joint(placed(stays), PosesConfig('auto'), CELL).joint != chosen
        assert kept.choose(placed(stays), CELL).joint == chosen
        assert kept.choose(placed(first), CELL).joint == chosen
    assert kept.choose(placed(turns), CELL).joint != chosen
    assert kept.choose(placed(stays), CELL).joint != chosen
    kept.forget()
    assert kept.choose(placed(first), CELL).joint == chosen


def test_joint_poses_stay_with_somewhat_fewer_readings():
    kept = KeptPoses(PosesConfig('auto'))
    found = [
        kept.choose(placed(spread(0.3, 5.0), beams=beams), CELL).joint
        for beams in (19, 20, 19, 14, 13, 19, 20)
    ]
    assert found == [False, True, True, True, False, False, True]


def test_a_choice_that_stays_is_said_once():
    said = []
    kept = KeptPoses(PosesConfig('auto'), said.append)
    for sigma in (0.06, 0.04, 0.06, 0.04):
        assert kept.choose(placed(spread(sigma, 0.1)), CELL).joint
    assert len(said) == 1


@pytest.mark.parametrize('drifting', [True, False])
def test_poses_torn_from_odometry_are_told(drifting):
    """A localizer jumps, so only steps of odometry tell."""
    one = PoseRefinement(placed(None), TrajectoryConfig(), drifting=drifting)
    assert one.said_torn() == ''
    one.estimator.poses[2] += (0.15, 0.0, 0.0)  # nothing is torn by that
    assert one.said_torn() == ''
    one.estimator.poses[2] += (2.85, 0.0, 0.0)
    assert ('torn apart at 1 of 2 steps' in one.said_torn()) == drifting
    assert ('3.00 m and 0.0 degrees' in one.said_torn()) == drifting


@pytest.mark.parametrize(('poses', 'kept'), [('auto', 'stay as given'), ('joint', 'may know')])
def test_torn_poses_are_not_sampled_at_unless_asked_for(poses, kept, capsys):
    one = PoseRefinement(placed(None), TrajectoryConfig(), drifting=True)
    assert that_hold(one, PosesConfig(poses)) is one
    assert capsys.readouterr().err == ''
    one.estimator.poses[2] += (3.0, 0.0, 0.0)
    assert that_hold(one, PosesConfig(poses)) is (None if poses == 'auto' else one)
    assert kept in capsys.readouterr().err
    beside = PosesBeside(TrajectoryConfig(), None, lambda: None)
    with pytest.raises(PoseError, match='torn apart at 1 of 2 steps'):
        beside._hand_over(None, one)
