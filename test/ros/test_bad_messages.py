"""Rubbish on the topics: a warning, a counter in /diagnostics, never a wrong cell."""

import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan
from support.local_ros import Logs, local_node

from ogm_mcmc.ros.online_mapper import OnlineMapper

pytestmark = [pytest.mark.ros]


class Bench:
    """A mapper in this process: messages are handed over directly."""

    def __init__(self, node):
        self.node = node
        self.reports = []
        node.diagnostics.publisher = self
        self.counts = node.intake.counts

    def publish(self, report):
        self.reports.append(report)

    def send(self, topic, msg):
        (self.node.intake.on_scan if topic == 'scan' else self.node.intake.on_pose)(msg)

    def values(self):
        self.node.publish_diagnostics()
        return {item.key: item.value for item in self.reports[-1].status[0].values}

    def wait_for(self, key, value):
        self.node.until(lambda: self.values().get(key) == str(value), 30.0)

    def map(self):
        return self.node.pipeline.map()

    @property
    def is_empty(self):
        return self.node.pipeline.scans_used == 0

    def expect_occupied(self, points):
        assert self.occupied_points() == points

    def occupied_points(self):
        grid = self.map()
        rows, columns = np.nonzero(grid.probability > 0.5)
        x = grid.spec.origin_x_m + (columns + 0.5) * grid.spec.resolution_m
        y = grid.spec.origin_y_m + (rows + 0.5) * grid.spec.resolution_m
        return sorted(zip(x.round(3).tolist(), y.round(3).tolist(), strict=True))


@pytest.fixture
def bench(request):
    values = {'resolution': 0.1, **getattr(request, 'param', {})}
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    with local_node(OnlineMapper, parameter_overrides=overrides) as node:
        yield Bench(node)


def scan_at(time_s, ranges=(1.0,), **changes):
    """A scan with one beam ahead by default, or several at 90 degrees."""
    msg = LaserScan(range_min=0.05, range_max=5.0, angle_increment=math.pi / 2)
    msg.header.frame_id = 'laser'
    msg.header.stamp.sec, nanosec = divmod(round(time_s * 1e9), 10**9)
    msg.header.stamp.nanosec = nanosec
    msg.ranges = list(map(float, ranges))
    msg.angle_max = msg.angle_increment * (len(ranges) - 1)
    for name, value in changes.items():
        if name == 'frame_id':
            msg.header.frame_id = value
        else:
            setattr(msg, name, value)
    return msg


def pose_at(time_s, x=0.05, y=0.05, yaw=0.0, frame_id='map'):
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(round(time_s * 1e9), 10**9)
    fill(msg.pose.pose, x, y, yaw)
    return msg


def fill(pose, x, y, yaw):
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)


def test_one_good_scan_marks_one_cell(bench):
    bench.send('pose', pose_at(1.0))
    bench.send('scan', scan_at(1.0))
    bench.wait_for('scans used', 1)
    bench.expect_occupied([(1.05, 0.05)])
    values = bench.map().probability
    assert (values.round(3) == 0.2).sum() == 10
    assert (values.round(3) == 0.8).sum() == 1


def test_pose_is_interpolated_the_short_way_round(bench):
    bench.send('pose', pose_at(1.0, yaw=math.pi - 0.1))
    bench.send('scan', scan_at(1.5))
    bench.send('pose', pose_at(2.0, yaw=-math.pi + 0.1))
    bench.wait_for('scans used', 1)
    bench.expect_occupied([(-0.95, 0.05)])


FOUR = [1.0] * 4
SCAN_FAULTS = {
    'no beams': {'ranges': []},
    'angle_increment 0': {'ranges': FOUR, 'angle_increment': 0.0},
    'wrong sign': {'ranges': FOUR, 'angle_increment': -math.pi / 2},
    'too many ranges': {'ranges': [1.0] * 9, 'angle_max': 3 * math.pi / 2},
    'nan angle': {'angle_min': math.nan},
    'range_max below range_min': {'range_max': 0.01},
    'nan range_max': {'range_max': math.nan},
}


def test_invalid_scans_are_counted_and_change_nothing(bench):
    bench.send('pose', pose_at(0.9))
    bench.send('pose', pose_at(2.5))
    for index, changes in enumerate(SCAN_FAULTS.values()):
        bench.send('scan', scan_at(1.0 + 0.1 * index, **changes))
    bench.wait_for('dropped: scan_invalid', len(SCAN_FAULTS))
    assert bench.values()['scans used'] == '0'
    assert bench.is_empty
    # And the node is as well as before.
    bench.send('scan', scan_at(2.2))
    bench.wait_for('scans used', 1)


@pytest.mark.parametrize('bench', [{'method': 'pose_uncertain'}], indirect=True)
def test_invalid_poses_are_counted_and_change_nothing(bench):
    nan = pose_at(1.0, x=math.nan)
    zero = pose_at(1.1)
    zero.pose.pose.orientation.w = 0.0
    tilted = pose_at(1.2)
    tilted.pose.pose.orientation.x, tilted.pose.pose.orientation.w = math.sin(0.4), math.cos(0.4)
    negative = pose_at(1.3)
    negative.pose.covariance[0] = -1.0
    inconsistent = pose_at(1.4)
    inconsistent.pose.covariance[0] = inconsistent.pose.covariance[7] = 1.0
    inconsistent.pose.covariance[1] = inconsistent.pose.covariance[6] = 2.0
    for msg in (nan, zero, tilted, negative, inconsistent):
        bench.send('pose', msg)
    bench.send('pose', pose_at(1.5, frame_id='odom'))
    bench.wait_for('dropped: pose_invalid', 5)
    bench.wait_for('dropped: pose_wrong_frame', 1)
    bench.send('scan', scan_at(1.2))
    bench.wait_for('dropped: pose_timeout', 1)
    assert bench.is_empty


