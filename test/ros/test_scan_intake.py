"""What nodes take in: every kind of pose, mounts, several lasers, and what they say about it."""

import importlib.util
import math

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseArray, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from support.local_ros import (
    Logs,
    local_node,
    odometry,
    pose,
    pose_stamped,
    scan,
    tf2_msgs_stand_in,
    tf2_msgs_twin,
    transforms,
)

from ogm_mcmc.config import MountConfig, PlacingConfig
from ogm_mcmc.config.nodes import IntakeConfig
from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.engine import transform_tree
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import Pose2D, SensorMount
from ogm_mcmc.io.tf_messages import fill_transform
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.scan_intake import ScanIntake

pytestmark = [pytest.mark.ros]

approx = pytest.approx


@pytest.fixture(scope='module')
def node():
    with local_node() as local:
        yield local


class Bench:
    """An intake, what it placed, and what it logged."""

    def __init__(self, node, placing=None, **settings):
        self.logs = Logs(node)
        self.used = []
        settings = {'transform_timeout': 0.0, **settings}
        self.intake = ScanIntake(
            node, IntakeConfig(**settings), placing or PlacingConfig(), self.used.append
        )

    def scan(self, time_s, ranges=(1.0,), frame='laser', **fields):
        self.intake.on_scan(scan(time_s, ranges, frame, **fields))

    def tf(self, *entries):
        self.intake.tf.on_tf(transforms(*entries))

    def tf_static(self, *entries):
        self.intake.tf.on_tf_static(transforms(*entries))

    @property
    def where(self):
        """x, y, yaw of the sensor for each scan used."""
        poses = [placed.pose for placed in self.used]
        return [(one.x_m, one.y_m, one.yaw_rad) for one in poses]

    @property
    def problems(self):
        return dict(self.intake.problems.all())


@pytest.fixture
def bench(node):
    return lambda *args, **settings: Bench(node, *args, **settings)


@pytest.fixture
def tf_bench(node, monkeypatch):
    """With the messages of tf, installed or not; they are handed over directly."""
    with tf2_msgs_stand_in(monkeypatch):
        yield lambda *args, **settings: Bench(node, *args, **settings)


# -- where poses come from ------------------------------------------------------------------


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


# -- where sensors sit ----------------------------------------------------------------------


def test_mounts_come_from_tf_by_default_and_are_told(tf_bench):
    taken = tf_bench(pose_source='tf')
    taken.tf_static(('base_link', 'laser', 0, 0.2, 0.0, math.pi))
    taken.tf(('map', 'base_link', 1.0))
    taken.scan(1.0)
    assert taken.where[0][0] == approx(0.2)
    assert abs(taken.where[0][2]) == approx(math.pi)
    (line,) = taken.logs.of('info')
    assert line.startswith('laser on base_link at 0.2 0 m, turned by ')
    assert line.endswith('180 degrees (from tf_static)')


def test_parameters_count_where_they_name_a_place(bench):
    taken = bench(PlacingConfig(mount=MountConfig(x=0.3)))
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0)
    assert taken.where == [approx((0.3, 0.0, 0.0))]
    assert taken.logs.of('info') == [
        'laser on base_link at 0.3 0 m, turned by 0 degrees (from parameters)'
    ]


def test_a_laser_of_which_nothing_is_known_is_a_warning_at_once(bench):
    taken = bench()
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0)
    assert len(taken.used) == 1
    (line,) = taken.logs.of('warning')
    assert line.startswith('sensor frame laser is not base_link, and neither tf nor parameters')


def test_tf_that_is_asked_for_is_waited_for(tf_bench):
    taken = tf_bench(mount_source='tf')
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0)
    assert taken.used == []
    assert taken.problems == {'scan_no_mount': 1}
    (line,) = taken.logs.of('warning')
    assert line.startswith(
        "scan of 'laser' at 1.000 s dropped: nothing says where its sensor sits"
    )
    assert '(base_link -> laser is expected from tf)' in line


def test_a_mount_that_is_asked_for_on_a_topic_is_named_by_it(bench):
    taken = bench(mount_source='topic')
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0)
    assert taken.problems == {'scan_no_mount': 1}
    (line,) = taken.logs.of('warning')
    assert '(base_link -> laser is expected on /mount)' in line
    assert 'tf' not in line


