"""`replay` of recordings whose poses cannot be sent as they are."""

import json
from functools import partial
from threading import Thread

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan
from support.local_ros import local_node
from support.ros import NodeProcess, Observer
from support.transforms import transform

from ogm_mcmc.config.nodes import ReplayConfig
from ogm_mcmc.engine.placing import final_belief
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import messages
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.ros_types import odometry
from ogm_mcmc.io.tf_messages import read_transform
from ogm_mcmc.io.tum_files import HEADER
from ogm_mcmc.ros.computed_poses import computed_poses
from ogm_mcmc.ros.replay import Replay

pytestmark = [pytest.mark.ros]

approx = pytest.approx

SECOND = 1_000_000_000
STAMPS = [20 * SECOND + k * SECOND // 10 for k in range(6)]
NUMBERED = list(enumerate(STAMPS))


@pytest.fixture
def records(make_scan):
    """Scans half way between the transforms; map -> odom -> base_link, a turned laser."""
    held = [
        ('/tf_static', 0, transform(0, 'base_link', 'laser', 0.2, 0.0, 1.5, 3.141592653589793))
    ]
    for k, stamp in enumerate(STAMPS):
        held.append(('/tf', stamp, transform(stamp, 'map', 'odom', 5.0, 0.0, 0.0)))
        held.append(('/tf', stamp, transform(stamp, 'odom', 'base_link', 0.1 * k, 1.0, 0.0)))
        held.append(('/scan', stamp, make_scan(stamp + SECOND // 20)))
    return held


def replayed(path, *arguments):
    with Observer() as observer:
        poses = observer.collect(PoseWithCovarianceStamped, 'pose', 100)
        scans = observer.collect(LaserScan, 'scan', 100)
        command = [str(path), '--json', '--rate', '0', '--wait', '20', *map(str, arguments)]
        with NodeProcess('replay', command) as player:
            observer.until(lambda: not player.running(), 60.0)
            assert player.wait() == 0, player.output
        observer.until(lambda: len(scans) == len(STAMPS), 10.0)
    return poses, json.loads(player.output.strip().splitlines()[-1]), player.output


def test_poses_of_tf_are_computed_where_tf_cannot_be_sent(write_bag, records):
    poses, done, output = replayed(write_bag(records), '--pose-source', 'tf')
    assert done['published']['pose'] == 5  # the last scan is later than the transforms
    assert [messages.stamp_of(pose) for pose in poses] == [t + SECOND // 20 for t in STAMPS[:5]]
    assert [pose.pose.pose.position.x for pose in poses] == pytest.approx(
        [5.05 + 0.1 * k for k in range(5)]
    )
    assert {pose.header.frame_id for pose in poses} == {'map'}
    assert "mount.frames:='laser 0.2 0 1.5 upside_down'" in output
    assert 'pose_source:=pose map_frame:=map' in output


@pytest.mark.parametrize(
    ('unstamped', 'computed'),
    [((), False), (('odom', 'base_link'), True), (('base_link',), True), (('ball',), False)],
)
def test_poses_of_tf_without_stamps_are_computed_even_where_tf_is_sent(
    write_bag, records, unstamped, computed
):
    """Nodes see no times of recording, by which `map` goes. A ball carries no sensor."""
    records += [('/tf', t, transform(t, 'odom', 'ball', 3.0, 0.1 * k, 0.0)) for k, t in NUMBERED]
    for name, _, message in records:
        if name == '/tf' and message.transforms[0].child_frame_id in unstamped:
            stamp = message.transforms[0].header.stamp
            stamp.sec = stamp.nanosec = 0
    with BagReader(write_bag(records)) as bag, local_node(partial(Node, 'player')) as node:
        poses = computed_poses(node, bag, ReplayConfig(), tf_is_sent=True)
        assert (poses is not None) == computed
        if poses is not None:
            sent = [poses.before(record) for record in bag.records(('/scan',))]
            assert sent == [['pose']] * 5 + [[]]


def test_a_clock_that_began_late_leaves_tf_of_use(write_bag, records):
    """`map` goes by the stamps that follow, and so do nodes: however many of 0 were first."""
    early = ('/tf', STAMPS[0], transform(0, 'odom', 'base_link', 0.0, 1.0, 0.0))
    with (
        BagReader(write_bag([early] * 120 + records)) as bag,
        local_node(partial(Node, 'player')) as node,
    ):
        assert computed_poses(node, bag, ReplayConfig(), tf_is_sent=True) is None


def place(pose):
    return pose.x_m, pose.y_m, pose.yaw_rad


@pytest.mark.parametrize('source', ['tf', 'odom'])
def test_sensors_that_move_on_the_robot_are_where_they_were(write_bag, make_scan, source):
    """A robot that drives: a laser turns, one is pushed out head down, one sits still."""
    held = [('/tf_static', 0, transform(0, 'base_link', 'rear', -0.3, 0.0, 3.0))]
    for k, stamp in enumerate(STAMPS):
        held.append(('/tf', stamp, transform(stamp, 'odom', 'base_link', 0.1 * k, 1.0, 0.0)))
        turned = transform(stamp, 'base_link', 'laser', 0.2, 0.0, 0.5 + 0.3 * k)
        pushed = transform(stamp, 'base_link', 'arm', 0.1 * k, 0.5, 1.0, 3.141592653589793)
        held += [('/tf', stamp, turned), ('/tf', stamp, pushed)]
        held.append(('/odom', stamp, odometry(stamp, Pose2D(0.1 * k, 1.0), 0.0, 0.0)))
        held += [(f'/{f}', stamp, make_scan(stamp, frame=f)) for f in ('laser', 'arm', 'rear')]
    with Observer() as observer:
        transforms = observer.collect(TransformStamped, 'mount', 100)
        poses = observer.collect(PoseWithCovarianceStamped, 'pose', 100)
        command = [write_bag(held), '--rate', '0', '--wait', '20', '--wait-topics', '2']
        with NodeProcess('replay', [*map(str, command), '--pose-source', source]) as player:
            observer.until(lambda: not player.running(), 60.0)
            assert player.wait() == 0, player.output
        observer.until(lambda: len(transforms) == 2 * len(STAMPS), 10.0)
        observer.until(lambda: len(poses) == len(STAMPS), 10.0)
        assert len(poses) == len(STAMPS)  # three scans share one
    assert 'arm, laser move on the robot: where to is published on mount' in player.output
    assert "base_frame:=base_link mount.frames:='rear -0.3 0 3'" in player.output
    assert 'mount_source:=topic' in player.output
    for k, stamp in enumerate(STAMPS):
        now = [read_transform(one) for one in transforms[2 * k : 2 * k + 2]]
        assert {(one.parent, one.child, one.stamp_ns) for one in now} == {
            ('base_link', 'laser', stamp),
            ('base_link', 'arm', stamp),
        }
        arm, laser = (one.transform.planar() for one in sorted(now, key=lambda one: one.child))
        assert (*place(laser[0]), laser[1]) == approx((0.2, 0.0, 0.5 + 0.3 * k, False))
        assert (*place(arm[0]), arm[1]) == approx((0.1 * k, 0.5, 1.0, True), abs=1e-9)
        assert messages.read_pose(poses[k]).mean.x_m == approx(0.1 * k)


def test_poses_of_a_file(write_bag, records, tmp_path):
    path = tmp_path / 'poses.tum'
    path.write_text('20.0 1 2 0 0 0 0 1\n21.0 1 3 0 0 0 0 1\n')
    spread = '0.1,0.2,0.3\n'
    (tmp_path / 'poses_deviations.csv').write_text(f'{HEADER}\n20.0,{spread}21.0,{spread}')
    said = ('--trajectory', path, '--trajectory-deviations', '--topics', 'scan')
    poses, done, _ = replayed(write_bag(records), *said)
    assert done['published'] == {'pose': 6, '/scan': 6}
    assert poses[0].pose.pose.position.y == pytest.approx(2.05)
    # Deviations beside the file, for nodes that average over them.
    assert poses[0].pose.covariance[::7] == pytest.approx([0.01, 0.04, 0.0, 0.0, 0.0, 0.09])


def test_deviations_beside_a_file_are_not_sent_unasked(write_bag, records, tmp_path):
    """Poses that came of the same scans would count twice where nodes estimate poses."""
    path = tmp_path / 'poses.tum'
    path.write_text('20.0 1 2 0 0 0 0 1\n21.0 1 3 0 0 0 0 1\n')
    spread = '0.1,0.2,0.3\n'
    (tmp_path / 'poses_deviations.csv').write_text(f'{HEADER}\n20.0,{spread}21.0,{spread}')
    with BagReader(write_bag(records)) as bag, local_node(partial(Node, 'player')) as node:
        for asked in ({}, {'trajectory_deviations': True}):
            settings = ReplayConfig(trajectory=str(path), **asked)
            poses = computed_poses(node, bag, settings, tf_is_sent=True)
            belief = final_belief(poses.source, STAMPS[1])
            assert (belief.covariance is not None) == bool(asked)


def test_a_recording_of_less_than_a_second_played_again_has_its_poses_again(write_bag, records):
    values = {'loop': True, 'rate': 0.0, 'wait': 0.0, 'pose_source': 'tf'}
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    make = partial(Replay, write_bag(records), parameter_overrides=overrides)
    with local_node(make) as node:
        player = Thread(target=node.play)
        player.start()
        node.until(lambda: node.counts.loops >= 3)
        node.stopped.set()
        player.join()
        published, loops = node.counts.published, node.counts.loops
        assert published['/scan'] >= 6 * (loops - 1)
        assert published['pose'] >= 5 * (loops - 1)
