"""Poses that hold for scans, by hand."""

import numpy as np
import pytest
from support.workers import scans

from ogm_mcmc.config import PosesConfig
from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.engine.kept_poses import EstimatedPoses, KeptPoses
from ogm_mcmc.geometry import PlacedScan, Pose2D

EARLY, LATE = Pose2D(0.1, 0.0, 0.02), Pose2D(0.0, 0.3, -0.01)


def moved(one, step):
    return PlacedScan(one.scan, one.belief.carried_to(step.compose(one.pose)))


def found_of(given, steps, aligned=True):
    placed = [moved(one, step) for one, step in zip(given, steps, strict=True)]
    return EstimatedPoses(given, placed, RefinedTrajectory([], [], Pose2D()), aligned)


@pytest.fixture
def given():
    return scans(8)


@pytest.fixture
def kept(given):
    """Of the scans 1 and 5."""
    kept = KeptPoses(PosesConfig('joint'))
    kept.keep(found_of([given[1], given[5]], [EARLY, LATE]))
    return kept


def test_scans_lie_where_they_were_estimated_and_others_beside_the_nearest(kept, given):
    placed = kept.placed(given)
    steps = [EARLY, EARLY, EARLY, EARLY, LATE, LATE, LATE, LATE]
    for one, now, step in zip(given, placed, steps, strict=True):
        assert now.scan is one.scan
        wanted = step.compose(one.pose)
        assert (now.pose.x_m, now.pose.y_m) == pytest.approx((wanted.x_m, wanted.y_m))
        assert now.pose.yaw_rad == pytest.approx(wanted.yaw_rad)
    again = kept.placed(given)
    assert all(one is other for one, other in zip(again, placed, strict=True))
    some = kept.placed(given[2:6])
    assert all(one is other for one, other in zip(some, placed[2:6], strict=True))


def test_what_lies_as_before_stays_the_same_object(kept, given):
    before = kept.placed([given[1], given[5]])
    kept.keep(found_of([given[1], given[5]], [EARLY, EARLY]))
    after = kept.placed([given[1], given[5]])
    assert after[0] is before[0]
    assert after[1].pose == EARLY.compose(given[5].pose)


def test_a_scan_that_was_read_anew_is_where_it_was(kept, given):
    read = given[5]._replace(scan=scans(1, start=5)[0].scan)
    placed = kept.placed([given[1], read])[1]
    assert placed.scan is read.scan
    assert placed.pose == LATE.compose(read.pose)
    assert kept.placed([read])[0] is placed


def test_scans_placed_anew_leave_nothing_that_was_estimated(kept, given):
    kept.choose(given, 0.1)
    anew = [*given[:5], moved(given[5], EARLY), *given[6:]]
    kept.choose(anew, 0.1)
    assert kept.placed(anew) == anew
    assert kept.trajectory is None
    assert kept.joint


def test_scans_that_went_are_forgotten(kept, given):
    kept.choose(given[5:], 0.1)
    assert [held.given for held in kept._held.values()] == [given[5]]


def test_nothing_is_left_where_poses_are_no_longer_estimated(given):
    kept = KeptPoses(PosesConfig('auto'))
    kept.keep(found_of(given, [EARLY] * 8))
    assert not kept.choose(given, 0.1).joint  # nothing says how sure they are
    assert kept.placed(given) == given
    assert kept.trajectory is None


def test_a_line_says_how_far_scans_moved(given):
    found = found_of(given[:2], [Pose2D(0.3, 0.4, 0.0), Pose2D()])
    off = 50.0 * np.sqrt(0.5)
    assert found.said_of(2.0) == (
        f'poses joint after 2.0 s: 2 scans moved by {off:.1f} cm and 0.00 degrees '
        '(root mean squares); sampling goes on there'
    )
