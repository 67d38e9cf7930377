"""Where sensors sit, for scans as they come in."""

import math

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import TransformStamped
from support.local_ros import pose

from ogm_mcmc.config import MountConfig, PlacingConfig
from ogm_mcmc.geometry import Pose2D, SensorMount
from ogm_mcmc.io.tf_messages import fill_transform

pytestmark = [pytest.mark.ros]

approx = pytest.approx


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


def test_of_a_sensor_in_the_frame_of_the_base_there_is_nothing_to_tell(tf_bench):
    taken = tf_bench()
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0, frame='base_link')
    assert len(taken.used) == 1
    assert taken.logs.of('info', 'warning') == []
