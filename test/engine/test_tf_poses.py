import math

import pytest
from support.strategies import fan

from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import Unplaceable, Waiting
from ogm_mcmc.engine.tf_poses import TfPoses, guess_frames
from ogm_mcmc.engine.transform_tree import TransformError, TransformTree
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import Pose2D, SensorMount
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

approx = pytest.approx
S = 1_000_000_000
ROLLED = (1.0, 0.0, 0.0, 0.0)
TILTED = (0.0, math.sin(0.2), 0.0, math.cos(0.2))


def entry(parent, child, stamp_s, x=0.0, y=0.0, yaw=0.0, turn=None):
    turn = turn or (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return StampedTransform(parent, child, round(stamp_s * S), RigidTransform((x, y, 0.0), turn))


def poses_of(*entries, static=(), **options):
    tree = TransformTree()
    for one in static:
        tree.add(one, static=True)
    for one in entries:
        tree.add(one)
    return TfPoses(tree, 'map', 'base_link', **options)


def why_not(poses, stamp_s):
    with pytest.raises(Unplaceable) as caught:
        poses.at(round(stamp_s * S))
    return str(caught.value)


def mount_of(poses, sensor_frame, stamp_ns):
    """Return a mount; None where tf does not say."""
    try:
        return poses.mount_at(sensor_frame, stamp_ns)
    except TransformError:
        return None


def driving(*, until_s=3, jump_m=0.0):
    """1 m/s along x; from 2 s on the localizer has the robot elsewhere."""
    for k in range(10 * until_s + 1):
        yield entry('odom', 'base_link', k / 10, x=k / 10)
        yield entry('map', 'odom', k / 10, y=0.0 if k < 20 else jump_m)


def test_the_pose_at_a_stamp():
    poses = poses_of(*driving())
    assert poses.at(round(1.25 * S)).mean.x_m == approx(1.25)


def test_what_may_still_come_is_waited_for():
    poses = poses_of(entry('odom', 'base_link', 0.0), entry('odom', 'base_link', 2.0))
    with pytest.raises(Waiting):
        poses.at(S)  # no map yet
    poses.tree.add(entry('map', 'odom', 0.5))
    with pytest.raises(Waiting):
        poses.at(S)
    poses.tree.add(entry('map', 'odom', 1.0))
    assert poses.at(S).mean == Pose2D()


def test_what_will_not_come_is_not_waited_for():
    poses = poses_of(*driving(jump_m=5.0), max_gap_s=2.0)
    assert why_not(poses, -1.0) == 'scan_before_poses'
    poses.tree.add(entry('odom', 'base_link', 6.0, x=6.0))
    poses.tree.add(entry('map', 'odom', 6.0, y=5.0))
    assert why_not(poses, 4.0) == 'pose_gap'
    assert poses.at(6 * S).mean == Pose2D(6.0, 5.0, 0.0)


def test_between_two_places_the_robot_never_was():
    poses = poses_of(*driving(jump_m=5.0))
    assert why_not(poses, 1.95) == 'pose_jump'
    assert poses.at(round(1.85 * S)).mean.x_m == approx(1.85)
    assert poses.at(2 * S).mean == Pose2D(2.0, 5.0, 0.0)
    assert poses_of(*driving(jump_m=5.0), max_speed_m_s=60.0).at(round(1.95 * S)).mean.y_m == (
        approx(2.5)
    )


def test_a_stray_transform_places_nothing_even_at_its_own_stamp():
    def entries(*xs):
        static = [entry('map', 'odom', 0.0)]
        moving = (entry('odom', 'base_link', k / 10, x=x) for k, x in enumerate(xs))
        return poses_of(*moving, static=static)

    assert why_not(entries(0.0, 900.0, 0.2), 0.1) == 'pose_jump'
    assert entries(0.0, 900.0, 900.1).at(S // 10).mean.x_m == 900.0
    with pytest.raises(Waiting):
        entries(0.0, 900.0).at(S // 10)
    placer = ScanPlacer(entries(0.0, 900.0))
    placer.add_scan(fan(1.0, stamp_ns=S // 10))
    assert list(placer.placed()) == []
    assert [one.belief.mean.x_m for one in placer.flush()] == [900.0]  # none contradicts it
    assert entries(900.0, 0.1, 0.2).at(0).mean.x_m == 900.0  # nothing before it


def test_a_small_turn_far_from_the_origin_is_no_jump():
    """0.01 rad of map -> odom moves odom by 5 m, the robot by nothing."""
    far = entry('odom', 'base_link', 0.0, x=500.0)
    shift = Pose2D(500.0).compose(Pose2D(0.0, 0.0, 0.01)).compose(Pose2D(-500.0))
    poses = poses_of(
        far,
        far._replace(stamp_ns=S // 10),
        entry('map', 'odom', 0.0),
        entry('map', 'odom', 0.1, shift.x_m, shift.y_m, shift.yaw_rad),
    )
    assert math.hypot(shift.x_m, shift.y_m) == approx(5.0, rel=1e-3)
    assert poses.at(S // 20).mean.x_m == approx(500.0, abs=0.01)


def test_a_robot_on_its_head_or_tilted_is_not_placed():
    static = [entry('map', 'odom', 0.0)]
    for turn in (ROLLED, TILTED):
        poses = poses_of(entry('odom', 'base_link', 0.0, turn=turn), static=static)
        assert why_not(poses, 0.0) == 'pose_unusable'


def test_mounts():
    poses = poses_of(
        static=[
            entry('base_link', 'laser', 0.0, x=0.2, turn=ROLLED),
            entry('base_link', 'tilted', 0.0, turn=TILTED),
        ]
    )
    assert mount_of(poses, 'laser', 5) == SensorMount(Pose2D(0.2, 0.0, 0.0), upside_down=True)
    assert mount_of(poses, 'sonar', 5) is None
    assert mount_of(poses, 'base_link', 5) == SensorMount()
    with pytest.raises(PoseError, match='tilted on base_link: orientation is tilted by 23 deg'):
        mount_of(poses, 'tilted', 5)


def test_a_moving_mount_is_waited_for_where_it_is_named():
    poses = poses_of(*driving(), sensor_frames=['laser'])
    with pytest.raises(Waiting):
        poses.at(S)
    poses.tree.add(entry('base_link', 'laser', 0.5, yaw=0.5))
    with pytest.raises(Waiting):
        poses.at(S)
    assert mount_of(poses, 'laser', S) is None
    poses.tree.add(entry('base_link', 'laser', 1.5, yaw=1.5))
    assert poses.at(S).mean == Pose2D(1.0, 0.0, 0.0)
    assert mount_of(poses, 'laser', S).pose.yaw_rad == approx(1.0)


def test_a_placer_counts_what_tf_cannot_say():
    poses = poses_of(*driving(jump_m=5.0))
    placer = ScanPlacer(poses)
    for stamp_s in (-0.5, 1.0, 1.95, 2.5, 9.0):
        placer.add_scan(fan(1.0, stamp_ns=round(stamp_s * S)))
    assert [placement.scan.stamp_ns / S for placement in placer.flush()] == [1.0, 2.5]
    assert placer.dropped == {'scan_before_poses': 1, 'pose_jump': 1, 'pose_timeout': 1}


def test_time_that_starts_again_takes_what_moves_with_it():
    poses = poses_of(*driving(), static=[entry('base_link', 'laser', 0.0)])
    poses.clear()
    assert poses.at(S)
    poses.restart(0)
    with pytest.raises(Waiting):
        poses.at(S)
    assert mount_of(poses, 'laser', 0) == SensorMount()


def guessed(*edges, sensor='laser', **names):
    """Edges as parent, child, True for one that moves."""
    tree = TransformTree()
    for parent, child, moving in edges:
        tree.add(entry(parent, child, 0.0), static=not moving)
    return guess_frames(tree, sensor, **names)


@pytest.mark.parametrize(
    ('edges', 'expected'),
    [
        (
            [
                ('earth', 'map', False),
                ('map', 'odom', True),
                ('odom', 'base_footprint', True),
                ('base_footprint', 'base_link', False),
                ('base_link', 'laser', False),
            ],
            ('map', 'base_link'),
        ),
        (
            [('odom', 'base_footprint', True), ('base_footprint', 'laser', False)],
            ('odom', 'base_footprint'),
        ),
        (
            [('odom', 'r1/base_link', True), ('r1/base_link', 'laser', True)],
            ('odom', 'r1/base_link'),
        ),
        ([('odom', 'cart', True), ('cart', 'laser', False)], ('odom', 'cart')),
        ([('w', 'odom', True), ('odom', 'cart', True), ('cart', 'laser', True)], ('w', 'laser')),
        ([('base_link', 'laser', False)], None),
        ([], None),
    ],
)
def test_guessed_frames(edges, expected):
    assert guessed(*edges) == expected


def test_named_frames_are_taken_as_they_are():
    edges = [('map', 'odom', True), ('odom', 'cart', True), ('cart', 'laser', False)]
    assert guessed(*edges, map_frame='odom') == ('odom', 'cart')
    assert guessed(*edges, base_frame='odom') == ('map', 'odom')
    assert guessed(*edges, map_frame='m', base_frame='b') == ('m', 'b')
