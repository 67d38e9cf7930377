import math
import tracemalloc
from bisect import bisect_left, bisect_right
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.strategies import REPEATABLE, fan, stamps_ns

from ogm_mcmc.engine import pose_history
from ogm_mcmc.engine.placing import DROP_REASONS, ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory, Unplaceable, Waiting
from ogm_mcmc.geometry import Pose2D, PoseBelief, PoseSamples, Scan, SensorMount, interpolate

approx = pytest.approx

S = 1_000_000_000


def scan(stamp_s, frame_id='laser'):
    return fan(1.0, stamp_ns=round(stamp_s * S), frame_id=frame_id)


def belief(x=0.0, yaw=0.0):
    return PoseBelief(Pose2D(x, -x, yaw))


def placer_with(*poses, **options):
    """Return a placer that knows the poses (stamp in s, belief), and what it drops from now on."""
    dropped = []
    placer = ScanPlacer(
        PoseHistory(max_gap_s=options.pop('max_gap_s', 2.0)),
        on_drop=lambda reason, what: dropped.append((reason, what)),
        **options,
    )
    for stamp_s, pose in poses:
        placer.add_pose(round(stamp_s * S), pose)
    return placer, dropped


def placed(placer, now_s=0.0):
    """Stamp in s and x of every scan placed now."""
    return [(p.scan.stamp_ns / S, p.belief.mean.x_m) for p in placer.placed(now_s)]


def test_a_pose_at_the_very_stamp_is_taken_as_it_is():
    here = belief(3.0)
    placer, _ = placer_with((1.0, belief()), (2.0, here), (3.0, belief()))
    placer.add_scan(scan(2.0))
    (placement,) = placer.placed()
    assert placement.belief is here
    assert placement.scan.stamp_ns == 2 * S
    assert len(placer) == 0


def test_stamps_of_today_do_not_lose_a_nanosecond():
    """As floats they would: 2**53 ns are 104 days."""
    now = 1_700_000_000 * S
    placer, _ = placer_with()
    for k in range(3):
        placer.add_pose(now + k, belief(float(k)))
    placer.add_scan(fan(1.0, stamp_ns=now + 1))
    (placement,) = placer.placed()
    assert placement.belief.mean.x_m == 1.0


def test_between_two_poses():
    before = PoseBelief(Pose2D(0.0, 0.0, math.radians(170)), np.diag([1.0, 2.0, 4.0]))
    after = PoseBelief(Pose2D(4.0, 8.0, math.radians(-170)), np.diag([5.0, 2.0, 0.0]))
    placer, _ = placer_with((1.0, before), (2.0, after))
    placer.add_scan(scan(1.25))
    (placement,) = placer.placed()
    mean = placement.belief.mean
    assert (mean.x_m, mean.y_m, math.degrees(mean.yaw_rad)) == approx((1.0, 2.0, 175.0))
    assert placement.belief.covariance == approx(np.diag([2.0, 2.0, 3.0]))
    assert placement.belief.particles is None


def test_no_covariance_between_one_and_none():
    placer, _ = placer_with((1.0, PoseBelief(Pose2D(), np.eye(3))), (2.0, belief()))
    placer.add_scan(scan(1.5))
    (placement,) = placer.placed()
    assert placement.belief.covariance is None


@pytest.mark.parametrize(('stamp', 'nearer'), [(1.25, 0), (1.75, 1)])
def test_the_nearer_cloud_moves_as_one_body(stamp, nearer):
    rng = np.random.default_rng(2)
    clouds = [
        PoseSamples.checked(mean + rng.normal(0.0, 0.1, (5, 3)), rng.uniform(1, 2, 5))
        for mean in ([0.0, 0.0, 3.1], [2.0, 1.0, -2.9])
    ]
    ends = [PoseBelief(cloud.mean(), cloud.covariance(), cloud) for cloud in clouds]
    placer, _ = placer_with((1.0, ends[0]), (2.0, ends[1]))
    placer.add_scan(scan(stamp))
    (placement,) = placer.placed()
    mean, cloud = placement.belief.mean, placement.belief.particles
    assert cloud.weights is clouds[nearer].weights
    assert (cloud.mean().x_m, cloud.mean().y_m) == approx((mean.x_m, mean.y_m))
    assert math.cos(cloud.mean().yaw_rad - mean.yaw_rad) == approx(1.0)
    for was, now in zip(clouds[nearer].poses, cloud.poses, strict=True):
        relative = ends[nearer].mean.inverse().compose(Pose2D(*was))
        expected = mean.compose(relative)
        assert now[:2] == approx([expected.x_m, expected.y_m])
        assert math.cos(now[2] - expected.yaw_rad) == approx(1.0)


