"""Where a scan lies between two poses, and what the history of poses keeps."""

import math

import numpy as np
import pytest
from support.placers import S, belief, placed, placer_with, scan
from support.strategies import fan

from ogm_mcmc.engine import pose_history
from ogm_mcmc.engine.placing import final_belief
from ogm_mcmc.engine.pose_history import PoseHistory, Unplaceable, Waiting
from ogm_mcmc.geometry import Pose2D, PoseBelief, PoseSamples

approx = pytest.approx


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
        placer.add_pose(now + k, belief(0.01 * k))
    placer.add_scan(fan(1.0, stamp_ns=now + 1))
    (placement,) = placer.placed()
    assert placement.belief.mean.x_m == 0.01


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


def test_a_scan_between_places_too_far_apart_is_dropped():
    """A localizer finds its place again: the robot never was between the two."""
    placer, dropped = placer_with((0.0, belief()), (0.1, belief(0.5)), (0.2, belief(5.0)))
    for stamp in (0.05, 0.1, 0.15, 0.2):
        placer.add_scan(scan(stamp))
    assert placed(placer) == [(0.05, approx(0.25)), (0.1, 0.5)]
    assert [reason for reason, _ in dropped] == ['pose_jump']
    placer.add_pose(3 * S // 10, belief(5.5))  # so it is there
    assert placed(placer) == [(0.2, 5.0)]


def test_a_stray_pose_places_no_scan_even_at_its_own_stamp():
    placer, dropped = placer_with((0.0, belief()), (0.1, belief(900.0)), (0.2, belief(1.0)))
    for stamp in (0.0, 0.1, 0.2):
        placer.add_scan(scan(stamp))
    assert placed(placer) == [(0.0, 0.0)]
    assert [reason for reason, _ in dropped] == ['pose_jump']
    placer.add_pose(3 * S // 10, belief(1.5))
    assert placed(placer) == [(0.2, 1.0)]


def test_where_no_next_pose_comes_one_that_jumped_is_taken():
    """Nothing contradicts it: a localizer that found its place and stands."""
    placer, dropped = placer_with((0.0, belief()), (0.1, belief(900.0)))
    placer.add_scan(scan(0.1))
    assert placed(placer, now_s=1.0) == []
    assert placed(placer, now_s=1.1) == [(0.1, 900.0)]
    assert final_belief(placer.source, S // 10).mean.x_m == 900.0
    with pytest.raises(Waiting):
        final_belief(placer.source, S)
    placer, dropped = placer_with((0.0, belief()), (0.1, belief(900.0)))
    placer.add_scan(scan(0.1))
    assert placed(placer, now_s=1.0) == []
    placer.add_pose(6 * S // 10, belief(1.0), now_s=1.0)  # it was a stray one
    assert placed(placer, now_s=9.0) == []
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
