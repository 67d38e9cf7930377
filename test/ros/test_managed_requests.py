"""What a peer may ask a running node for, and the states it asks it into."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from support.local_ros import Logs, spun_node
from support.ros import NodeProcess, Observer

from ogm_mcmc.ros.online_mapper import OnlineMapper
from ogm_mcmc.ros.qos import LATCHED, POSES
from ogm_mcmc.ros.refine_server import RefineServer

pytestmark = [pytest.mark.ros]


AFTER = {
    Transition.TRANSITION_CONFIGURE: 'inactive',
    Transition.TRANSITION_ACTIVATE: 'active',
    Transition.TRANSITION_DEACTIVATE: 'inactive',
    Transition.TRANSITION_CLEANUP: 'unconfigured',
    Transition.TRANSITION_ACTIVE_SHUTDOWN: 'finalized',
}


class User:
    """Somebody who drives a robot with one node, and asks it for things."""

    def __init__(self, observer, name):
        self.observer, self.name = observer, name
        self.scans = observer.node.create_publisher(LaserScan, 'scan', 10)
        self.poses = observer.node.create_publisher(PoseWithCovarianceStamped, 'pose', POSES)
        self.reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        self.stamp = 1
        self.sent = 0  # scans, since the node knew of none

    def change(self, transition):
        """Ask for a transition; an answer may get lost, then it is asked for again."""
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = self.observer.call(ChangeState, f'{self.name}/change_state', request)
        return answer.success or self.state() == AFTER[transition]

    def state(self):
        answer = self.observer.call(GetState, f'{self.name}/get_state', GetState.Request())
        return answer.current_state.label

    def call(self, service, kind=Trigger):
        return self.observer.call(kind, f'{self.name}/{service}', kind.Request())

    def set(self, **values):
        parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
        request = SetParameters.Request(parameters=parameters)
        return self.observer.call(SetParameters, f'{self.name}/set_parameters', request).results[0]

    def drive(self, scans, key='scans used'):
        """Send scans with their poses until a report says that so many of those sent were used.

        The first ones may be lost while both sides find each other.
        """
        subscribed = self.scans.get_subscription_count
        both = lambda: subscribed() > 0 < self.poses.get_subscription_count()
        self.observer.until(both, 200.0)  # kernels may have to be compiled
        for _ in range(600):
            if self.used(key) in range(scans, self.sent + 1):
                return
            self.stamp += 1
            self.sent += 1
            pose, scan = PoseWithCovarianceStamped(), LaserScan()
            for header in (pose.header, scan.header):
                header.stamp.sec = self.stamp
            pose.header.frame_id, scan.header.frame_id = 'map', 'base_link'
            pose.pose.pose.orientation.w = 1.0
            scan.angle_increment, scan.angle_max = 0.1, 0.4
            scan.range_max = 5.0
            scan.ranges = [2.0] * 5
            self.poses.publish(pose)
            self.scans.publish(scan)
            self.observer.spin_while(lambda: True, 0.1)
        raise AssertionError(f'too few: {self.values() if self.reports else "silent"}')

    def used(self, key='scans used'):
        """Return what the last report counts."""
        return int(self.values().get(key, '0')) if self.reports else 0

    def values(self):
        return {item.key: item.value for item in self.reports[-1].status[0].values}


@pytest.fixture
def user():
    with Observer() as observer:
        yield User(observer, 'online_mapper')


def test_a_lifecycle_manager_takes_the_node_through_its_states(user, tmp_path):
    """As Nav2's does at bring-up, pause, resume and reset."""
    parameters = {'autostart': False, 'map_update_interval': 0.1, 'save_directory': tmp_path}
    with NodeProcess('online_mapper', parameters=parameters) as node:
        assert user.state() == 'unconfigured'
        maps = user.observer.collect(OccupancyGrid, 'map', LATCHED)
        assert user.set(map_update_interval=0.05).successful
        assert not user.change(Transition.TRANSITION_ACTIVATE)  # nothing is configured yet
        assert user.change(Transition.TRANSITION_CONFIGURE)
        assert user.state() == 'inactive'
        assert not user.call('save_map').success
        assert user.scans.get_subscription_count() == 0
        assert user.change(Transition.TRANSITION_ACTIVATE)
        user.drive(3)
        user.observer.until(lambda: bool(maps))

        assert user.change(Transition.TRANSITION_DEACTIVATE)
        user.observer.until(lambda: user.scans.get_subscription_count() == 0)
        assert user.call('save_map').success  # what was mapped stays
        assert user.change(Transition.TRANSITION_ACTIVATE)
        user.drive(user.used() + 2)

        assert user.change(Transition.TRANSITION_DEACTIVATE)
        assert user.change(Transition.TRANSITION_CLEANUP)
        assert user.change(Transition.TRANSITION_CONFIGURE)
        assert user.change(Transition.TRANSITION_ACTIVATE)
        user.sent = 0
        user.drive(1)
        assert user.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
        assert user.state() == 'finalized'
        assert node.stop() == 0, node.output
        user.observer.lets_go_of('online_mapper')
    assert 'Traceback' not in node.output, node.output