def test_waits_for_a_later_pose_and_is_never_extrapolated():
    placer, dropped = placer_with((1.0, belief(1.0)), (2.0, belief(2.0)))
    placer.add_scan(scan(1.5))
    placer.add_scan(scan(2.000000001))
    placer.add_scan(scan(2.5))
    assert placed(placer) == [(1.5, 1.5)]
    assert len(placer) == 2
    placer.add_pose(3 * S, belief(3.0))
    assert placed(placer) == [(approx(2.0), approx(2.0)), (2.5, 2.5)]
    assert dropped == []


def test_waits_for_the_first_pose():
    placer, _ = placer_with()
    placer.add_scan(scan(1.0))
    assert placed(placer) == []
    placer.add_pose(1 * S, belief(7.0))
    assert placed(placer) == [(1.0, 7.0)]


def test_before_every_pose():
    placer, dropped = placer_with((1.0, belief()), (2.0, belief()))
    early = scan(0.999)
    placer.add_scan(early)
    placer.add_scan(scan(1.0))
    assert placed(placer) == [(1.0, 0.0)]
    assert dropped == [('scan_before_poses', early)]


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


def test_a_scan_between_places_too_far_apart_is_dropped():
    """A localizer finds its place again: the robot never was between the two."""
    placer, dropped = placer_with((0.0, belief()), (0.1, belief(0.5)), (0.2, belief(5.0)))
    for stamp in (0.05, 0.1, 0.15, 0.2):
        placer.add_scan(scan(stamp))
    assert placed(placer) == [(0.05, approx(0.25)), (0.1, 0.5), (0.2, 5.0)]
    assert [reason for reason, _ in dropped] == ['pose_jump']


def test_turning_too_fast_is_a_jump_as_well():
    history = PoseHistory(max_turn_rad_s=3.0)
    for stamp_s, yaw in ((0.0, 3.0), (0.1, -3.0), (0.2, -2.5)):
        history.add(round(stamp_s * S), belief(yaw=yaw))
    assert history.at(S // 20).mean.yaw_rad == approx(-math.pi)  # 0.28 rad the short way
    with pytest.raises(Unplaceable, match='pose_jump'):
        history.at(3 * S // 20)


def test_without_limits_nothing_is_a_jump():
    history = PoseHistory(max_speed_m_s=math.inf, max_turn_rad_s=math.inf)
    history.add(0, belief(0.0))
    history.add(2, belief(1000.0, 3.0))
    assert history.at(1).mean.x_m == 500.0


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


def test_clouds_do_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(pose_history, 'MAX_PARTICLES', 1000)
    history = PoseHistory()
    cloud = PoseSamples.checked(np.zeros((100, 3)))
    for k in range(200):
        history.add(k * S, PoseBelief(Pose2D(), None, cloud))
        assert len(history.beliefs) <= 10
    assert history.at(199 * S).particles is cloud
    history.clear()
    for k in range(2000):
        history.add(k * S, PoseBelief(Pose2D()))
    assert len(history.beliefs) == 2000


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


def test_history_forgets_the_oldest_in_time():
    history = PoseHistory(keep=5)
    for k in range(11):
        history.add(k * S, belief(float(k)))
    assert len(history.stamps) == len(history.beliefs) == 5
    assert history.at(10 * S).mean.x_m == 10.0
    with pytest.raises(Unplaceable, match='scan_before_poses'):
        history.at(5 * S)
    with pytest.raises(Waiting):
        history.at(10 * S + 1)


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


def test_a_recording_of_less_than_a_second_can_be_played_again():
    """Stamps go back by less than a restart, but again and again."""
    placer = ScanPlacer(PoseHistory())
    used = []
    for _ in range(4):
        for k in range(20):
            stamp = 10**9 + k * 25_000_000
            placer.add_pose(stamp, PoseBelief(Pose2D(float(k), 0.0)))
            placer.add_scan(replace(fan(1.0), stamp_ns=stamp))
            used += [(p.scan.stamp_ns, p.belief.mean.x_m) for p in placer.placed()]
    assert len(used) > 20 + 3 * 5
    assert all(x == (stamp - 10**9) / 25_000_000 for stamp, x in used)
    assert len(used) + sum(n for why, n in placer.dropped.items() if 'pose' not in why) == 80
