"""replay -> DDS -> refine_server -> map_refined, each in a process of its own."""

import signal
import time
from array import array

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support.local_ros import local_node, pose, scan
from support.refine_client import ENDLESS, QUICK, SCANS, Client, as_array, server, stop
from support.ros import NodeProcess, Observer

from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.ros.refine_server import RefineServer
from ogm_mcmc.simulation import WORLDS

pytestmark = [pytest.mark.ros]


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


def test_codes_found_late_are_taken_out_of_what_was_recorded(monkeypatch):
    """The third scan has one; the first look after that is at the fourth."""
    monkeypatch.setattr(RefineServer, 'warm_up', lambda self: None)
    walls = [*(1.0 + 0.1 * k for k in range(12)), *[2.0] * 12]
    sampled = []
    quick = [Parameter(name, value=value) for name, value in QUICK.items()]
    with local_node(RefineServer, parameter_overrides=quick) as node:
        for k in range(4):
            node.intake.on_pose(pose(float(k), 0.3 * k))
            ranges = [*walls[:12], *[4.99] * 12] if k > 1 else walls
            came = scan(float(k), ranges)
            came.angle_increment, came.angle_max = 0.1, 2.3
            node.intake.on_scan(came)
        recorded = node.recording.snapshot()
        assert recorded[2].scan.ranges_m[12:].tolist() == [np.float32(4.99)] * 12
        monkeypatch.setattr(node.worker, 'refine', lambda scans, *_, **__: sampled.extend(scans))
        answer = node.on_refine(Trigger.Request(), Trigger.Response())
        assert answer.success, answer.message
    assert [np.isinf(one.scan.ranges_m).sum() for one in sampled] == [0, 0, 12, 12]
    assert sampled[0] is recorded[0]


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
        client.wait_for(scans_received=2 * SCANS, scans_forgotten_when_asked_to=2 * SCANS)
        assert observer.call(GetMap, 'refine_server/get_map', GetMap.Request()).map.data == (
            array('b')
        )
        assert not client.call('save_map').success
        assert not client.call('refine').success
        stop(node, signal.SIGTERM)