def test_a_corrected_mount_counts_from_then_on(tf_bench):
    taken = tf_bench()
    taken.tf_static(('base_link', 'laser', 0, 0.2))
    for k in range(3):
        taken.intake.on_pose(pose(1.0 + k))
        taken.scan(1.0 + k)
        taken.tf_static(('base_link', 'laser', 1.5, 0.4))
    assert [x for x, _, _ in taken.where] == approx([0.2, 0.4, 0.4])


def test_a_mount_that_moves_is_that_at_each_stamp(tf_bench):
    taken = tf_bench(transform_timeout=1.0)
    taken.intake.on_pose(pose(0.5))
    taken.intake.on_pose(pose(2.5))
    taken.tf(
        ('base_link', 'laser', 1.0, 0.0, 0.0, 0.0), ('base_link', 'laser', 2.0, 0.0, 0.0, 1.0)
    )
    for time_s in (1.25, 1.75, 2.25):
        taken.scan(time_s)
    assert [yaw for _, _, yaw in taken.where] == approx([0.25, 0.75])
    taken.tf(('base_link', 'laser', 2.5))
    assert [yaw for _, _, yaw in taken.where] == approx([0.25, 0.75, 0.5])


def test_lasers_that_move_are_followed_on_a_topic_of_their_own(bench):
    """Two of them, with scans of one stamp; no tf is needed."""
    taken = bench(transform_timeout=1.0, mount_source='topic')
    for k in range(3):
        taken.intake.on_pose(pose(1.0 + k))
        for frame, place in (('front', (0.2, 0.0, 0.5 * k)), ('rear', (-0.1 * k, 0.0, 3.0))):
            taken.scan(1.0 + k, frame=frame)
            message = TransformStamped()
            mount = SensorMount(Pose2D(*place))
            fill_transform(message, 'base_link', frame, mount, (1 + k) * 1_000_000_000)
            taken.intake.mount_topic.take(message)
    found = [placed.pose.yaw_rad for placed in taken.used]
    assert found == approx([0.0, 3.0, 0.5, 3.0, 1.0, 3.0])
    assert [x for x, _, _ in taken.where] == approx([0.2, 0.0, 0.2, -0.1, 0.2, -0.2])
    assert len(taken.logs.of('info')) == 2
    taken.intake.mount_topic.take(TransformStamped())
    assert taken.problems == {'tf_invalid': 1}


def test_several_lasers_on_one_topic_have_a_mount_each(tf_bench):
    taken = tf_bench()
    taken.tf_static(('base_link', 'front', 0, 0.2), ('base_link', 'rear', 0, -0.2, 0.0, 3.0))
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0, frame='front')
    taken.scan(1.0, frame='rear')
    assert taken.where == [approx((0.2, 0.0, 0.0)), approx((-0.2, 0.0, 3.0))]
    assert len(taken.logs.of('info')) == 2


def test_scans_do_not_pile_up_while_a_mount_is_waited_for(tf_bench):
    taken = tf_bench(transform_timeout=100.0, max_waiting_scans=10)
    for k in range(20):
        taken.intake.on_pose(pose(1.0 + 0.1 * k))
        taken.scan(1.0 + 0.1 * k)
    assert len(taken.used) == 20
    assert taken.problems == {}


@pytest.mark.parametrize(('deskew', 'bent'), [('auto', True), ('off', False)])
def test_a_scan_taken_on_the_move_is_bent_if_asked_for(bench, deskew, bent):
    taken = bench(PlacingConfig(deskew=deskew))
    taken.intake.on_pose(pose(1.0))
    taken.intake.on_pose(pose(1.3, yaw=0.3))
    taken.scan(1.0, [1.0, 1.0], time_increment=0.2)
    (placed,) = taken.used
    assert placed.scan.bearings() - [0.0, math.pi / 2] == approx([0.0, 0.2 * bent])


# -- what is said ---------------------------------------------------------------------------


def test_what_is_missing_for_a_pose_is_named(bench):
    taken = bench()
    taken.scan(1.0)
    taken.intake.pass_on()
    assert any(
        'no pose is known; /pose has 0 publishers' in line for line in taken.logs.of('warning')
    )


