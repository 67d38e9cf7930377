"""Methods in the node: sonars, particle clouds, and settings that change while it runs."""

import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import LaserScan, Range
from std_srvs.srv import Trigger
from support.local_ros import spun_node
from support.ros import Observer

from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.geometry import CellBox
from ogm_mcmc.ros.online_mapper import OnlineMapper
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.simulation import SonarRing

pytestmark = [pytest.mark.ros]

TYPES = {
    'scan': LaserScan,
    'range': Range,
    'pose': PoseWithCovarianceStamped,
    'particles': PoseArray,
}


class Feed:
    """Publishers for the topics a node listens to, and what it says."""

    def __init__(self, observer, topics):
        self.observer = observer
        self.maps = observer.collect(OccupancyGrid, 'map_probability', LATCHED)
        self.reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        self.publishers = {t: observer.node.create_publisher(TYPES[t], t, 50) for t in topics}
        waiting = self.publishers.values()
        observer.until(
            lambda: bool(self.reports) and all(p.get_subscription_count() for p in waiting)
        )

    def send(self, topic, msg, time_s, frame):
        msg.header.frame_id = frame
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(round(time_s * 1e9), 10**9)
        self.publishers[topic].publish(msg)

    def pose(self, time_s, x=0.05, y=0.05, yaw=0.0):
        msg = PoseWithCovarianceStamped()
        place(msg.pose.pose, x, y, yaw)
        self.send('pose', msg, time_s, 'map')

    def scan(self, time_s, *ranges):
        msg = LaserScan(range_max=5.0, angle_increment=0.001, angle_max=0.001 * (len(ranges) - 1))
        msg.ranges = list(map(float, ranges))
        self.send('scan', msg, time_s, 'laser')

    def wait_for_scans(self, count):
        def used():
            return {v.key: v.value for v in self.reports[-1].status[0].values}['scans used']

        self.observer.until(lambda: used() == str(count))

    def value_at(self, x, y):
        msg = self.maps[-1]
        values = np.frombuffer(msg.data, np.int8).reshape(msg.info.height, msg.info.width)
        column = math.floor((x - msg.info.origin.position.x) / msg.info.resolution)
        row = math.floor((y - msg.info.origin.position.y) / msg.info.resolution)
        if not (0 <= column < msg.info.width and 0 <= row < msg.info.height):
            return -1
        return int(values[row, column])

    def expect(self, expected):
        """Wait for a map with these values at these points; on a timeout show the others."""

        def found():
            return {point: self.value_at(*point) for point in expected}

        try:
            self.observer.until(lambda: bool(self.maps) and found() == expected, 30.0)
        except TimeoutError:
            assert found() == expected

    def set(self, name, value):
        kinds = {
            float: (ParameterType.PARAMETER_DOUBLE, 'double_value'),
            int: (ParameterType.PARAMETER_INTEGER, 'integer_value'),
            str: (ParameterType.PARAMETER_STRING, 'string_value'),
        }
        kind, field = kinds[type(value)]
        request = SetParameters.Request(
            parameters=[Parameter(name=name, value=ParameterValue(type=kind, **{field: value}))]
        )
        name = 'online_mapper/set_parameters'
        return self.observer.call(SetParameters, name, request).results[0]


def place(pose, x, y, yaw):
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)


def node(**parameters):
    fixed = {'map_update_interval': 0.1, 'resolution': 0.1}
    return spun_node(OnlineMapper, **{**fixed, **parameters})


def test_sonars_each_on_its_mount():
    """Four sonars around a robot in a corridor 2 m wide: walls left and right, nothing ahead."""
    mounts = SonarRing(sonars=4, radius_m=0.2).mounts_setting()
    with node(method='sonar', **{'mount.frames': mounts}), Observer() as observer:
        feed = Feed(observer, ('range', 'pose'))
        for k in range(5):
            feed.pose(1.0 + k)
            for sonar, reading in enumerate((math.inf, 0.75, math.inf, 0.85)):
                msg = Range(field_of_view=0.3, min_range=0.05, max_range=3.0, range=reading)
                feed.send('range', msg, 1.0 + k, f'sonar_{sonar}')
        feed.wait_for_scans(20)
        observer.until(lambda: bool(feed.maps) and feed.value_at(0.05, 1.05) > 90)
        assert feed.value_at(0.05, -0.95) > 90
        assert feed.value_at(0.05, 0.65) < 10
        assert 0 <= feed.value_at(2.5, 0.05) < 50
        assert feed.value_at(0.05, 2.0) == -1


