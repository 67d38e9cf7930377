import math

import pytest

from ogm_mcmc.engine.pose_watch import ENOUGH, Corrections, RarePoses
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

S = 1_000_000_000


def told(poses):
    """Lines about poses (time in s, x)."""
    watch = RarePoses()
    return [line for t, x in poses if (line := watch.add(round(t * S), Pose2D(x)))]


def test_rare_poses_of_a_moving_robot_are_told_once():
    (line,) = told((2.0 * k, 0.25 * k) for k in range(20))
    assert line.startswith('poses come every 2.0 s, and the robot moves 0.25 m between them')


def test_frequent_poses_are_not():
    assert told((0.1 * k, 0.1 * k) for k in range(50)) == []


def test_a_robot_that_stands_still_says_so_as_rarely_as_it_likes():
    assert told((5.0 * k, 0.0) for k in range(50)) == []


def test_a_few_are_not_enough_to_tell():
    assert told((2.0 * k, 0.25 * k) for k in range(ENOUGH)) == []


def entry(parent, child, t, x=0.0, yaw=0.0):
    turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return StampedTransform(parent, child, round(t * S), RigidTransform((x, 0.0, 0.0), turn))


def corrections(*entries, limit_m=0.3):
    """Lines about transforms, of a robot 10 m from the origin of its odometry."""
    tree = TransformTree()
    tree.add(entry('odom', 'base_link', 0.0, 10.0))
    tree.add(entry('map', 'other', 0.0))
    watch = Corrections(tree, 'map', 'base_link')
    lines = []
    for one in entries:
        tree.add(one)
        lines.append(watch.add(one, limit_m))
    return [line for line in lines if line]


def test_a_step_of_the_odometry_in_the_map_is_a_correction():
    (line,) = corrections(entry('map', 'odom', 1.0), entry('map', 'odom', 1.1, 0.5))
    assert line.startswith('map -> odom moved the robot by 0.50 m and 0.0 degrees at once')


def test_small_steps_are_none():
    assert corrections(*(entry('map', 'odom', 0.1 * k, 0.2 * k) for k in range(9))) == []


def test_a_turn_counts_where_the_robot_is():
    """0.05 rad move a robot that is 10 m from the origin by 0.5 m."""
    (line,) = corrections(entry('map', 'odom', 1.0), entry('map', 'odom', 1.1, 0.0, 0.05))
    assert line.startswith('map -> odom moved the robot by 0.50 m and 2.9 degrees at once')


@pytest.mark.parametrize(
    'entries',
    [
        [entry('map', 'base_link', 1.0), entry('map', 'base_link', 1.1, 5.0)],
        [entry('odom', 'base_link', 1.0), entry('odom', 'base_link', 1.1, 5.0)],
        [entry('map', 'other', 1.0), entry('map', 'other', 1.1, 5.0)],
    ],
    ids=['the robot moves in the map', 'the robot moves', 'something else moves'],
)
def test_what_is_no_correction(entries):
    assert corrections(*entries) == []


def test_without_a_limit_nothing_is_told():
    steps = entry('map', 'odom', 1.0), entry('map', 'odom', 1.1, 50.0)
    assert corrections(*steps, limit_m=0.0) == []
