"""Scans placed anew by a corrected trajectory, against a plain loop over poses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import fan

from ogm_mcmc.engine.corrections import Corrector, Nodes, corrected_poses
from ogm_mcmc.engine.robot_track import RobotTrack
from ogm_mcmc.geometry import (
    PlacedScan,
    Pose2D,
    PoseBelief,
    PoseSamples,
    SensorMount,
    interpolate,
    wrap_angle,
)

S = 1_000_000_000


def drift(t):
    """Where a robot on a circle is said to be, ever more wrong."""
    return Pose2D(5.0 * math.cos(0.1 * t) + 0.01 * t, 5.0 * math.sin(0.1 * t), 0.1 * t + 0.002 * t)


def truth(t):
    return Pose2D(5.0 * math.cos(0.1 * t), 5.0 * math.sin(0.1 * t), wrap_angle(0.1 * t))


def track_of(said, seconds):
    track = RobotTrack()
    for t in seconds:
        track.add(round(t * S), said(t))
    return track


def nodes_of(pose, seconds):
    rows = [(p.x_m, p.y_m, p.yaw_rad) for p in map(pose, seconds)]
    stamps = np.array([round(t * S) for t in seconds], np.int64)
    return Nodes(stamps, np.array(rows).reshape(-1, 3))


def plain(said, nodes, t):
    """Return the corrected pose at t, None where the nodes say nothing; nothing jumps."""
    known = [(int(s) / S, Pose2D(*map(float, p))) for s, p in zip(*nodes, strict=True)]
    if not known or not known[0][0] <= t <= known[-1][0]:
        return None
    for (t0, first), (t1, second) in zip(known, known[1:] + known[-1:], strict=True):
        if t0 <= t <= t1:
            early = first.compose(said(t0).inverse().compose(said(t)))
            late = second.compose(said(t1).inverse().compose(said(t)))
            return interpolate(early, late, (t - t0) / (t1 - t0) if t1 > t0 else 0.0)
    return None


def assert_same(row, pose):
    assert row[:2] == pytest.approx((pose.x_m, pose.y_m), abs=1e-6)
    assert abs(wrap_angle(row[2] - pose.yaw_rad)) < 1e-6


@given(
    at=st.lists(st.integers(0, 60), min_size=1, max_size=8, unique=True).map(sorted),
    asked=st.lists(st.integers(0, 60), min_size=1, max_size=20),
)
def test_it_is_what_a_loop_over_poses_says(at, asked):
    track, nodes = track_of(drift, range(61)), nodes_of(truth, at)
    poses, covered = corrected_poses(track, nodes, np.array(asked, np.int64) * S)
    for t, row, known in zip(asked, poses, covered, strict=True):
        expected = plain(drift, nodes, t)
        assert known == (expected is not None)
        if expected is not None:
            assert_same(row, expected)


def test_at_nodes_the_scan_is_where_the_node_says_and_near_between():
    seconds = np.arange(0.0, 60.0, 0.25)
    track = track_of(drift, seconds)
    stamps = np.array([round(t * S) for t in seconds], np.int64)
    poses, covered = corrected_poses(track, nodes_of(truth, range(0, 60, 2)), stamps)
    assert covered.sum() == 58 * 4 + 1
    for t, row in zip(seconds[covered], poses[covered], strict=True):
        if t % 2 == 0.0:
            assert_same(row, truth(t))
        assert math.dist(row[:2], (truth(t).x_m, truth(t).y_m)) < 5e-3


def test_where_all_is_moved_alike_the_recorded_motion_is_kept_however_far_from_the_origin():
    def wiggly(t):
        return Pose2D(4000.0 + t, 3000.0 + math.sin(9.0 * t), math.sin(5.0 * t))

    step = Pose2D(0.3, -0.2, 0.4)
    seconds = np.arange(0.0, 10.0, 0.05)
    track = track_of(wiggly, seconds)
    nodes = nodes_of(lambda t: step.compose(wiggly(t)), [0.0, 9.9])
    stamps = np.array([round(t * S) for t in seconds[:199]], np.int64)
    poses, covered = corrected_poses(track, nodes, stamps)
    assert covered.all()
    for t, row in zip(seconds, poses, strict=False):
        assert_same(row, step.compose(wiggly(t)))


def test_a_scan_goes_with_the_node_on_its_side_of_a_jump():
    """The localizer found its place again at 5 s: what it said before was 2 m off."""

    def said(t):
        return Pose2D(0.5 * t + (2.0 if t < 5.0 else 0.0), 0.0, 0.0)

    track = track_of(said, np.arange(0.0, 10.25, 0.25))
    stamps = (np.arange(4.0, 6.25, 0.25) * S).astype(np.int64)
    poses, covered = corrected_poses(track, nodes_of(lambda t: Pose2D(0.5 * t), [4, 6]), stamps)
    assert covered.all()
    assert poses[:, 0] == pytest.approx(0.5 * np.arange(4.0, 6.25, 0.25), abs=1e-9)


def test_nodes_of_which_nothing_is_recorded_say_nothing():
    track = track_of(drift, range(10, 20))
    stamps = np.arange(5, 25) * S
    poses, covered = corrected_poses(track, nodes_of(truth, [0, 12, 16, 40]), stamps)
    assert (stamps[covered] / S).tolist() == [12, 13, 14, 15, 16]
    assert np.isnan(poses[~covered]).all()
    for empty in (nodes_of(truth, []), nodes_of(truth, [40])):
        assert not corrected_poses(track, empty, stamps)[1].any()
    assert not corrected_poses(RobotTrack(), nodes_of(truth, [12]), stamps)[1].any()


# -- scans ----------------------------------------------------------------------------------------

MOUNT = SensorMount(Pose2D(0.2, -0.1, math.pi / 2.0), upside_down=True)


def placed_at(t, said=drift, reading=2.0):
    covariance = np.diag([0.04, 0.01, 1e-4])
    belief = PoseBelief(said(t), covariance)
    return PlacedScan.on_robot(fan(reading, reading, stamp_ns=round(t * S)), belief, MOUNT)


def test_scans_are_placed_by_the_robot_and_its_mount():
    corrector = Corrector()
    scans = [placed_at(t) for t in range(60)]
    for placed in scans:
        corrector.note(placed)
    found = corrector.applied(scans, nodes_of(truth, range(60)), 0.05)
    assert (found.covered, len(found.scans)) == (60, 60)
    assert found.scans[0] is scans[0]  # it was right
    assert 50 < found.moved < 60
    for t, placed in enumerate(found.scans):
        pose = truth(t).compose(MOUNT.pose)
        assert placed.scan is scans[t].scan
        if placed is not scans[t]:
            assert_same((placed.pose.x_m, placed.pose.y_m, placed.pose.yaw_rad), pose)
    # The doubt turns with the robot and keeps its size.
    before, after = scans[59].belief.covariance, found.scans[59].belief.covariance
    assert np.linalg.eigvalsh(before) == pytest.approx(np.linalg.eigvalsh(after))
    # The same once more moves nothing: what was said then is kept beside what holds now.
    again = corrector.applied(found.scans, nodes_of(truth, range(60)), 0.05)
    assert again.moved == 0
    assert all(a is b for a, b in zip(again.scans, found.scans, strict=True))


@pytest.mark.parametrize(
    ('step', 'moves'),
    [
        (Pose2D(0.012, 0.0, 0.0), False),  # a quarter of 0.05 m is 0.0125 m
        (Pose2D(0.013, 0.0, 0.0), True),
        (Pose2D(0.0, 0.0, 0.005), False),  # readings at 2 m move by 0.01 m
        (Pose2D(0.0, 0.0, 0.007), True),
    ],
)
def test_only_what_moves_by_a_quarter_of_a_cell_is_placed_anew(step, moves):
    corrector = Corrector()
    scan = PlacedScan.at(fan(2.0, math.nan, stamp_ns=S), Pose2D())
    corrector.note(scan)
    found = corrector.applied([scan], nodes_of(lambda t: step, [1]), 0.05)
    assert (found.moved == 1) == moves == (found.scans[0] is not scan)


def test_a_robot_that_stood_stands_in_one_place_afterwards():
    """From 10 to 20 s it stood; what is wrong by then grows from node to node all the same."""

    def said(t):
        return Pose2D(min(t, 10.0) + max(t - 20.0, 0.0), 0.0, 0.0)

    corrector = Corrector()
    scans = [PlacedScan.at(fan(2.0, stamp_ns=t * S), said(t)) for t in range(31)]
    for scan in scans:
        corrector.note(scan)
    nodes = nodes_of(lambda t: said(t).compose(Pose2D(0.0, 0.1 * t, 0.0)), range(0, 31, 5))
    found = corrector.applied(scans, nodes, 0.05).scans
    assert found[10].pose.y_m == pytest.approx(1.0)
    assert {scan.pose for scan in found[10:21]} == {found[10].pose}
    assert len({scan.pose for scan in found}) == 21
    # One that stood before the first node is placed by the first scan that nodes cover.
    late = corrector.applied(scans, nodes_of(said, [15, 25]), 0.05)
    assert late.covered == 11


def test_particles_are_carried_along_as_one_body():
    rng = np.random.default_rng(0)
    samples = PoseSamples.checked(rng.normal(size=(50, 3)) * 0.1 + (1.0, 2.0, 2.0))
    belief = PoseBelief(samples.mean(), samples.covariance(), samples)
    carried = belief.carried_to(Pose2D(-4.0, 7.0, -1.0))
    mean, covariance = carried.particles.mean(), carried.particles.covariance()
    assert (mean.x_m, mean.y_m, mean.yaw_rad) == pytest.approx((-4.0, 7.0, -1.0))
    assert covariance == pytest.approx(carried.covariance)
    still = belief.carried_to(belief.mean)
    assert still.particles.poses == pytest.approx(samples.poses)
    assert still.covariance == pytest.approx(belief.covariance)
