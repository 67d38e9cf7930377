"""Rubbish on the topics: a warning, a counter in /diagnostics, never a wrong cell."""

import math
from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan
from support.ros import NodeProcess, Observer

from ogm_mcmc.ros.qos import LATCHED

pytestmark = [pytest.mark.ros]


class Bench(NamedTuple):
    """A mapper in its own process, and everything a test needs to feed and watch it."""

    observer: Observer
    node: NodeProcess
    maps: list
    reports: list
    publishers: dict

    def send(self, topic, msg):
        self.publishers[topic].publish(msg)

    def values(self):
        return {item.key: item.value for item in self.reports[-1].status[0].values}

    def wait_for(self, key, value):
        self.observer.until(lambda: bool(self.reports) and self.values().get(key) == str(value))

    def map_values(self):
        msg = self.maps[-1]
        return np.frombuffer(msg.data, np.int8).reshape(msg.info.height, msg.info.width), msg.info

    def expect_occupied(self, points):
        """Wait for the map that shows just these; on a timeout show what it shows instead."""
        try:
            self.observer.until(lambda: bool(self.maps) and self.occupied_points() == points, 5.0)
        except TimeoutError:
            assert self.occupied_points() == points

    def occupied_points(self):
        values, info = self.map_values()
        rows, columns = np.nonzero(values > 50)
        x = info.origin.position.x + (columns + 0.5) * info.resolution
        y = info.origin.position.y + (rows + 0.5) * info.resolution
        return sorted(zip(x.round(3).tolist(), y.round(3).tolist(), strict=True))


@pytest.fixture
def bench(request):
    parameters = {'map_update_interval': 0.1, 'resolution': 0.1, **getattr(request, 'param', {})}
    with NodeProcess('online_mapper', parameters=parameters) as node, Observer() as observer:
        maps = observer.collect(OccupancyGrid, 'map', LATCHED)
        reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        types = {'scan': LaserScan, 'pose': PoseWithCovarianceStamped, 'particles': PoseArray}
        publishers = {
            topic: observer.node.create_publisher(kind, topic, 10) for topic, kind in types.items()
        }
        source = 'particles' if parameters.get('pose_source') == 'particles' else 'pose'
        wanted = (publishers['scan'], publishers[source])
        observer.until(lambda: bool(reports) and all(p.get_subscription_count() for p in wanted))
        yield Bench(observer, node, maps, reports, publishers)
        assert node.stop() == 0, node.output
        assert 'Traceback' not in node.output, node.output


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
    values, _ = bench.map_values()
    assert (values == 20).sum() == 10
    assert (values == 80).sum() == 1


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
    assert bench.maps == []
    # And the node is as well as before.
    bench.send('scan', scan_at(2.2))
    bench.wait_for('scans used', 1)
    assert bench.node.running()


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
    assert bench.maps == []


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
    assert bench.maps == []


@pytest.mark.parametrize('bench', [{'max_cells': 10_000}], indirect=True)
def test_a_pose_far_away_does_not_blow_up_the_map(bench):
    bench.send('pose', pose_at(1.0))
    bench.send('scan', scan_at(1.0))
    bench.wait_for('scans used', 1)
    bench.send('pose', pose_at(1.1, x=1e6))
    bench.send('scan', scan_at(1.1))
    bench.wait_for('dropped: scan_off_map', 1)
    bench.send('pose', pose_at(1.2, x=1e300))
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
