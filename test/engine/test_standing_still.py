"""A robot that stands still keeps its last pose; one that may have moved does not."""

from dataclasses import replace

import numpy as np
import pytest
from support.rooms import scans_of

from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.engine.standing_still import same_view
from ogm_mcmc.geometry import Pose2D, PoseBelief

S = 1_000_000_000
HERE = (2.0, 2.0, 0.3)


def seen_from(x=2.0, y=2.0, yaw=0.3, *, beams=180, noise_m=0.01, seed=0):
    (scan,) = scans_of(np.array([(x, y, yaw)]), beams, noise_m, seed)
    return scan


def test_the_same_place_is_the_same_view():
    assert same_view(seen_from(), seen_from(seed=1))


@pytest.mark.parametrize('place', [(2.15, 2.0, 0.3), (2.0, 2.15, 0.3), (2.0, 2.0, 0.4)])
def test_another_place_is_not(place):
    assert not same_view(seen_from(), seen_from(*place, seed=1))


def test_somebody_walking_by_changes_little():
    passed = seen_from(seed=1)
    passed.ranges_m[20:30] = 0.5
    assert same_view(seen_from(), passed)


def test_few_beams_are_no_evidence():
    assert not same_view(seen_from(beams=20), seen_from(beams=20))


def test_two_lidars_are_not_compared():
    assert not same_view(seen_from(), seen_from(beams=360))


def test_a_bare_corridor_does_not_hold_the_robot():
    """Walls left and right, no end within the range: it looks alike everywhere."""
    scan = seen_from()
    bearings = scan.bearings()
    with np.errstate(divide='ignore'):
        walls = (1.0 / np.abs(np.sin(bearings))).astype(np.float32)
    corridor = replace(scan, ranges_m=np.where(walls < 8.0, walls, np.inf).astype(np.float32))
    assert not same_view(corridor, corridor)


def placed_at(poses, scans, **options):
    """Poses and scans as (time in s, ...); return x of every scan placed, and what was dropped."""
    placer = ScanPlacer(PoseHistory(), timeout_s=1.0, **options)
    for time_s, x in poses:
        placer.add_pose(round(time_s * S), PoseBelief(Pose2D(x)))
    found = []
    for time_s, scan in scans:
        placer.add_scan(replace(scan, stamp_ns=round(time_s * S)))
        found += [one.belief.mean.x_m for one in placer.placed(0.0)]
    found += [one.belief.mean.x_m for one in placer.flush()]
    return found, dict(placer.dropped), placer.n_held


def test_the_last_pose_holds_while_nothing_moves():
    scans = [(k, seen_from(seed=k)) for k in range(1, 6)]
    assert placed_at([(1.0, 2.0)], scans) == ([2.0] * 5, {}, 4)


def test_it_holds_over_a_gap_and_no_longer_than_nothing_moves():
    scans = [(1, seen_from()), (20, seen_from(seed=1)), (59, seen_from(2.15, seed=2))]
    scans += [(60, seen_from(2.25, seed=3))]
    found = placed_at([(1.0, 2.0), (60.0, 2.25)], scans)
    assert found == ([2.0, 2.0, 2.25], {'pose_gap': 1}, 1)


def test_the_pose_of_before_another_one_does_not_hold():
    """The robot went elsewhere, where it looks the same."""
    found = placed_at([(1.0, 2.0), (2.0, 4.0)], [(1, seen_from()), (9, seen_from(seed=1))])
    assert found == ([2.0], {'pose_timeout': 1}, 0)


def test_a_place_found_again_holds_while_nothing_moves():
    """A localizer jumps at the stamp of a scan and says nothing more: live, and to the end."""
    placer = ScanPlacer(PoseHistory(), timeout_s=1.0)
    found = []
    for k in range(60):
        if k in (0, 5, 10):
            placer.add_pose(k * S // 10, PoseBelief(Pose2D(50.0 if k == 10 else 0.0)), k / 10)
        placer.add_scan(replace(seen_from(seed=k), stamp_ns=k * S // 10), k / 10)
        found += [one.belief.mean.x_m for one in placer.placed(k / 10)]
        assert k < 25 or 50.0 in found
    found += [one.belief.mean.x_m for one in placer.flush()]
    assert found == [0.0] * 6 + [50.0] * 50
    assert (placer.dropped, placer.n_held) == ({'pose_jump': 4}, 49)


def test_a_place_found_again_holds_however_many_scans_wait_for_more_poses():
    scans = [(1 + k / 10, seen_from(seed=k)) for k in range(12)]
    found, dropped, _ = placed_at([(0.0, 0.0), (1.0, 50.0)], scans, max_waiting=4)
    assert found == [50.0] * 5
    assert dropped == {'queue_full': 7}
