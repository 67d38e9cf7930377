"""Whatever the order of arrival: no scan is misplaced, every one is accounted for."""

import math
from bisect import bisect_left, bisect_right

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.placers import S, belief, placer_with
from support.strategies import REPEATABLE, fan, stamps_ns

from ogm_mcmc.engine.placing import DROP_REASONS
from ogm_mcmc.geometry import interpolate

approx = pytest.approx


# A few stamps, so that they often meet, and at most 1 s from end to end, so that none jumps back.
within_a_second = st.integers(0, 20).map(lambda k: k * S // 20)


arrivals = st.lists(st.tuples(st.sampled_from(['scan', 'pose']), within_a_second), max_size=40)


def feed(placer, arrivals, yaw=lambda k: 0.7 * k):
    """Let everything arrive; return scans added, poses accepted (in order), placed."""
    scans, poses, placed, newest = 0, [], [], -1
    for k, (kind, stamp) in enumerate(arrivals):
        if kind == 'scan':
            scans += 1
            placer.add_scan(fan(1.0, stamp_ns=stamp), now_s=0.0)
        else:
            pose = belief(float(k * k), yaw(k))
            placer.add_pose(stamp, pose)
            if stamp > newest:
                newest = stamp
                poses.append((stamp, pose.mean))
        placed += placer.placed(now_s=0.0)
    return scans, poses, placed


@given(arrivals=arrivals, max_gap_s=st.sampled_from([0.11, 0.5, 2.0]))
@settings(REPEATABLE, max_examples=500)
def test_whatever_the_order_of_arrival_no_scan_is_misplaced(arrivals, max_gap_s):
    placer, dropped = placer_with(max_gap_s=max_gap_s)
    scans, poses, placed = feed(placer, arrivals)
    assume(not placer.dropped['pose_jumped_back'])  # what is known starts again there
    stamps = [stamp for stamp, _ in poses]
    for found, where, *_ in placed:
        before = bisect_right(stamps, found.stamp_ns) - 1
        after = bisect_left(stamps, found.stamp_ns)
        assert before >= 0
        assert after < len(stamps)
        (start, earlier), (end, later) = poses[before], poses[after]
        assert end - start <= max_gap_s * S
        fraction = (found.stamp_ns - start) / (end - start) if end > start else 0.0
        expected = interpolate(earlier, later, fraction)
        assert (where.mean.x_m, where.mean.y_m) == approx((expected.x_m, expected.y_m))
        assert math.cos(where.mean.yaw_rad - expected.yaw_rad) == approx(1.0)
    in_order = [found.stamp_ns for found, *_ in placed]
    assert in_order == sorted(in_order)
    assert sum(what is not None for _, what in dropped) + len(placed) + len(placer) == scans


@given(
    arrivals=st.lists(st.tuples(st.sampled_from(['scan', 'pose']), stamps_ns(10.0)), max_size=40),
    max_waiting=st.integers(1, 5),
)
@REPEATABLE
def test_every_scan_is_placed_dropped_or_waiting(arrivals, max_waiting):
    """Jumps back and full queues included; every drop is counted under a known reason."""
    placer, dropped = placer_with(max_waiting=max_waiting)
    scans, _, placed = feed(placer, arrivals)
    dropped_scans = [what for _, what in dropped if what is not None]
    assert len(dropped_scans) + len(placed) + len(placer) == scans
    assert len({id(what) for what in dropped_scans}) == len(dropped_scans)
    assert sum(placer.dropped.values()) == len(dropped)
    assert set(placer.dropped) <= set(DROP_REASONS)
    list(placer.placed(now_s=math.inf))
    assert len(placer) == 0
