"""replay -> DDS -> refine_server -> map_refined, each in a process of its own."""

import math
import signal
import time
from array import array
from dataclasses import replace

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
from support.local_ros import refusal, replayed, spun_node
from support.ros import NodeProcess, Observer, takes_scans

from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.ros.refine_server import RefineServer, main
from ogm_mcmc.simulation import WORLDS, Lidar, record

pytestmark = [pytest.mark.ros]

LIDAR = Lidar(beams=90, range_max_m=8.0)
QUICK = {
    'window.resolution': 0.1,
    'model.sigma': 0.03,
    'map_update_interval': 0.2,
    'niceness': 0,
    # Of independent cells: they mix in a few sweeps.
    'patch.prior': 'uniform',
    'patch.size': 1,
}
ENDLESS = {'max_time': 1000.0, 'max_sweeps': 10**8, 'r_hat': 0.0}


@pytest.fixture(scope='module')
def walks(tmp_path_factory):
    """Two bags of the walk through the office, one after the other; 193 scans of 90 beams each."""
    folder = tmp_path_factory.mktemp('walks')
    recording = list(record(WORLDS['office'](), LIDAR, np.random.default_rng(5)))
    later_ns = recording[-1].scan.stamp_ns
    write_recording(folder / 'first', recording[::6])
    second = (
        placed._replace(scan=replace(placed.scan, stamp_ns=placed.scan.stamp_ns + later_ns))
        for placed in recording[3::6]
    )
    write_recording(folder / 'second', second)
    return folder / 'first', folder / 'second'


SCANS = 193


def server(**parameters):
    dotted = {name.replace('__', '.'): value for name, value in parameters.items()}
    return NodeProcess('refine_server', parameters={**QUICK, **dotted})


def server_here(**parameters):
    """The server in this process: it starts in a fraction of the time."""
    dotted = {name.replace('__', '.'): value for name, value in parameters.items()}
    return spun_node(RefineServer, **{**QUICK, **dotted})


class Client:
    """What a user of the server sees: its maps and diagnostics, and its services."""

    def __init__(self, observer):
        self.observer = observer
        self.maps = observer.collect(OccupancyGrid, 'map_refined', LATCHED)
        self.reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        observer.until(lambda: takes_scans(self.reports), 200.0)

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

    def replay(self, bag):
        replayed(bag, self.observer)

    def record(self, bag, count=SCANS):
        self.replay(bag)
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
        return self.observer.call(SetParameters, 'refine_server/set_parameters', request).results[
            0
        ]


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


def test_from_scans_to_a_map_near_the_truth(walks, tmp_path):
    """All of it once: recording, refining, maps on every way out, files, chains on disk."""
    state = tmp_path / 'state' / 'chains.npz'
    limits = {'max_time': 60.0, 'max_sweeps': 400, 'r_hat': 0.0}
    files = {'save_directory': tmp_path, 'state_file': state}
    with server(**limits, **files) as node, Observer() as observer:
        client = Client(observer)
        entropies = observer.collect(OccupancyGrid, 'refine_server/entropy', LATCHED)
        client.record(walks[0])
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
        assert len(client.maps) > 2  # it was published as it converged

        observer.until(lambda: bool(entropies))
        observer.until(lambda: entropies[-1].info.width == got.info.width)
        doubt = as_array(entropies[-1])
        assert (doubt[cells == 100] <= 94).all()  # the entropy of occupied_thresh

        saved = client.call('save_map')
        assert saved.message.startswith(f'{tmp_path / "map_refined.yaml"}: ')
        assert ' cells of 0.1 m, ' in saved.message
        from_file = load_map(tmp_path / 'map_refined.yaml').probability
        assert (from_file == 1.0).sum() == (cells >= 65).sum()
        assert (tmp_path / 'map_refined.png').stat().st_size > 500
        stop(node)
    assert state.stat().st_size > 1000

    # The same scans again: the chains go on where they were.
    with server(**limits, **files) as node, Observer() as observer:
        client = Client(observer)
        client.record(walks[0])
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', sweeps=800)
        stop(node)
    assert 'continues from' in node.output


