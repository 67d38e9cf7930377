"""Odometry beside the poses in use: which, where the robot was by it, what moves come of it."""

import numpy as np
import pytest

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.odometry import (
    OdometryTrack,
    odometry_among,
    odometry_frame,
    said_odometry,
    wheel_moves,
)
from ogm_mcmc.engine.pose_choice import TF, PoseCandidate, PoseChoice, RankedPoses
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader

SECOND = 1_000_000_000
NOBODY = np.zeros(0, np.int64)


def ranked(name: str, frame: str, share: float, kind: str = ros_types.ODOMETRY) -> RankedPoses:
    child = 'turret' if name == '/turret' else 'base_link'
    return RankedPoses(PoseCandidate(name, kind, frame, child, (NOBODY,)), share)


POSE = ranked('/pose', 'map', 1.0, ros_types.POSE)
ODOM = ranked('/odom', 'odom', 0.9)


@pytest.mark.parametrize(
    ('chosen', 'others', 'expected'),
    [
        (POSE, [ODOM], '/odom'),
        (POSE, [ODOM, ranked(TF, 'robot/odom', 1.0, TF)], TF),
        (POSE, [ranked('/odom', 'robot1_odom', 0.9)], '/odom'),
        (POSE, [ranked('/odom', 'odom/map', 0.9)], None),
        (POSE, [ranked(TF, 'odom', 0.9, TF), ODOM], '/odom'),
        (POSE, [ranked('/odom', 'odom', 0.4)], None),
        (POSE, [ranked('/truth', 'map', 1.0), ranked('/goal', 'odom', 1.0, ros_types.POSE)], None),
        (ODOM, [ranked(TF, 'odom', 1.0, TF)], None),
        (ranked('/filter', 'odom', 1.0, ros_types.POSE), [ODOM], None),
        (POSE, [], None),
    ],
)
def test_odometry_is_what_is_in_a_frame_of_that_name(chosen, others, expected):
    choice = PoseChoice(chosen, tuple(others), NOBODY)
    found = odometry_among(choice, 'base_link', TransformTree())
    assert (None if found is None else found.candidate.name) == expected


def placed(seconds: list[float], offset: Pose2D) -> list[PlacedScan]:
    scans = []
    for k, s in enumerate(seconds):
        scan = Scan.checked(
            np.linspace(1.0, 1.5, 16), angle_min_rad=0.0, angle_increment_rad=0.1,
            range_min_m=0.0, range_max_m=5.0, stamp_ns=round(s * SECOND),
        )  # fmt: skip
        scans.append(PlacedScan(scan, PoseBelief(Pose2D(0.1 * k), offset=offset)))
    return scans


def test_moves_are_those_of_the_sensor():
    """A robot that turns on the spot swings a sensor in front of it."""
    robot = {0: Pose2D(), SECOND: Pose2D(0.0, 0.0, np.pi / 2.0)}
    scans = placed([0.0, 1.0, 2.0], Pose2D(0.5))
    moves = wheel_moves(scans, np.arange(3), robot.get)
    assert moves is not None
    np.testing.assert_array_equal(moves.first, [0])  # of the last scan nothing is known
    np.testing.assert_allclose(moves.move, [(-0.5, 0.5, np.pi / 2.0)], atol=1e-12)
    assert wheel_moves(scans, np.arange(3), lambda stamp: None) is None


