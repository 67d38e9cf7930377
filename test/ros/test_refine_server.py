"""replay -> DDS -> refine_server -> map_refined, each in a process of its own."""

import itertools
import math
import re
import signal
import time
from functools import partial

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.simulation import WORLDS, Lidar, record
from ogm_mcmc.testing.ros import NodeProcess, Observer

pytestmark = [pytest.mark.ros]

LIDAR = Lidar(beams=90, range_max_m=8.0)
QUICK = {
    'window.resolution': 0.1,
    'model.sigma': 0.03,
    'map_update_interval': 0.2,
    'niceness': 0,
}
ENDLESS = {'max_time': 1000.0, 'max_sweeps': 10**8, 'r_hat': 0.0}


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    """Every sixth scan of the walk through the office: 193 scans of 90 beams."""
    path = tmp_path_factory.mktemp('walk') / 'bag'
    recording = record(WORLDS['office'](), LIDAR, np.random.default_rng(5))
    write_recording(path, itertools.islice(recording, 0, None, 6))
    return path


SCANS = 193


def server(**parameters):
    dotted = {name.replace('__', '.'): value for name, value in parameters.items()}
    return NodeProcess('refine_server', parameters={**QUICK, **dotted})


class Client:
    """What a user of the server sees: its maps and diagnostics, and its services."""

    def __init__(self, observer):
        self.observer = observer
        self.maps = observer.collect(OccupancyGrid, 'map_refined', LATCHED)
        self.reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        observer.until(lambda: bool(self.reports), 60.0)

    def values(self):
        return {item.key: item.value for item in self.reports[-1].status[0].values}

    def wait_for(self, timeout_s=30.0, **expected):
        """Wait for diagnostics; `scans_recorded` stands for 'scans recorded'."""
        wanted = {key.replace('_', ' '): str(value) for key, value in expected.items()}

        def seen():
            values = self.values()
            return all(values.get(key) == value for key, value in wanted.items())

        try:
            self.observer.until(seen, timeout_s)
        except TimeoutError:
            values = self.values()
            assert {key: values.get(key) for key in wanted} == wanted

    def call(self, name):
        return self.observer.call(Trigger, f'refine_server/{name}', Trigger.Request())

    def replay(self, bag, *extra):
        arguments = [str(bag), '--wait', '20', '--wait-topics', '2', *map(str, extra)]
        with NodeProcess('replay', arguments) as player:
            self.observer.until(lambda: not player.running(), 90.0)
            assert player.wait() == 0, player.output

    def record(self, bag, count=SCANS):
        self.replay(bag, '--rate', 0)
        self.wait_for(scans_recorded=count)

    def refine(self):
        answer = self.call('refine')
        assert answer.success, answer.message
        return answer

    def sweeps(self):
        return int(self.values()['sweeps'])

    def wait_for_map(self, timeout_s=30.0):
        seen = len(self.maps)
        self.observer.until(lambda: len(self.maps) > seen, timeout_s)
        return self.maps[-1]

    def set(self, name, kind, field, value):
        new = ParameterValue(type=kind, **{field: value})
        request = SetParameters.Request(parameters=[Parameter(name=name, value=new)])
        return self.observer.call(SetParameters, 'refine_server/set_parameters', request).results[0]


def as_array(msg):
    return np.frombuffer(msg.data, np.int8).reshape(msg.info.height, msg.info.width)


def distance_to_walls(msg):
    """Distance (height, width) of the middle of every cell to the nearest wall, cells."""
    size, origin = msg.info.resolution, msg.info.origin.position
    x = origin.x + (np.arange(msg.info.width) + 0.5) * size
    y = (origin.y + (np.arange(msg.info.height) + 0.5) * size)[:, None]
    nearest = np.full((msg.info.height, msg.info.width), np.inf)
    for ax, ay, bx, by in WORLDS['office']().walls:
        dx, dy = bx - ax, by - ay
        along = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        away = np.hypot(x - ax - along * dx, y - ay - along * dy)
        nearest = np.minimum(nearest, away)
    return nearest / size