@pytest.mark.alone
def test_answers_at_once_and_misses_no_scan_while_it_samples(walks):
    """Scans at 60 Hz and a caller of services, while two chains use what they can."""
    with server(**ENDLESS) as node, Observer() as observer:
        client = Client(observer)
        client.record(walks[0])
        client.refine()
        client.wait_for(state='sampling')
        kinds = {'get_map': GetMap, 'refine': Trigger, 'stop': Trigger}
        callers = {
            name: observer.node.create_client(kind, f'refine_server/{name}')
            for name, kind in kinds.items()
        }
        observer.until(lambda: all(c.service_is_ready() for c in callers.values()))
        took = []
        # Recorded at 10/6 Hz.
        arguments = [str(walks[1]), '--rate', '36', '--wait', '200', '--wait-topics', '2']
        with NodeProcess('replay', arguments) as player:
            while player.running():
                for name in ('get_map', 'refine', 'get_map', 'refine', 'stop', 'refine'):
                    request = kinds[name].Request()
                    started = time.monotonic()
                    future = callers[name].call_async(request)
                    observer.until(future.done)
                    took.append(time.monotonic() - started)
                    assert name == 'get_map' or future.result().success
                    pause = time.monotonic() + 0.02
                    observer.until(lambda until=pause: time.monotonic() > until)
            assert player.wait() == 0, player.output
        client.wait_for(scans_received=2 * SCANS, scans_recorded=2 * SCANS, state='sampling')
        assert not any(key.startswith('dropped') for key in client.values())
        stop(node)
    assert len(took) > 30
    # One in fifty may meet a hiccup of the machine.
    assert sorted(took)[-1 - len(took) // 50] < 0.1, sorted(took)[-10:]


def test_refine_again_stop_and_clear(walks):
    # Percents: a cell just above a threshold may cross it.
    with server(output='probability', **ENDLESS) as node, Observer() as observer:
        client = Client(observer)
        client.record(walks[0])
        client.refine()
        observer.until(lambda: client.sweeps() > 100)
        client.replay(walks[1])
        client.wait_for(scans_recorded=2 * SCANS, scans_sampled=SCANS, state='sampling')
        before = as_array(client.wait_for_map())

        # Refined again while refining: all scans now, the map goes on from where it was.
        answer = client.refine()
        assert answer.message.startswith(f'sampling {2 * SCANS} scans, ')
        assert 'goes on from the chains of ' in answer.message
        assert answer.message.endswith(' earlier sweeps, instead of those before')
        client.wait_for(scans_sampled=2 * SCANS, state='sampling')
        after = as_array(client.wait_for_map())
        if after.shape == before.shape:
            assert (after[before > 95] > 65).mean() > 0.95

        answer = client.call('stop')
        assert (answer.success, answer.message) == (True, 'stopping')
        client.wait_for(state='idle', stopped_because='stopped')
        sweeps = client.sweeps()
        assert client.call('stop').message == 'was not sampling'
        # The same scans: what was counted counts.
        client.refine()
        observer.until(lambda: client.sweeps() > sweeps + 20)
        # A burn-in ends earlier where the chains agree.
        counted = int(client.values()['sweeps counted'])
        assert client.sweeps() - 50 <= counted < client.sweeps()

        assert client.call('clear').message == f'forgot {2 * SCANS} scans'
        observer.until(lambda: as_array(client.maps[-1]).shape == (1, 1))
        assert as_array(client.maps[-1]) == -1
        client.wait_for(scans_recorded=0, state='idle', sweeps=0)
        assert observer.call(GetMap, 'refine_server/get_map', GetMap.Request()).map.data == (
            array('b')
        )
        assert not client.call('save_map').success
        assert not client.call('refine').success
        stop(node, signal.SIGTERM)


def test_nothing_to_sample():
    """No scan at all, a scan whose pose never came, and a scan that says nothing."""
    with server_here(), Observer() as observer:
        client = Client(observer)
        scans = observer.node.create_publisher(LaserScan, 'scan', 10)
        poses = observer.node.create_publisher(PoseWithCovarianceStamped, 'pose', 10)
        observer.until(lambda: all(p.get_subscription_count() for p in (scans, poses)))
        answer = client.call('refine')
        assert not answer.success
        assert answer.message.startswith('no scan was recorded yet: nothing to sample')
        early = client.call('save_map')
        assert not early.success
        assert early.message.startswith('nothing was refined yet')

        msg = LaserScan(range_min=0.05, range_max=5.0, ranges=[math.nan])
        msg.header.stamp.sec = 1
        scans.publish(msg)
        client.wait_for(scans_received=1)
        answer = client.call('refine')
        assert '(0 scans wait for a pose, 1 messages dropped)' in answer.message
        msg.ranges, msg.header.stamp.sec = [1.0], 2
        scans.publish(msg)
        client.wait_for(scans_received=2)
        answer = client.call('refine')
        assert not answer.success
        assert '(1 scans wait for a pose, 1 messages dropped)' in answer.message
        pose = PoseWithCovarianceStamped()
        pose.header.frame_id, pose.header.stamp.sec = 'map', 2
        pose.pose.pose.orientation.w = 1.0
        poses.publish(pose)
        client.wait_for(scans_recorded=1)


def test_publisher_vanishes_and_the_end_comes_in_mid_sweep(walks):
    """The player is killed half way; what was recorded is refined; SIGINT brings a last map."""
    with server(**ENDLESS, map_update_interval=3000.0) as node, Observer() as observer:
        client = Client(observer)
        arguments = [str(walks[0]), '--rate', '20', '--wait', '200', '--wait-topics', '2']
        with NodeProcess('replay', arguments) as player:
            observer.until(lambda: int(client.values()['scans recorded']) > 40)
            player.process.kill()
            player.wait()
        seen = len(client.reports)
        observer.until(lambda: len(client.reports) >= seen + 2)
        recorded = client.values()['scans recorded']
        client.refine()
        observer.until(lambda: client.sweeps() > 200)
        client.wait_for(scans_recorded=recorded, scans_sampled=recorded)
        # One map when sampling began, the next one only at the end.
        assert len(client.maps) == 1
        node.process.send_signal(signal.SIGINT)
        observer.until(lambda: len(client.maps) == 2)
        assert node.wait() == 0, node.output
        assert 'Traceback' not in node.output, node.output
        assert (as_array(client.maps[1]) > 90).sum() > 100


def test_parameters_while_running(walks):
    latest = {'window__keep': 'latest'}
    with (
        server_here(max_sweeps=60, max_time=1000.0, r_hat=0.0, **latest),
        Observer() as observer,
    ):
        client = Client(observer)
        client.record(walks[0])
        too_few = client.set('max_sweeps', ParameterType.PARAMETER_INTEGER, 'integer_value', 50)
        assert not too_few.successful
        assert too_few.reason == (
            'max_sweeps is 50: expected more than burn_in (50), or no sweep counts'
        )
        fixed = client.set('chain.prior', ParameterType.PARAMETER_DOUBLE, 'double_value', 0.3)
        assert not fixed.successful
        assert 'chain.prior is fixed at start' in fixed.reason
        longer = client.set('max_sweeps', ParameterType.PARAMETER_INTEGER, 'integer_value', 70)
        assert longer.successful
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', sweeps=70)
        known = (as_array(client.maps[-1]) >= 0).sum()
        assert client.set(
            'unknown_margin', ParameterType.PARAMETER_DOUBLE, 'double_value', 0.08
        ).successful
        observer.until(lambda: (as_array(client.maps[-1]) >= 0).sum() < known)
        assert client.set(
            'output', ParameterType.PARAMETER_STRING, 'string_value', 'probability'
        ).successful
        observer.until(lambda: set(np.unique(as_array(client.maps[-1]))) > {-1, 0, 100})
        few = client.set('max_scans', ParameterType.PARAMETER_INTEGER, 'integer_value', 20)
        assert few.successful
        client.replay(walks[1])
        client.wait_for(scans_received=2 * SCANS, scans_recorded=20, scans_let_go=2 * SCANS - 20)


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'chain.prior': 0.0}, 'chain.prior'),
        ({'chain.prior': 1.0}, 'chain.prior'),
        ({'model.sigma': 0.0}, 'model.sigma'),
        ({'model.sigma': -1.0}, 'model.sigma'),
        ({'model.clutter': 0.5, 'model.missing': 0.5}, 'clutter + missing + short is 1.0'),
        ({'chain.burn_in': 2000}, 'max_sweeps is 2000: expected more than burn_in (2000)'),
        ({'r_hat': 0.9}, 'r_hat is 0.9: expected more than 1'),
        ({'free_thresh': 0.9}, 'free_thresh'),
        ({'state_file': '~nosuchuser/chains.npz'}, "state_file is '~nosuchuser/chains.npz'"),
        ({'state_file': '/proc/none/chains.npz'}, '/proc/none: expected a writable folder'),
    ],
)
def test_wrong_parameters_end_the_node_with_one_line(capfd, parameters, reason):
    assert reason in refusal(main, capfd, **parameters)