def test_a_track_keeps_what_was_wanted_when_it_is_known():
    track = OdometryTrack()
    track.want(SECOND // 2)
    track.add(0, PoseBelief(Pose2D(0.0)))
    assert track.at(SECOND // 2) is None
    track.add(SECOND, PoseBelief(Pose2D(1.0)))
    track.settle()
    assert track.at(SECOND // 2) == Pose2D(0.5)
    track.want(SECOND // 4)
    assert track.at(SECOND // 4) == Pose2D(0.25)
    track.want(-SECOND)  # before all of it: it will not come
    track.settle()
    assert track.at(-SECOND) is None
    assert len(track) == 2
    track.clear()
    assert track.at(SECOND // 2) is None


def test_the_frame_of_odometry_is_the_nearest_above_the_base():
    tree = TransformTree()
    assert odometry_frame(tree, 'base_link') == ''
    for k in range(3):
        here = RigidTransform((0.1 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        for parent, child in (('map', 'rig/odom'), ('rig/odom', 'base_link')):
            tree.add(StampedTransform(parent, child, k * SECOND, here))
    assert odometry_frame(tree, 'base_link') == 'rig/odom'
    track = OdometryTrack(TfPoses(tree, 'rig/odom', 'base_link'))
    track.want(SECOND + SECOND // 2)
    track.want(9 * SECOND)  # it may still come
    assert track.at(SECOND + SECOND // 2).x_m == pytest.approx(0.15)
    assert len(track) == 1


@pytest.mark.parametrize('used', [True, False])
def test_odometry_is_used_unless_it_is_switched_off(used):
    scans = placed([0.0, 1.0, 2.0], Pose2D())
    known = {scan.scan.stamp_ns: Pose2D(0.1 * k) for k, scan in enumerate(scans)}
    config = TrajectoryConfig(odometry=used, draws=2)
    refinement = PoseRefinement(scans, config, known.get)
    assert refinement.figures()['odometry_steps'] == (2 if used else 0)
    assert refinement.estimator.move_scales.size == (2 if used else 1)
    assert refinement.odometry_scale == 1.0


def test_one_line_says_what_was_used():
    scans = placed([0.0, 1.0, 2.0], Pose2D())
    known = {scan.scan.stamp_ns: Pose2D() for scan in scans}
    moves = wheel_moves(scans, np.arange(3), known.get)
    assert said_odometry('/odom 100 %', moves, 3, 4.0) == (
        'odometry of /odom 100 % used for 2 of 2 steps between scans; errs 2.0 times as much as '
        'taken for granted'
    )
    assert 'without odometry' in said_odometry('', None, 3)


@pytest.mark.parametrize('choice', [{}, {'pose_topic': '/pose'}, {'pose_source': 'pose'}])
def test_odometry_of_a_bag_is_found_beside_its_poses(write_bag, make_scan, make_pose, choice):
    stamps = [20 * SECOND + k * SECOND // 10 for k in range(8)]
    records = []
    for k, stamp in enumerate(stamps):
        records += [
            ('/scan', stamp, make_scan(stamp)),
            ('/pose', stamp, make_pose(stamp, 0.1 * k)),
            ('/odom', stamp, ros_types.odometry(stamp, Pose2D(0.1 * k), 1.0, 0.0)),
        ]
    wanted = StreamChoice(**choice)
    with BagReader(write_bag(records, 'mcap')) as bag:
        scans = PlacedScans(bag, choose_topics(bag, wanted), wanted)
        assert scans.topics.pose_name == '/pose'
        assert list(scans)
        odometry = scans.odometry()
    assert odometry is not None
    assert scans.odometry_name == '/odom 100 %'
    assert odometry(stamps[3]).x_m == pytest.approx(0.3)
    assert odometry(stamps[3] + SECOND // 20).x_m == pytest.approx(0.35)
    assert odometry(stamps[0] - 1) is None


@pytest.mark.parametrize('always', [0, 20 * SECOND])
def test_odometry_of_a_bag_whose_clock_stands_still(write_bag, make_scan, make_pose, always):
    """It is taken at the times of recording, and that is said, as of scans and poses."""
    records = []
    for k in range(8):
        stamp = 20 * SECOND + k * SECOND // 5
        records += [
            ('/scan', stamp, make_scan(stamp)),
            ('/pose', stamp, make_pose(stamp, 0.1 * k)),
            ('/odom', stamp, ros_types.odometry(always, Pose2D(0.1 * k), 1.0, 0.0)),
        ]
    said = []
    with BagReader(write_bag(records, 'mcap')) as bag:
        scans = PlacedScans(bag, choose_topics(bag, StreamChoice()), StreamChoice())
        scans.tell = said.append
        odometry = scans.odometry()
    assert odometry(20 * SECOND + SECOND // 2).x_m == pytest.approx(0.25)
    assert said == ['stamps on /odom are all 0 or all the same: the times of recording are taken']
    assert scans.topics.unstamped == frozenset()


@pytest.mark.parametrize(
    ('limits', 'jump', 'asked', 'x_m'),
    [
        ({}, 4, 3.5, None),
        ({'max_speed_m_s': 100.0}, 4, 3.5, 2.85),
        ({}, 7, 7.0, 5.7),  # none comes after it
    ],
)
def test_limits_of_poses_hold_for_the_odometry_of_a_bag(
    write_bag, make_scan, make_pose, limits, jump, asked, x_m
):
    stamps = [20 * SECOND + k * SECOND // 10 for k in range(8)]
    records = []
    for k, stamp in enumerate(stamps):
        records += [
            ('/scan', stamp, make_scan(stamp)),
            ('/pose', stamp, make_pose(stamp, 0.1 * k)),
            (
                '/odom',
                stamp,
                ros_types.odometry(stamp, Pose2D(0.1 * k + 5.0 * (k >= jump)), 1.0, 0.0),
            ),
        ]
    wanted = StreamChoice(**limits)
    with BagReader(write_bag(records, 'mcap')) as bag:
        odometry = PlacedScans(bag, choose_topics(bag, wanted), wanted).odometry()
    found = odometry(stamps[0] + round(asked * SECOND / 10))
    assert (None if found is None else found.x_m) == pytest.approx(x_m)


class Counting(PoseHistory):
    asked = 0

    def at(self, stamp_ns):
        self.asked += 1
        return super().at(stamp_ns)


def test_stamps_that_wait_are_not_all_tried_again():
    track = OdometryTrack(Counting())
    for k in range(1500):
        track.want(k * SECOND)
    assert track.source.asked == 1500
    assert track.n_waiting == 1000
    track.add(1400 * SECOND, PoseBelief(Pose2D()))
    track.add(1401 * SECOND, PoseBelief(Pose2D(1.0)))
    track.settle()
    assert (len(track), track.n_waiting) == (2, 98)


def test_stamps_wait_in_order_and_those_ahead_of_a_restart_are_forgotten():
    track = OdometryTrack()
    for seconds in (9.0, 9.5, 9.2):  # of several sensors
        track.want(round(seconds * SECOND))
    track.add(9 * SECOND, PoseBelief(Pose2D()))
    track.add(round(9.3 * SECOND), PoseBelief(Pose2D(0.3)))
    track.settle()
    assert track.at(round(9.2 * SECOND)).x_m == pytest.approx(0.2)
    assert track.n_waiting == 1
    track.want(SECOND)
    assert track.n_waiting == 0  # 9.5 s is of the time before; 1 s is older than all odometry
