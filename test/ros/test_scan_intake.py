"""What nodes take in: every kind of pose, mounts, several lasers, and what they say about it."""

import importlib.util
import math
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseArray, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from support.intake import Bench
from support.local_ros import local_node, odometry, pose, pose_stamped, scan, tf2_msgs_twin

from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.config.nodes import IntakeConfig
from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.scan_intake import ScanIntake

pytestmark = [pytest.mark.ros]

approx = pytest.approx


@pytest.mark.parametrize(
    ('source', 'make'), [('pose', pose), ('pose_stamped', pose_stamped), ('odom', odometry)]
)
def test_each_kind_of_pose_places_scans(bench, source, make):
    taken = bench(pose_source=source, transform_timeout=1.0)
    taken.intake.on_pose(make(1.0, x=1.0))
    taken.scan(1.5)
    assert taken.used == []  # it waits
    taken.intake.on_pose(make(2.0, x=2.0, yaw=1.0))
    assert taken.where == [approx((1.5, 0.0, 0.5))]


def installed(msgtype):
    return importlib.util.find_spec(msgtype.split('/')[0]) is not None


@pytest.mark.parametrize('source', POSE_SOURCES)
def test_every_source_of_poses_can_be_subscribed_or_says_what_is_missing(bench, source):
    if installed(POSE_SOURCES[source][0]):
        bench(pose_source=source).intake.subscribe()
        return
    assert source in ('particle_cloud', 'tf')
    with pytest.raises(ConfigError, match=f'^pose_source {source} needs [^\n]*$'):
        bench(pose_source=source).intake.subscribe()


def test_odometry_gives_the_frame_of_the_map_and_what_sensors_sit_on(tf_bench):
    taken = tf_bench(pose_source='odom')
    taken.tf_static(('base_footprint', 'laser', 0, 0.5))
    taken.intake.on_pose(odometry(1.0, x=1.0, child='base_footprint'))
    taken.scan(1.0)
    assert taken.where == [approx((1.5, 0.0, 0.0))]
    assert taken.intake.settings.map_frame == 'odom'
    taken.intake.configure(IntakeConfig(pose_source='odom'), PlacingConfig())
    assert taken.intake.settings.map_frame == 'odom'
    other = odometry(2.0)
    other.header.frame_id = 'other_odom'
    taken.intake.on_pose(other)
    assert taken.problems == {'pose_wrong_frame': 1}


def test_a_covariance_that_nobody_needs_is_not_looked_at(node):
    message = pose(1.0, x=3.0)
    message.pose.covariance[0] = math.nan
    for needed, used in ((True, 0), (False, 1)):
        placed = []
        intake = ScanIntake(
            node, IntakeConfig(), PlacingConfig(), placed.append, with_covariance=needed
        )
        intake.on_pose(message)
        intake.on_scan(scan(1.0))
        assert len(placed) == used
        assert intake.problems.all()['pose_invalid'] == 1 - used


def test_scans_that_never_came_are_counted(bench):
    taken = bench()
    for k in [*range(25), 30]:
        stamp_s = 1.0 + 0.1 * k
        taken.intake.on_pose(pose(stamp_s))
        taken.scan(stamp_s)
    assert len(taken.used) == 26
    assert taken.problems == {'scan_never_came': 5}


def test_poses_from_tf(tf_bench):
    taken = tf_bench(pose_source='tf', transform_timeout=1.0)
    taken.tf_static(('base_link', 'laser', 0, 0.0, 0.1, math.pi / 2))
    taken.tf(('map', 'odom', 1.0, 5.0), ('odom', 'base_link', 1.0, 1.0))
    taken.scan(1.5)
    assert taken.used == []
    taken.tf(('map', 'odom', 2.0, 5.0), ('odom', 'base_link', 2.0, 2.0))
    assert taken.where == [approx((6.5, 0.1, math.pi / 2))]
    # Silent for three seconds round a corner.
    taken.tf(('map', 'odom', 5.0, 5.0), ('odom', 'base_link', 5.0, 5.0, 5.0))
    taken.scan(3.0)
    assert taken.problems == {'pose_gap': 1}


def test_the_speed_gate_holds_for_tf_and_can_be_changed(tf_bench):
    taken = tf_bench(pose_source='tf')

    def drive(start_s):
        for k, x in enumerate((0.0, 3.0)):
            stamp = start_s + 0.1 * k
            taken.tf(('map', 'odom', stamp, x), ('odom', 'base_link', stamp))
        taken.scan(start_s + 0.05, frame='base_link')

    drive(1.0)
    assert taken.used == []
    assert taken.problems == {'map_corrected': 1, 'pose_jump': 1}
    taken.intake.configure(taken.intake.settings, PlacingConfig(max_speed=100.0))
    drive(10.0)
    assert len(taken.used) == 1


def test_a_best_effort_publisher_is_heard(node):
    """amcl sends its particles so."""
    taken = Bench(node, pose_source='particles')
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = node.create_publisher(PoseArray, 'particles', best_effort)
    taken.intake.subscribe()
    cloud = PoseArray()
    cloud.header.frame_id = 'map'

    def heard():
        publisher.publish(cloud)
        return taken.intake.counts['poses_received'] > 0

    node.until(heard)
    assert any('/particles has a best-effort publisher' in line for line in taken.logs.of('info'))
    node.destroy_publisher(publisher)


