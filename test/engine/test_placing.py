"""What waits, what is dropped and why."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from support.placers import S, belief, placed, placer_with, scan

from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory, Unplaceable, Waiting
from ogm_mcmc.geometry import Pose2D, PoseBelief, Scan, SensorMount

approx = pytest.approx


def test_time_out_counts_from_the_last_arrival_of_scan_or_pose():
    placer, dropped = placer_with(timeout_s=1.0)
    late = scan(9.0)
    placer.add_scan(late, now_s=5.0)
    assert placed(placer, now_s=6.0) == []
    placer.add_pose(1 * S, belief(), now_s=6.5)
    assert placed(placer, now_s=7.5) == []
    assert (len(placer), dropped) == (1, [])
    assert placed(placer, now_s=7.51) == []
    assert (len(placer), dropped) == (0, [('pose_timeout', late)])


def test_a_negative_time_out_waits_for_nothing():
    """As at the end of a bag."""
    placer, dropped = placer_with((1.0, belief()), timeout_s=math.inf)
    for stamp in (1.0, 1.5, 1.75):
        placer.add_scan(scan(stamp))
    assert placed(placer, now_s=1e9) == [(1.0, 0.0)]
    placer.timeout_s = -1.0
    assert placed(placer) == []
    assert [reason for reason, _ in dropped] == ['pose_timeout'] * 2


def test_several_scans_of_one_stamp_are_all_used():
    placer, dropped = placer_with((0.5, belief()), (3.0, belief()), max_gap_s=9.0)
    for reading in (1.0, 2.0, 3.0):
        placer.add_scan(replace(scan(2.0), ranges_m=np.array([reading], np.float32)))
    assert [stamp for stamp, _ in placed(placer)] == [2.0] * 3
    assert dropped == []


def test_parts_of_a_sweep_that_read_alike_are_all_used():
    """A robot in the middle of a round room, each quarter a message of its own."""
    placer, dropped = placer_with((0.5, belief()), (3.0, belief()), max_gap_s=9.0)
    for angle in (0.0, 1.5, 3.0):
        placer.add_scan(replace(scan(2.0), angle_min_rad=angle))
    assert [stamp for stamp, _ in placed(placer)] == [2.0] * 3
    assert dropped == []


def test_scans_without_a_stamp_do_not_all_lie_at_the_first_pose():
    placer, dropped = placer_with((0.0, belief(3.0)))
    for reading in (1.0, 2.0, 3.0):
        placer.add_scan(replace(scan(0.0), ranges_m=np.array([reading], np.float32)))
    assert placed(placer) == [(0.0, 3.0)]  # time may begin at 0
    assert [reason for reason, _ in dropped] == ['scan_unstamped'] * 2


@pytest.mark.parametrize('stamp', [2.0, 1.9, 1.0])
def test_a_repeated_or_late_scan_is_dropped(stamp):
    placer, dropped = placer_with((0.5, belief()), (3.0, belief()), max_gap_s=9.0)
    placer.add_scan(scan(2.0))
    late = scan(stamp)
    placer.add_scan(late)
    assert dropped == [('scan_out_of_order', late)]
    assert [stamp for stamp, _ in placed(placer)] == [2.0]


def test_each_lidar_has_its_own_order():
    placer, dropped = placer_with((0.0, belief()), (3.0, belief()), max_gap_s=9.0)
    for one in (scan(2.0, 'left'), scan(1.5, 'right'), scan(2.0, 'right'), scan(2.5, 'left')):
        placer.add_scan(one)
    assert len(placed(placer)) == 4
    assert dropped == []


@pytest.mark.parametrize('stamp', [2.0, 1.5, 1.0])
def test_a_repeated_or_late_pose_is_dropped(stamp):
    placer, dropped = placer_with((1.0, belief(1.0)), (2.0, belief(2.0)))
    placer.add_pose(round(stamp * S), belief(99.0))
    assert dropped == [('pose_out_of_order', None)]
    placer.add_scan(scan(1.5))
    placer.add_scan(scan(2.0))
    assert placed(placer) == [(1.5, 1.5), (2.0, 2.0)]


def test_a_gap_is_not_bridged():
    placer, dropped = placer_with((1.0, belief()), (3.0, belief(1.0)), (5.000000001, belief()))
    over_the_gap = scan(4.0)
    for one in (scan(2.0), over_the_gap, scan(5.000000001)):
        placer.add_scan(one)
    assert [stamp for stamp, _ in placed(placer)] == [2.0, approx(5.0)]
    assert dropped == [('pose_gap', over_the_gap)]


def test_a_full_queue_drops_the_oldest():
    placer, dropped = placer_with(max_waiting=2)
    waiting = [scan(stamp) for stamp in (1.0, 1.1, 1.2, 1.3)]
    for one in waiting:
        placer.add_scan(one)
    assert dropped == [('queue_full', waiting[0]), ('queue_full', waiting[1])]
    assert len(placer) == 2
    placer.add_pose(round(1.2 * S), belief())
    assert placed(placer) == [(1.2, 0.0)]


def test_frames_that_somebody_makes_up_do_not_fill_the_memory():
    placer, _ = placer_with((0.0, belief()), (2.0, belief()))

    def take(numbers):
        for k in numbers:
            placer.add_scan(scan(1.0, f'laser_{k}'))
            list(placer.placed())

    take(range(1500))
    tracemalloc.start()
    take(range(1500, 3500))
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 300_000  # a thousand names and numbers replaced; all kept are 600 000


def test_a_scan_waits_for_the_mount_of_its_sensor():
    class Mounts:
        known = None

        def at(self, frame, stamp_ns, now_s):
            if self.known is None:
                raise Waiting
            if frame == 'nowhere':
                raise Unplaceable('scan_no_mount')
            return self.known

    mounts = Mounts()
    placer, dropped = placer_with((0.0, belief()), (2.0, belief()), mounts=mounts)
    placer.add_scan(scan(1.0))
    assert list(placer.placed()) == []
    mounts.known = SensorMount(Pose2D(0.3))
    (placement,) = placer.placed()
    assert placement.mount is mounts.known
    placer.add_scan(scan(1.0, 'nowhere'))
    assert list(placer.placed()) == []
    assert [reason for reason, _ in dropped] == ['scan_no_mount']


class FromElsewhere:
    """A source that is asked, as tf is."""

    def at(self, stamp_ns):
        if stamp_ns == 2 * S:
            raise Unplaceable('pose_unavailable')
        if stamp_ns > 3 * S:
            raise Waiting
        return belief(stamp_ns / S)


def test_a_source_that_is_asked():
    placer = ScanPlacer(FromElsewhere())
    for stamp in (1.0, 2.0, 3.0, 4.0):
        placer.add_scan(scan(stamp))
    assert placed(placer) == [(1.0, 1.0), (3.0, 3.0)]
    assert placer.dropped == {'pose_unavailable': 1}
    with pytest.raises(TypeError, match='does not take them'):
        placer.add_pose(1 * S, belief())


def test_a_scan_does_not_wait_for_ever_while_poses_come():
    """Poses of another clock, or one that repeats itself, are no reason to wait."""
    placer = ScanPlacer(PoseHistory(), timeout_s=1.0)
    scan = Scan.checked(
        [1.0],
        angle_min_rad=0.0,
        angle_increment_rad=1.0,
        range_min_m=0.0,
        range_max_m=5.0,
        stamp_ns=10**12,
    )
    placer.add_pose(10**9, PoseBelief(Pose2D()), now_s=0.0)
    placer.add_scan(scan, now_s=0.0)
    placer.add_pose(10**9, PoseBelief(Pose2D()), now_s=0.9)
    assert list(placer.placed(1.2)) == []
    assert placer.dropped == {'pose_out_of_order': 1, 'pose_timeout': 1}

    placer.add_scan(replace(scan, stamp_ns=2 * 10**12), now_s=2.0)
    for step in range(30):
        placer.add_pose(10**9 + 1 + step, PoseBelief(Pose2D()), now_s=2.0 + 0.5 * step)
        assert list(placer.placed(2.0 + 0.5 * step)) == []
    assert placer.dropped == {'pose_out_of_order': 1, 'pose_timeout': 2}
