"""`replay` of recordings whose poses cannot be sent as they are."""

import json
import re

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import LaserScan
from support.ros import NodeProcess, Observer
from support.transforms import transform

from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import messages
from ogm_mcmc.io.ros_types import odometry

pytestmark = [pytest.mark.ros]

SECOND = 1_000_000_000
STAMPS = [20 * SECOND + k * SECOND // 10 for k in range(6)]


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


@pytest.mark.parametrize('source', ['tf', 'odom'])
def test_a_sensor_that_moves_on_the_robot_is_where_it_was(write_bag, make_scan, source):
    """A robot that stands, its laser turned further with each scan."""
    held = []
    for k, stamp in enumerate(STAMPS):
        held.append(('/tf', stamp, transform(stamp, 'odom', 'base_link', 0.0, 1.0, 0.0)))
        held.append(
            ('/tf', stamp, transform(stamp, 'base_link', 'laser', 0.2, 0.0, 0.5 + 0.3 * k))
        )
        held.append(('/odom', stamp, odometry(stamp, Pose2D(0.0, 1.0), 0.0, 0.0)))
        held.append(('/scan', stamp, make_scan(stamp)))
    poses, done, output = replayed(write_bag(held), '--pose-source', source)
    assert done['published']['pose'] == len(STAMPS)
    assert 'laser moves on the robot: poses are those that put it where it was' in output
    (told,) = re.findall(r"mount.frames:='laser 0.2 0 ([0-9.]+)'", output)
    for k, pose in enumerate(poses):
        sensor = messages.read_pose(pose).moved(Pose2D(0.2, 0.0, float(told))).mean
        assert (sensor.x_m, sensor.y_m) == pytest.approx((0.2, 1.0), abs=1e-6)
        assert sensor.yaw_rad == pytest.approx(0.5 + 0.3 * k, abs=1e-5)


def test_poses_of_a_file(write_bag, records, tmp_path):
    path = tmp_path / 'poses.tum'
    path.write_text('20.0 1 2 0 0 0 0 1\n21.0 1 3 0 0 0 0 1\n')
    poses, done, _ = replayed(write_bag(records), '--trajectory', path, '--topics', 'scan')
    assert done['published'] == {'pose': 6, '/scan': 6}
    assert poses[0].pose.pose.position.y == pytest.approx(2.05)