def test_what_is_missing_in_tf_is_named(tf_bench):
    taken = tf_bench(pose_source='tf')
    taken.tf(('odom', 'base_link', 1.0))
    taken.scan(1.0, frame='base_link')
    taken.intake.pass_on()
    (line,) = taken.logs.of('warning')
    assert "frame 'map' is not there; known: base_link, odom" in line
    assert '/tf has 0 publishers, /tf_static has 0' in line


def test_a_scan_of_which_no_beam_says_anything_is_not_used(bench):
    taken = bench()
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0, [math.nan, 0.01, 9.0, -math.inf])
    assert taken.used == []
    assert taken.problems == {'scan_says_nothing': 1}
    taken.scan(1.0, [math.nan, 1.0, math.inf])
    assert len(taken.used) == 1
    values = taken.intake.values()
    assert (values['beams used'], values['beams ignored']) == (2, 5)


def test_odd_scans_are_remarked_once(bench):
    taken = bench()
    taken.intake.on_pose(pose(1.0))
    taken.intake.on_pose(pose(3.0))
    for k in range(3):
        odd = scan(1.0 + 0.1 * k, [1.0, 2.0, 3.0])
        odd.angle_max = 0.0
        taken.intake.on_scan(odd)
    assert len(taken.used) == 3
    assert len([line for line in taken.logs.of('warning') if 'angles' in line]) == 1


def test_poses_that_come_rarely_are_a_reason_to_use_tf(bench):
    taken = bench()
    for k in range(10):
        taken.intake.on_pose(pose(1.5 * k, x=0.25 * k))
    assert [line for line in taken.logs.of('warning') if 'set pose_source to tf' in line] == [
        'poses come every 1.5 s, and the robot moves 0.25 m between them: scans are placed on the '
        'straight way from one to the next; with a localizer that publishes tf (amcl, '
        'slam_toolbox) set pose_source to tf'
    ]


def test_a_correction_of_the_past_is_a_warning(tf_bench):
    taken = tf_bench(pose_source='tf')
    for time_s, x in ((1.0, 0.0), (1.1, 0.05), (1.2, 0.85)):
        taken.tf(('map', 'odom', time_s, x), ('odom', 'base_link', time_s, 3.0))
    assert taken.problems == {'map_corrected': 1}
    (line,) = taken.logs.of('warning')
    assert line.startswith('map -> odom moved the robot by 0.80 m and 0.0 degrees at once')


def test_of_a_sensor_in_the_frame_of_the_base_there_is_nothing_to_tell(tf_bench):
    taken = tf_bench()
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0, frame='base_link')
    assert len(taken.used) == 1
    assert taken.logs.of('info', 'warning') == []


def test_one_transform_from_the_far_future_does_not_end_the_mapping(tf_bench):
    """The others of its frame are older than it and would be dropped for ever."""
    taken = tf_bench(pose_source='tf')
    taken.tf(('map', 'odom', 2e9))
    for k in range(30):
        time_s = 1.0 + 0.1 * k
        taken.tf(('map', 'odom', time_s), ('odom', 'base_link', time_s))
        taken.scan(time_s, frame='base_link')
    assert len(taken.used) > 15


def test_transforms_that_are_none_are_counted(tf_bench):
    taken = tf_bench()
    taken.tf(('map', 'map', 1.0), ('map', 'odom', 1.0, math.nan), ('odom', 'base_link', 1.0))
    assert taken.problems == {'tf_invalid': 2}


def test_frames_that_somebody_makes_up_do_not_fill_the_memory(tf_bench, monkeypatch):
    monkeypatch.setattr(transform_tree, 'MAX_LIVE_FRAMES', 3)
    taken = tf_bench()
    taken.tf_static(('base_link', 'laser', 0))
    for k in range(10):
        taken.tf(('map', f'thing_{k}', 1.0), ('map', 'base_link', 1.0 + k))
    assert taken.intake.transforms.tree.frames() == ['base_link', 'laser', 'map', 'thing_0']
    assert taken.problems == {'tf_invalid': 9}


def test_tf_that_starts_again_is_followed(tf_bench):
    taken = tf_bench(pose_source='tf')
    for start_s in (1000.0, 1.0):
        for k in range(20):
            taken.tf(('map', 'base_link', start_s + 0.1 * k, 1.0))
            taken.scan(start_s + 0.1 * k, frame='base_link')
    assert len(taken.used) > 25