def test_the_refiner_has_the_same_states():
    with Observer() as observer, spun_node(RefineServer, autostart=False):
        user = User(observer, 'refine_server')
        assert user.change(Transition.TRANSITION_CONFIGURE)
        assert user.change(Transition.TRANSITION_ACTIVATE)
        user.drive(2, 'scans recorded')
        assert user.change(Transition.TRANSITION_DEACTIVATE)
        refused = user.call('refine')
        assert not refused.success
        assert 'not active' in refused.message
        assert user.change(Transition.TRANSITION_CLEANUP)
        assert user.state() == 'unconfigured'


def test_what_cannot_be_configured_is_said_and_may_be_mended(user):
    """A managed node answers with a failure and stays; a plain one ends, see two_processes."""
    parameters = {'autostart': False, 'pose_source': 'tf'}
    pytest.importorskip('rclpy')
    try:
        import tf2_msgs  # noqa: F401
    except ImportError:
        pass
    else:
        pytest.skip('tf is installed here')
    with spun_node(OnlineMapper, **parameters) as node:
        logs = Logs(node)
        assert not user.change(Transition.TRANSITION_CONFIGURE)
        assert user.state() == 'unconfigured'
    assert logs.of('error')[0].startswith('not configured: ')


def test_dumped_parameters_can_be_loaded(user):
    """An equal value is no change, even of a fixed parameter; those are read-only."""
    with spun_node(OnlineMapper):
        names = user.call('list_parameters', ListParameters).result.names
        request = GetParameters.Request(names=names)
        values = user.observer.call(GetParameters, 'online_mapper/get_parameters', request).values
        request = SetParameters.Request()
        for name, value in zip(names, values, strict=True):
            message = Parameter(name, value=None).to_parameter_msg()
            message.value = value
            request.parameters.append(message)
        loaded = user.observer.call(SetParameters, 'online_mapper/set_parameters', request)
        assert all(result.successful for result in loaded.results), loaded.results
        at_once = SetParametersAtomically.Request(parameters=request.parameters)
        service = 'online_mapper/set_parameters_atomically'
        assert user.observer.call(SetParametersAtomically, service, at_once).result.successful

        refused = user.set(resolution=0.1)
        assert not refused.successful
        assert 'resolution is fixed at start' in refused.reason
        request = DescribeParameters.Request(names=['resolution', 'map_update_interval'])
        described = user.observer.call(
            DescribeParameters, 'online_mapper/describe_parameters', request
        ).descriptors
        assert [one.read_only for one in described] == [True, False]


def test_a_peer_cannot_write_outside_of_the_folder(user, tmp_path):
    """Neither by parameters nor by links that are in it; the answer says what was written."""
    outside = tmp_path / 'outside'
    outside.write_text('mine')
    folder = tmp_path / 'maps'
    folder.mkdir()
    for suffix in ('pgm', 'yaml', 'png'):
        (folder / f'map.{suffix}').symlink_to(outside)
    with spun_node(OnlineMapper, save_directory=str(folder), map_update_interval=0.1):
        user.drive(1)
        assert not user.set(save_directory=str(tmp_path)).successful
        for name in ('../map', '/tmp/map', 'a/b', '', '..', '.hidden', 'a\\b', 'a\nb', 'x' * 300):
            answer = user.set(save_name=name)
            assert not answer.successful, name
            assert 'expected a file name without folders' in answer.reason
        saved = user.call('save_map')
        assert saved.success, saved.message
        assert saved.message.startswith(f'{folder / "map.yaml"}: ')
        assert outside.read_text() == 'mine'
        assert not any(path.is_symlink() for path in folder.iterdir())
        assert user.set(save_name='floor').successful
        assert user.call('save_map').message.startswith(f'{folder / "floor.yaml"}: ')


def test_get_map_answers_with_the_map_as_it_is_now(user):
    with spun_node(OnlineMapper, map_update_interval=1000.0):
        empty = user.call('get_map', GetMap).map
        assert (empty.header.frame_id, empty.info.width) == ('map', 0)
        user.drive(1)
        got = user.call('get_map', GetMap).map
        assert set(np.unique(got.data)) == {-1, 0, 100}
        assert got.info.width * got.info.height == len(got.data)