def test_stamps_out_of_order_repeated_and_jumping_back(bench):
    for time_s in (9.0, 10.0, 11.0):
        bench.send('pose', pose_at(time_s))
    bench.send('scan', scan_at(10.0))
    bench.wait_for('scans used', 1)
    bench.send('scan', scan_at(10.0))  # repeated
    bench.send('scan', scan_at(9.9))  # late
    bench.wait_for('dropped: scan_out_of_order', 2)
    bench.send('scan', scan_at(3.0))  # time starts again
    bench.wait_for('dropped: scan_jumped_back', 1)
    bench.send('pose', pose_at(2.9, yaw=math.pi / 2))
    bench.send('pose', pose_at(4.0, yaw=math.pi / 2))
    bench.send('scan', scan_at(3.5, [0.5]))
    bench.wait_for('scans used', 2)
    bench.send('scan', scan_at(30.0))  # no pose so late: waits, then is dropped
    bench.wait_for('dropped: pose_timeout', 1)
    bench.send('pose', pose_at(40.0))
    bench.send('scan', scan_at(35.0))  # between poses that are too far apart
    bench.wait_for('dropped: pose_gap', 1)
    bench.send('pose', pose_at(20.0))
    bench.wait_for('dropped: pose_jumped_back', 1)
    assert bench.values()['scans used'] == '2'
    bench.expect_occupied([(0.05, 0.55), (1.05, 0.05)])


@pytest.mark.parametrize('bench', [{'sensor_frame': 'laser'}], indirect=True)
def test_scans_of_another_frame_are_refused(bench):
    bench.send('pose', pose_at(1.0))
    bench.send('scan', scan_at(1.0, frame_id='camera'))
    bench.wait_for('dropped: scan_wrong_frame', 1)
    assert bench.is_empty


@pytest.mark.parametrize('bench', [{'max_cells': 10_000}], indirect=True)
def test_a_pose_far_away_does_not_blow_up_the_map(bench):
    bench.send('pose', pose_at(1.0))
    bench.send('scan', scan_at(1.0))
    bench.wait_for('scans used', 1)
    bench.send('pose', pose_at(1.1, x=1e6))
    bench.send('scan', scan_at(1.1))
    bench.send('pose', pose_at(1.2, x=1e6))  # no stray one
    bench.wait_for('dropped: scan_off_map', 1)
    bench.send('pose', pose_at(1.3, x=1e300))
    bench.wait_for('dropped: pose_invalid', 1)
    bench.expect_occupied([(1.05, 0.05)])


@pytest.mark.parametrize(
    ('bench', 'expected'),
    [
        ({'mount.x': 0.5, 'mount.yaw': math.pi / 2}, [(0.55, 1.05), (-1.45, 0.05)]),
        ({'mount.upside_down': True}, [(1.05, 0.05), (0.05, -1.95)]),
    ],
    indirect=['bench'],
)
def test_mounts(bench, expected):
    """A beam of 1 m ahead and one of 2 m to the left of the sensor."""
    bench.send('pose', pose_at(1.0))
    bench.send('scan', scan_at(1.0, [1.0, 2.0]))
    bench.wait_for('scans used', 1)
    bench.expect_occupied(sorted(expected))


@pytest.mark.parametrize('bench', [{'pose_source': 'particles'}], indirect=True)
def test_particles_count_as_their_mean(bench):
    cloud = PoseArray()
    cloud.header.frame_id = 'map'
    cloud.header.stamp.sec = 1
    for x, yaw in ((0.0, 3.0), (0.1, -3.0)):
        cloud.poses.append(Pose())
        fill(cloud.poses[-1], x, 0.05, yaw)
    empty = PoseArray()
    empty.header.frame_id = 'map'
    bench.send('particles', empty)
    bench.wait_for('dropped: pose_invalid', 1)
    bench.send('particles', cloud)
    bench.send('scan', scan_at(1.0))
    bench.wait_for('scans used', 1)
    bench.expect_occupied([(-0.95, 0.05)])


@pytest.mark.parametrize(
    'bench',
    [{'method': 'pose_uncertain', 'pose_source': 'particles', 'pose_uncertain.max_particles': 10}],
    indirect=True,
)
def test_large_clouds_are_bounded_and_that_is_said_once(bench):
    logs = Logs(bench.node)
    for time_s in (1.0, 2.0):
        cloud = PoseArray()
        cloud.header.frame_id, cloud.header.stamp.sec = 'map', int(time_s)
        for k in range(50):
            cloud.poses.append(Pose())
            fill(cloud.poses[-1], 0.01 * k, 0.05, 0.0)
        bench.send('particles', cloud)
        bench.send('scan', scan_at(time_s))
    bench.wait_for('scans used', 2)
    assert len([line for line in logs.of('warning') if 'more than 10 particles' in line]) == 1