def test_a_reliable_publisher_is_heard_reliably(node):
    taken = Bench(node, pose_source='odom')
    publisher = node.create_publisher(Odometry, 'odom', 100)
    taken.intake.subscribe()
    node.until(lambda: publisher.get_subscription_count() > 0)
    for k in range(50):
        publisher.publish(odometry(1.0 + k))
    node.until(lambda: taken.intake.counts['poses_received'] == 50)
    assert taken.logs.of('warning') == []
    node.destroy_publisher(publisher)


@pytest.fixture(params=['tf2_msgs', 'twin'])
def wire(request, monkeypatch):
    """What makes a message of one transform, and its type: the real one, or what stands for it."""
    if request.param == 'tf2_msgs':
        messages = pytest.importorskip(
            'tf2_msgs.msg', reason='tf2_msgs is not installed (no wheel has it): the twin runs'
        )
        yield lambda one: messages.TFMessage(transforms=[one]), messages.TFMessage
    else:
        with tf2_msgs_twin(monkeypatch):
            yield lambda one: one, TransformStamped


@pytest.mark.parametrize('source', ['tf', 'odom'])
def test_transforms_on_the_wire(node, wire, source):
    """The messages themselves: a latched static publisher and a moving one are heard."""
    make, kind = wire

    def message(parent, child, time_s, x):
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id = parent
        one.header.stamp.sec = time_s
        one.transform.translation.x = x
        return make(one)

    static = node.create_publisher(kind, '/tf_static', qos.TF_STATIC)
    static.publish(message('base_link', 'laser', 0, 0.5))
    best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    moving = node.create_publisher(kind, '/tf', 100 if source == 'tf' else best_effort)
    taken = Bench(node, pose_source=source, transform_timeout=5.0)
    taken.intake.subscribe()
    node.until(lambda: 'laser' in taken.intake.transforms.tree.frames())
    node.until(lambda: moving.get_subscription_count() > 0)
    taken.intake.adapt()
    moving.publish(message('map', 'base_link', 1, 1.0))
    taken.intake.on_scan(scan(1.0))
    if source == 'odom':
        taken.intake.on_pose(odometry(1.0, x=1.0))
    node.until(lambda: len(taken.used) == 1)
    assert taken.where == [approx((1.5, 0.0, 0.0))]
    for publisher in (static, moving):
        node.destroy_publisher(publisher)


def test_one_of_several_robots_listens_to_its_own_transforms(monkeypatch):
    """As `docs/your_robot.md` has it: -r /tf:=tf -r /tf_static:=tf_static -r __ns:=/tb1."""
    rules = ['/tf:=tf', '/tf_static:=tf_static', '__ns:=/tb1']
    words = ['--ros-args', *(word for rule in rules for word in ('-r', rule))]
    with tf2_msgs_twin(monkeypatch), local_node(cli_args=words) as robot:
        Bench(robot, pose_source='tf').intake.subscribe()
        heard = {one.topic_name for one in robot.subscriptions}
        assert heard >= {'/tb1/tf', '/tb1/tf_static', '/tb1/scan'}
        assert not heard & {'/tf', '/tf_static', '/scan'}


def test_clocks_that_stand_still_are_told_of(tf_bench, monkeypatch):
    """Scans, transforms of the robot and of where its sensor sits."""
    clock = SimpleNamespace(now_s=100.0)
    patched = SimpleNamespace(monotonic=lambda: clock.now_s)
    monkeypatch.setattr('ogm_mcmc.ros.scan_intake.time', patched)
    taken = tf_bench(pose_source='tf', transform_timeout=1.0)
    for k in range(30):
        clock.now_s += 0.1
        stamp_s = 5.0 + 0.1 * k
        taken.tf(('map', 'odom', 5.0), ('odom', 'base_link', stamp_s, stamp_s))
        taken.tf(('base_link', 'rear', 5.0))
        taken.scan(5.0, (1.0 + 0.1 * k,), 'base_link')
        taken.scan(stamp_s, (1.0 + 0.1 * k,), 'rear')
    clock.now_s += 5.0
    taken.intake.pass_on()
    assert [one.scan.frame_id for one in taken.used] == ['base_link', 'rear']
    assert taken.problems == {'scan_unstamped': 29, 'tf_unstamped': 19, 'pose_timeout': 29}
    assert any(
        'transform map -> odom holds at 5.000 s only' in said for said in taken.logs.of('warning')
    )


def test_a_scan_that_waited_for_its_mount_says_so(tf_bench, monkeypatch):
    clock = SimpleNamespace(now_s=100.0)
    patched = SimpleNamespace(monotonic=lambda: clock.now_s)
    monkeypatch.setattr('ogm_mcmc.ros.scan_intake.time', patched)
    taken = tf_bench(mount_source='tf', transform_timeout=1.0)
    taken.tf(('base_link', 'laser', 1.0))
    taken.intake.on_pose(pose(2.0))
    taken.scan(2.0)
    clock.now_s += 5.0
    taken.intake.pass_on()
    assert taken.problems == {'scan_no_mount': 1}
    assert 'stamp 2.000 s is later than all of base_link -> laser' in taken.logs.of('warning')[-1]