def test_a_wrong_parameter_ends_the_process_with_one_line():
    with NodeProcess('refine_server', parameters={'chain.prior': 0.0}) as node:
        assert node.wait() == 2, node.output
    errors = [line for line in node.output.splitlines() if line.startswith('error: ')]
    assert len(errors) == 1, node.output
    assert 'chain.prior' in errors[0]
    assert 'Traceback' not in node.output


def test_memory_is_a_limit_like_the_others(walks):
    """A window of 1 MB: scans go, and what is left can be sampled."""
    parameters = {'window__max_memory_mb': 1.0, 'max_sweeps': 60, 'r_hat': 0.0}
    with server_here(**parameters), Observer() as observer:
        client = Client(observer)
        client.replay(walks[0])
        client.wait_for(scans_received=SCANS)
        values = client.values()
        assert 5 < int(values['scans recorded']) < SCANS - 20
        assert int(values['scans recorded']) + int(values['scans let go']) == SCANS
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', last_error='')
    # One scan that is too large for any window is refused as it comes.
    with (
        server(window__max_memory_mb=1.0, window__resolution=0.01) as node,
        Observer() as observer,
    ):
        client = Client(observer)
        client.replay(walks[0])
        client.wait_for(scans_received=SCANS)
        assert int(client.values()['dropped: scan_off_map']) > 20
        stop(node)
    assert 'expected at most max_memory_mb = 1 [scan_off_map' in node.output
