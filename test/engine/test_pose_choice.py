import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.engine.pose_choice import PoseCandidate, choose_poses, coverage, tf_candidates
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

S = 1_000_000_000
SCANS = np.arange(0, 100 * S, S // 10)

ODOMETRY = 'nav_msgs/msg/Odometry'
COVARIANCE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
POSE = 'geometry_msgs/msg/PoseStamped'
ARRAY = 'geometry_msgs/msg/PoseArray'


def every(seconds, first=0.0, last=100.0):
    return (np.arange(first, last + 1e-9, seconds) * S).astype(np.int64)


def source(name, kind, frame, *stamps, child=''):
    return PoseCandidate(name, kind, frame, child, stamps)


ODOM = source('/odom', ODOMETRY, 'odom', every(0.02))
TF_MAP = source('tf', 'tf', 'map', every(0.1, first=3.0), every(0.02), child='base_link')
TF_ODOM = source('tf', 'tf', 'odom', every(0.02), child='base_link')
INITIAL = source('/initialpose', COVARIANCE, 'map', np.array([5 * S, 6 * S, 50 * S]))
GOAL = source('/goal_pose', POSE, 'map', np.array([8 * S]))
AMCL = source('/amcl_pose', COVARIANCE, 'map', every(5.0))
SLAM = source('/pose', COVARIANCE, 'map', every(0.4))
SLOW = source('/pose', COVARIANCE, 'map', every(1.0))
POINTS = source('/tracked_pose', POSE, 'map', every(0.1))
WAYPOINTS = source('/waypoints', ARRAY, 'map', every(0.1))
PARTICLES = source('/particlecloud', ARRAY, 'map', every(0.1))


def chosen(*candidates):
    choice = choose_poses(candidates, SCANS)
    assert len(choice.others) == len(candidates) - 1
    return choice.chosen.candidate


@pytest.mark.parametrize(
    'order',
    [
        (ODOM, TF_ODOM, INITIAL),
        (TF_MAP, ODOM),  # although it starts 3 s later
        (ODOM, AMCL),
        (TF_MAP, SLOW, AMCL),
        (SLAM, TF_MAP, POINTS),
        (PARTICLES, TF_MAP, WAYPOINTS),
        (SLOW, ODOM),
        (POINTS, INITIAL, GOAL),
    ],
)
def test_the_better_source_is_chosen_in_any_order(order):
    assert chosen(*order) == order[0]
    assert chosen(*reversed(order)) == order[0]


def test_a_localizer_that_covers_half_is_not_enough():
    half = source('/pose', COVARIANCE, 'map', every(0.1, last=50.0))
    assert chosen(half, ODOM) == ODOM


def test_the_line_says_what_else_is_there():
    late = TF_MAP._replace(stamps=(every(0.1, first=20.0), every(0.02)))
    choice = choose_poses([INITIAL, GOAL, late, ODOM], SCANS)
    assert str(choice) == (
        'poses from /odom (nav_msgs/msg/Odometry, 100 % of 1000 scans); also there: '
        'tf map -> base_link 80 %, /initialpose 1 %, /goal_pose under 1 %'
    )
    assert str(choose_poses([TF_ODOM], SCANS)) == (
        'poses from tf odom -> base_link (100 % of 1000 scans)'
    )


def test_all_but_one_scan_is_not_called_100_percent():
    most = source('/odom', ODOMETRY, 'odom', every(0.1, first=0.1))
    assert '(nav_msgs/msg/Odometry, 99 % of 1000' in str(choose_poses([most], SCANS))


def test_another_clock_is_told():
    choice = choose_poses([ODOM, TF_MAP], SCANS + 1_700_000_000 * S)
    assert choice.chosen is None
    assert str(choice) == (
        'no poses at the stamps of the scans (1700000000.0 to 1700000099.9 s) that are at most '
        '2 s apart (max_pose_gap): there are tf map -> base_link 3.0 to 100.0 s, /odom 0.0 to '
        '100.0 s'
    )


@pytest.mark.parametrize(
    ('candidates', 'scans', 'line'),
    [
        ([], SCANS, 'no poses in it: expected a topic with poses or tf'),
        ([ODOM], SCANS[:0], 'no scans in it that poses could cover'),
        (
            [source('/odom', ODOMETRY, 'odom', SCANS[:0])],
            SCANS,
            'no poses at the stamps of the scans (0.0 to 99.9 s) that are at most 2 s apart '
            '(max_pose_gap): there are /odom never',
        ),
    ],
)
def test_nothing_to_choose(candidates, scans, line):
    choice = choose_poses(candidates, scans)
    assert choice.chosen is None
    assert str(choice) == line


def naive_coverage(edges, scans, max_gap):
    def covered(edge, scan):
        if scan in edge:
            return True
        before, after = [k for k in edge if k < scan], [k for k in edge if k > scan]
        return bool(before and after) and min(after) - max(before) <= max_gap

    return sum(all(covered(edge, scan) for edge in edges) for scan in scans) / len(scans)


numbers = st.lists(st.integers(0, 30), max_size=15)


@REPEATABLE
@given(st.lists(numbers, max_size=3), numbers.filter(bool), st.integers(0, 10))
def test_coverage_against_a_naive_twin(edges, scans, max_gap):
    arrays = [np.array(edge, np.int64) for edge in edges]
    expected = naive_coverage(edges, scans, max_gap)
    assert coverage(arrays, np.array(scans, np.int64), max_gap) == pytest.approx(expected)


def test_candidates_of_a_tree():
    tree = TransformTree()
    for parent, child, moving in (
        ('earth', 'map', False),
        ('map', 'odom', True),
        ('odom', 'base_link', True),
        ('base_link', 'laser', False),
    ):
        for stamp in (1, 2):
            entry = StampedTransform(parent, child, stamp, RigidTransform((stamp, 0.0, 0.0)))
            tree.add(entry, static=not moving)
    found = tf_candidates(tree, 'base_link')
    assert [(one.frame, one.child_frame, len(one.stamps)) for one in found] == [
        ('odom', 'base_link', 1),
        ('map', 'base_link', 2),
        ('earth', 'base_link', 2),
    ]
    assert chosen(*(one._replace(stamps=(every(0.1),)) for one in found)).frame == 'map'
    assert tf_candidates(tree, 'earth') == []


CARROT = source('/lookahead_pose', POSE, 'map', every(0.05))


@pytest.mark.parametrize('poses', [ODOM, TF_ODOM, POINTS, AMCL])
def test_targets_are_not_the_robot_however_often_they_come(poses):
    assert chosen(CARROT, poses) == poses
    assert chosen(CARROT) == CARROT


def test_tf_comes_before_single_points_on_a_topic():
    assert chosen(source('/anything', POSE, 'map', every(0.1)), TF_MAP) == TF_MAP


def test_what_is_not_wanted_is_named_only():
    choice = choose_poses([AMCL], SCANS, max_gap_s=10.0, unwanted=[TF_MAP, ODOM])
    assert choice.chosen.candidate == AMCL
    assert [one.candidate for one in choice.others] == [TF_MAP, ODOM]


def test_poses_that_come_rarely_are_told():
    rare = choose_poses([AMCL], SCANS, max_gap_s=10.0, unwanted=[TF_MAP])
    assert rare.rarely() == (
        'poses on /amcl_pose come every 5.0 s: between them the robot is taken to go straight, '
        'and scans in gaps of more than 10 s (max_pose_gap) are left out; better poses: '
        '--pose-source tf'
    )
    assert choose_poses([SLOW], SCANS).rarely().endswith('tf knows better: record /tf, too')
    assert choose_poses([ODOM], SCANS).rarely() == ''
    assert choose_poses([SLOW], every(1.0)).rarely() == ''  # each scan has its own
    assert choose_poses([TF_MAP], SCANS).rarely() == ''
    assert choose_poses([AMCL], SCANS[:0]).rarely() == ''


def test_odometry_that_is_sent_from_the_base_down():
    """KISS-ICP may do so, not to give the base a second parent."""
    tree = TransformTree()
    for k in range(3):
        for child in ('odom_lidar', 'wheel'):
            tree.add(StampedTransform('base_link', child, k * S, RigidTransform()))
    (found,) = tf_candidates(tree, 'base_link')
    assert (found.frame, found.child_frame) == ('odom_lidar', 'base_link')