def test_particles_are_averaged():
    """Three of four particles see the wall at 1.05 m, one at 1.35 m; no cell knows it."""
    chosen = {'method': 'pose_uncertain', 'pose_source': 'particles', 'step.l_occ': 2.0}
    with node(**chosen, **{'step.l_free': -1.0}), Observer() as observer:
        feed = Feed(observer, ('scan', 'particles'))
        cloud = PoseArray(poses=[Pose() for _ in range(4)])
        for pose, x in zip(cloud.poses, (0.05, 0.05, 0.05, 0.35), strict=True):
            place(pose, x, 0.05, 0.0)
        feed.send('particles', cloud, 1.0, 'map')
        feed.scan(1.0, 1.0)
        percent = {
            log_odds: round(100 / (1 + math.exp(-log_odds))) for log_odds in (1.25, 0.5, -0.25)
        }
        # 3/4 of a hit and 1/4 of a miss; 1/4 of a hit; 1/4 of a miss.
        feed.expect({(1.05, 0.05): percent[1.25], (1.35, 0.05): percent[0.5]})
        feed.expect({(1.15, 0.05): percent[-0.25], (1.45, 0.05): -1})


def test_safe_settings_take_effect_and_others_are_refused():
    """On a counting map: what is shown changes at once, the cell size never."""
    with node(method='counting', fusion='per_beam'), Observer() as observer:
        feed = Feed(observer, ('scan', 'pose'))
        feed.pose(1.0)
        feed.scan(1.0, 1.0, 1.0, 1.0, 2.0, 2.0)
        feed.expect({(1.05, 0.05): 60, (2.05, 0.05): 100, (0.55, 0.05): 0})
        assert feed.set('counting.show', 'ml').successful
        feed.expect({(1.05, 0.05): 100})
        assert feed.set('counting.show', 'reflection').successful
        # From now on a scan counts once: 4 hits, 2 misses.
        assert feed.set('fusion', 'per_scan').successful
        assert feed.set('max_range', 3.0).successful
        feed.pose(2.0)
        feed.scan(2.0, 1.0, 2.0)
        feed.expect({(1.05, 0.05): 67})
        for name, value in (('resolution', 0.2), ('method', 'sonar'), ('prior', 0.3)):
            refused = feed.set(name, value)
            assert not refused.successful
            assert f'{name} is fixed at start: what was mapped' in refused.reason
        refused = feed.set('step.l_occ', -1.0)
        assert not refused.successful


def test_an_adaptive_map_is_shown_and_saved_with_its_tree(tmp_path):
    chosen = {'method': 'adaptive', 'save_directory': str(tmp_path), 'save_name': 'floor'}
    with node(**chosen, **{'adaptive.coarsest_level': 3}), Observer() as observer:
        feed = Feed(observer, ('scan', 'pose'))
        for k in range(10):
            feed.pose(1.0 + k)
            feed.scan(1.0 + k, *[2.0] * 5)
        feed.expect({(2.05, 0.05): 100, (1.65, 0.05): 0, (0.05, 0.75): 0, (0.05, 0.85): -1})
        saved = observer.call(Trigger, 'online_mapper/save_map', Trigger.Request())
        assert saved.success, saved.message
        method = load_tree(tmp_path / 'floor_tree.npz')
        assert method.config.adaptive.coarsest_level == 3
        assert method.probabilities(CellBox(20, 0, 21, 1))[0, 0] > 0.99


def test_a_place_that_cannot_be_saved_to_is_answered():
    """The node goes on: the answer says in a line what is wrong with the path."""
    with node(save_directory='~nosuchuser/maps'), Observer() as observer:
        feed = Feed(observer, ('scan', 'pose'))
        for k in range(10):
            feed.pose(1.0 + k)
            feed.scan(1.0 + k, *[2.0] * 5)
        feed.expect({(2.05, 0.05): 100})
        for _ in range(2):
            saved = observer.call(Trigger, 'online_mapper/save_map', Trigger.Request())
            assert not saved.success
            assert saved.message.startswith("save_directory is '~nosuchuser/maps': ")


def test_a_random_field_shows_what_lies_beside_a_beam():
    with node(method='random_field'), Observer() as observer:
        feed = Feed(observer, ('scan', 'pose'))
        feed.pose(1.0)
        feed.scan(1.0, 2.0)
        observer.until(lambda: bool(feed.maps) and feed.value_at(2.05, 0.05) > 50)
        assert 0 <= feed.value_at(1.05, 0.15) < 50
        assert feed.value_at(1.05, 0.35) == -1
