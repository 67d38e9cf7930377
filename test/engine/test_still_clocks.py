"""Stamps that stand still are told from the several scans of one moment."""

from dataclasses import replace

import numpy as np
from support.placers import S, belief, placed, placer_with, scan

from ogm_mcmc.engine.still_clocks import StillClocks


def reading(stamp_s, range_m, frame_id='laser'):
    return replace(scan(stamp_s, frame_id), ranges_m=np.array([range_m], np.float32))


def test_a_stamp_stands_where_it_comes_over_more_than_a_moment():
    clocks = StillClocks()
    assert not clocks.add('laser', 5, 0.0)
    assert clocks.add('laser', 5, 1.0)
    assert not clocks.stands('laser', 5)
    assert clocks.add('laser', 5, 1.01)
    assert clocks.stands('laser', 5)
    assert not clocks.stands('laser', 4)
    assert not clocks.stands('other', 5)
    assert not clocks.add('laser', 6, 1.1)
    assert not clocks.stands('laser', 6)
    clocks.clear()
    assert not clocks.add('laser', 6, 9.0)


def test_scans_whose_clock_stands_still_do_not_all_lie_at_one_pose():
    """The robot drives on, and so do the stamps of its poses."""
    placer, dropped = placer_with(live=True)
    found = []
    for k in range(60):
        now_s = 100.0 + 0.05 * k
        placer.add_pose(round((5.0 + 0.05 * k) * S), belief(0.1 * k), now_s)
        placer.add_scan(reading(7.0, 1.0 + 0.01 * k), now_s)
        found += placed(placer, now_s)
    assert found == [(7.0, 4.0)]  # the first one may have been taken then
    assert len(placer) == 0
    assert [reason for reason, _ in dropped] == ['scan_unstamped'] * 59
    placer.add_pose(9 * S, belief(6.0), 103.0)
    placer.add_scan(reading(9.0, 1.0), 103.0)
    assert placed(placer, 103.0) == [(9.0, 6.0)]  # it goes on


def test_scans_of_one_moment_are_all_used_once_the_next_ones_come():
    placer, dropped = placer_with((0.5, belief()), (3.0, belief()), live=True, max_gap_s=9.0)
    for k in range(4):
        placer.add_scan(reading(2.0, 1.0 + k), 10.0 + 0.02 * k)
    assert placed(placer, 10.1) == [(2.0, 0.0)]
    placer.add_scan(reading(2.1, 1.0), 10.1)
    assert [stamp for stamp, _ in placed(placer, 10.1)] == [2.0] * 3 + [2.1]
    assert dropped == []


def test_scans_of_the_last_moment_are_used_when_nothing_follows():
    placer, dropped = placer_with((0.5, belief()), (3.0, belief()), live=True, max_gap_s=9.0)
    for k in range(3):
        placer.add_scan(reading(2.0, 1.0 + k), 10.0)
    assert len(placed(placer, 10.9)) == 1
    assert len(placed(placer, 11.1)) == 2
    assert dropped == []


def test_another_sensor_has_its_own_clock():
    placer, dropped = placer_with((0.0, belief()), (9.0, belief()), live=True, max_gap_s=9.0)
    used = []
    for k in range(30):
        now_s = 0.1 * k
        placer.add_scan(reading(2.0, 1.0 + k, 'stuck'), now_s)
        placer.add_scan(reading(2.0 + now_s, 1.0, 'well'), now_s)
        used += placer.placed(now_s)
    assert [one.scan.frame_id for one in used].count('well') == 30
    assert [one.scan.frame_id for one in used].count('stuck') == 1
    assert len(dropped) == 29


def test_poses_whose_clock_stands_still_are_counted_as_such():
    placer, _ = placer_with(live=True)
    for k in range(30):
        placer.add_pose(7 * S, belief(float(k)), 0.1 * k)
    assert placer.dropped == {'pose_out_of_order': 10, 'pose_unstamped': 19}
