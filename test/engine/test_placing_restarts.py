"""Time that starts again: nothing of before meets anything of after."""

from dataclasses import replace

import pytest
from support.placers import S, belief, placed, placer_with, scan
from support.strategies import fan

from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.geometry import Pose2D, PoseBelief

approx = pytest.approx


def test_poses_that_jump_back_restart_the_history():
    placer, dropped = placer_with((10.0, belief(10.0)), (11.0, belief(11.0)))
    placer.add_pose(round(9.9 * S), belief(-1.0))
    placer.add_pose(round(9.95 * S), belief(-1.2))
    assert dropped == [('pose_jumped_back', None)]
    placer.add_scan(scan(9.925))
    assert placed(placer) == [(9.925, approx(-1.1))]


def test_a_scan_that_jumps_back_starts_a_new_order():
    placer, dropped = placer_with()
    placer.add_scan(scan(10.0))
    back = scan(8.9)
    placer.add_scan(back)
    assert ('scan_jumped_back', back) in dropped
    count = len(dropped)
    placer.add_scan(scan(9.0))
    assert len(dropped) == count


def test_a_scan_from_before_a_restart_never_meets_a_pose_from_after_it():
    """A bag played again, or a simulation reset: the same stamps, another drive."""
    placer, _ = placer_with((99.0, belief()), (100.0, belief()))
    of_before = scan(100.55)
    placer.add_scan(of_before)
    assert placed(placer) == []
    for k in range(1100):
        placer.add_pose(k * S // 10, belief(5000.0))
        if k % 2:
            placer.add_scan(scan(0.1 * k))
        assert all(found.scan is not of_before for found in placer.placed())


def test_mapping_goes_on_soon_after_a_restart():
    """What waits from before it must not hold up what comes now."""
    placer, _ = placer_with((99.0, belief()), (100.0, belief()))
    placer.add_scan(scan(100.5))
    for k in range(20):
        placer.add_pose(round(0.1 * k * S), belief())
        placer.add_scan(scan(0.1 * k))
    assert len(placed(placer)) > 10


def test_a_scan_from_after_a_restart_never_meets_a_pose_from_before_it():
    """Scans often come more than once before the first pose."""
    placer, _ = placer_with(*((0.1 * k, belief(-9.0)) for k in range(100)))
    placer.add_scan(scan(9.5))
    assert placed(placer) == [(9.5, -9.0)]
    for stamp in (0.11, 0.13, 0.15):
        placer.add_scan(scan(stamp))
        assert placed(placer) == []


def test_clear_forgets_scans_poses_and_order_but_not_the_counts():
    placer, _ = placer_with((1.0, belief()))
    placer.add_pose(1 * S, belief())
    placer.add_scan(scan(5.0))
    placer.clear()
    assert len(placer) == 0
    assert placer.dropped == {'pose_out_of_order': 1}
    placer.add_scan(scan(2.0))
    placer.add_pose(2 * S, belief(4.0))
    assert placed(placer) == [(2.0, 4.0)]


def test_a_recording_of_less_than_a_second_can_be_played_again():
    """Stamps go back by less than a restart, but again and again."""
    placer = ScanPlacer(PoseHistory())
    used = []
    for _ in range(4):
        for k in range(20):
            stamp = 10**9 + k * 25_000_000
            placer.add_pose(stamp, PoseBelief(Pose2D(0.125 * k, 0.0)))
            placer.add_scan(replace(fan(1.0), stamp_ns=stamp))
            used += [(p.scan.stamp_ns, p.belief.mean.x_m) for p in placer.placed()]
    assert len(used) > 20 + 3 * 5
    assert all(x == (stamp - 10**9) / 200_000_000 for stamp, x in used)
    assert len(used) + sum(n for why, n in placer.dropped.items() if 'pose' not in why) == 80