def stop(node, how=signal.SIGINT):
    assert node.stop(how) == 0, node.output
    assert 'Traceback' not in node.output, node.output


def test_from_scans_to_a_map_near_the_truth(walk, tmp_path):
    """All of it once: recording, refining, maps on every way out, files, chains on disk."""
    state = tmp_path / 'state' / 'chains.npz'
    limits = {'max_time': 60.0, 'max_sweeps': 400, 'r_hat': 0.0}
    files = {'save_directory': tmp_path, 'state_file': state}
    with server(**limits, **files) as node, Observer() as observer:
        client = Client(observer)
        entropies = observer.collect(OccupancyGrid, 'refine_server/entropy', LATCHED)
        client.record(walk)
        assert client.maps == []
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', sweeps=400)
        values = client.values()
        assert int(values['rays']) > 16_000
        assert float(values['memory (MB)']) > 1.0
        assert float(values['R-hat (99 % of cells below)']) < 2.0
        assert not any(key.startswith('dropped') for key in values)

        got = observer.call(GetMap, 'refine_server/get_map', GetMap.Request()).map
        observer.until(lambda: client.maps[-1].data == got.data)
        assert got.header.frame_id == 'map'
        assert got.info.resolution == pytest.approx(0.1)
        cells, away = as_array(got), distance_to_walls(got)
        assert (cells >= 90).sum() > 500
        assert (away[cells >= 90] < 1.0).mean() > 0.95
        assert (away[(cells >= 0) & (cells <= 10)] > 0.3).mean() > 0.97
        # Most of what is near a wall of a room is shown as wall, not as unknown.
        assert len(client.maps) > 2  # it was published as it converged

        observer.until(lambda: bool(entropies))
        observer.until(lambda: entropies[-1].info.width == got.info.width)
        doubt = as_array(entropies[-1])
        assert (doubt[cells >= 95] < 40).all()

        saved = client.call('save_map')
        assert saved.message == str(tmp_path / 'map_refined.yaml')
        from_file = load_map(tmp_path / 'map_refined.yaml').probability
        assert (from_file == 1.0).sum() == (cells >= 65).sum()
        assert (tmp_path / 'map_refined.png').stat().st_size > 500
        stop(node)
    assert state.stat().st_size > 1000

    # The same scans again: the chains go on where they were.
    with server(**limits, **files) as node, Observer() as observer:
        client = Client(observer)
        client.record(walk)
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', sweeps=800)
        stop(node)
    assert 'goes on from' in node.output


def test_answers_at_once_and_misses_no_scan_while_it_samples(walk):
    """Scans at 60 Hz and four callers of services, while two chains use what they can."""
    with server(**ENDLESS) as node, Observer() as observer:
        client = Client(observer)
        client.record(walk)
        client.refine()
        observer.until(lambda: client.values()['state'] == 'sampling')
        services = {name: Trigger for name in ('stop', 'refine', 'save_map')} | {'get_map': GetMap}
        callers = {
            name: observer.node.create_client(kind, f'refine_server/{name}')
            for name, kind in services.items()
        }
        observer.until(lambda: all(c.service_is_ready() for c in callers.values()))
        arguments = [str(walk), '--rate', '3', '--wait', '20', '--wait-topics', '2']
        took = {'get_map': [], 'refine': []}
        with NodeProcess('replay', arguments) as player:
            observer.until(lambda: int(client.values()['scans received']) > SCANS)
            while player.running():
                for name, kind in (('get_map', GetMap), ('refine', Trigger)):
                    started = time.monotonic()
                    future = callers[name].call_async(kind.Request())
                    observer.until(future.done)
                    took[name].append(time.monotonic() - started)
                    pause_until = time.monotonic() + 0.1
                    observer.until(lambda until=pause_until: time.monotonic() > until)
            assert player.wait() == 0, player.output
        print(took)
        client.wait_for(scans_received=2 * SCANS)
        stop(node)
