"""replay -> DDS -> online_mapper -> OccupancyGrid, each in a process of its own."""

import itertools
import signal
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from std_srvs.srv import SetBool, Trigger
from support.local_ros import replayed, spun_node
from support.office import OFFICE_SCANS
from support.ros import NodeProcess, Observer, takes_scans

from ogm_mcmc.config import MapperConfig, OutputConfig
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.engine.map_view import MapView
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.online_mapper import OnlineMapper
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.simulation import Lidar, record
from ogm_mcmc.simulation.worlds import office

pytestmark = [pytest.mark.ros]

EVERY_SCAN = str(OFFICE_SCANS)


def offline_pipeline(bag_path):
    pipeline = MappingPipeline(MapperConfig())
    with BagReader(bag_path) as bag:
        choice = StreamChoice()
        for placed in PlacedScans(bag, choose_topics(bag, choice), choice):
            pipeline.update(placed)
    return pipeline


def replay(bag_path, *extra):
    arguments = [str(bag_path), '--wait', '200', '--wait-topics', '2', *map(str, extra)]
    return NodeProcess('replay', arguments)


def values_of(reports):
    return {item.key: item.value for item in reports[-1].status[0].values}


def as_array(msg):
    return np.frombuffer(msg.data, np.int8).reshape(msg.info.height, msg.info.width)


@pytest.fixture
def mapper(tmp_path):
    # As offline: with `auto` the first scans are mapped before it is known what no return means.
    parameters = {'save_directory': tmp_path, 'map_update_interval': 0.2, 'no_return': 'clear'}
    with NodeProcess('online_mapper', parameters=parameters) as node:
        yield node


def test_live_map_equals_offline_map(office_bag, mapper, tmp_path):
    with Observer() as observer:
        maps = observer.collect(OccupancyGrid, 'map', LATCHED)
        entropies = observer.collect(OccupancyGrid, 'online_mapper/entropy', LATCHED)
        reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        observer.until(lambda: takes_scans(reports), 200.0)
        with replay(office_bag, '--rate', 0) as player:
            observer.until(lambda: not player.running(), 90.0)
            assert player.wait() == 0, player.output
        observer.until(lambda: values_of(reports)['scans used'] == EVERY_SCAN)
        saved = observer.call(Trigger, 'online_mapper/save_map', Trigger.Request())
        pipeline = offline_pipeline(office_bag)
        view = MapView(pipeline, OutputConfig())
        view.refresh()
        observer.until(lambda: bool(maps) and np.array_equal(as_array(maps[-1]), view.values))
        entropy = MapView(pipeline, OutputConfig(), 'entropy')
        entropy.refresh()
        observer.until(lambda: np.array_equal(as_array(entropies[-1]), entropy.values))

    assert not any(key.startswith('dropped') for key in values_of(reports))
    last = maps[-1]
    assert last.header.frame_id == 'map'
    assert last.info.resolution == pytest.approx(0.05)
    assert last.info.origin.position.x == pytest.approx(view.spec.origin_x_m)
    assert last.info.origin.orientation.w == 1.0
    assert saved.success, saved.message
    where, size = saved.message.split(': ')
    assert where == str(tmp_path / 'map.yaml')
    from_file, offline = load_map(tmp_path / 'map.yaml'), pipeline.map()
    assert from_file.probability.shape == offline.probability.shape
    height, width = offline.probability.shape
    known = np.isfinite(offline.probability).mean()
    assert size == f'{width} x {height} cells of 0.05 m, {100 * known:.1f} % of them known'
    assert np.array_equal(from_file.probability == 1.0, offline.probability >= 0.65)
    assert np.array_equal(from_file.probability == 0.0, offline.probability <= 0.25)
    assert mapper.stop() == 0, mapper.output
    assert 'Traceback' not in mapper.output


def test_late_subscriber_gets_the_latched_map(office_bag):
    with spun_node(OnlineMapper, map_update_interval=0.2), Observer() as observer:
        replayed(office_bag, observer)
        time.sleep(0.5)
        maps = observer.collect(OccupancyGrid, 'map', LATCHED)
        observer.until(lambda: bool(maps), 15.0)
        assert (as_array(maps[0]) >= 0).any()


def test_services_and_parameters(office_bag, mapper, tmp_path):
    with Observer() as observer:
        maps = observer.collect(OccupancyGrid, 'map', LATCHED)
        reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        early = observer.call(Trigger, 'online_mapper/save_map', Trigger.Request())
        assert not early.success
        assert 'no scan was mapped yet' in early.message
        assert list(tmp_path.iterdir()) == []

        paused = observer.call(SetBool, 'online_mapper/pause', SetBool.Request(data=True))
        assert paused.success
        replayed(office_bag, observer)
        observer.until(
            lambda: bool(reports) and values_of(reports)['scans received'] == EVERY_SCAN
        )
        assert values_of(reports)['scans used'] == '0'
        assert values_of(reports)['scans while paused'] == EVERY_SCAN

        observer.call(SetBool, 'online_mapper/pause', SetBool.Request(data=False))
        observer.call(Trigger, 'online_mapper/reset', Trigger.Request())
        replayed(office_bag, observer)
        observer.until(lambda: values_of(reports)['scans used'] == EVERY_SCAN)
        observer.until(lambda: bool(maps) and set(np.unique(as_array(maps[-1]))) == {-1, 0, 100})

        assert set_parameter(observer, 'map_update_interval', 3000.0).successful
        assert set_parameter(observer, 'map_update_interval', 0.2).successful
        answer = set_parameter(observer, 'output', 'probability')
        assert answer.successful
        observer.until(lambda: set(np.unique(as_array(maps[-1]))) > {-1, 0, 100})
        refused = set_parameter(observer, 'resolution', 0.1)
        assert not refused.successful
        assert 'fixed at start' in refused.reason
        nonsense = set_parameter(observer, 'output', 'colourful')
        assert not nonsense.successful
        assert 'one of trinary, probability' in nonsense.reason

        request = DescribeParameters.Request(names=['resolution', 'max_cells', 'fusion'])
        described = observer.call(
            DescribeParameters, 'online_mapper/describe_parameters', request
        ).descriptors
        assert described[0].floating_point_range[0].from_value == 0.001
        assert described[1].integer_range[0].from_value == 4096
        assert 'per_scan' in described[2].description

        reset = observer.call(Trigger, 'online_mapper/reset', Trigger.Request())
        assert reset.success
        observer.until(lambda: (as_array(maps[-1]) == -1).all())
    assert mapper.stop(signal.SIGTERM) == 0, mapper.output


def half_used(reports):
    return bool(reports) and int(values_of(reports)['scans used']) > OFFICE_SCANS // 2


def test_replay_waits_again_for_a_mapper_that_was_restarted(office_bag):
    """At rate 0: nobody is flooded, nobody is waited for after it has gone."""
    with replay(office_bag, '--rate', 0, '--loop') as player:
        for _ in range(2):
            with NodeProcess('online_mapper') as node, Observer() as observer:
                reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
                observer.until(partial(half_used, reports), 60.0)
                values = values_of(reports)
                assert node.stop() == 0, node.output
            lost = int(values['scans received']) - int(values['scans used'])
            # Only what is lost where the recording starts again, and what is on its way: a mapper
            # that is flooded loses about half.
            assert lost < 60 + 0.1 * int(values['scans received']), values
        assert player.stop() == 0, player.output
    assert 'Traceback' not in player.output


def test_reset_while_the_robot_is_far_from_the_origin(tmp_path):
    """The window of the map starts anew somewhere else; nothing of the old one may matter."""
    recording = [
        PlacedScan.at(placed.scan, replace(placed.pose, x_m=500.0 + placed.pose.x_m))
        for placed in itertools.islice(
            record(office(), Lidar(beams=30), np.random.default_rng(9)), 20
        )
    ]
    write_recording(tmp_path / 'far', recording)
    with spun_node(OnlineMapper, map_update_interval=0.2), Observer() as observer:
        maps = observer.collect(OccupancyGrid, 'map', LATCHED)
        reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        for _ in range(2):
            replayed(tmp_path / 'far', observer)
            observer.until(lambda: bool(reports) and values_of(reports)['scans used'] == '20')
            observer.until(lambda: bool(maps) and (as_array(maps[-1]) >= 0).any())
            assert maps[-1].info.origin.position.x > 400.0
            assert observer.call(Trigger, 'online_mapper/reset', Trigger.Request()).success
            observer.until(lambda: (as_array(maps[-1]) == -1).all())


def set_parameter(observer, name, value):
    kinds = {float: ParameterType.PARAMETER_DOUBLE, str: ParameterType.PARAMETER_STRING}
    new = ParameterValue(type=kinds[type(value)])
    if isinstance(value, float):
        new.double_value = value
    else:
        new.string_value = value
    request = SetParameters.Request(parameters=[Parameter(name=name, value=new)])
    return observer.call(SetParameters, 'online_mapper/set_parameters', request).results[0]


def test_a_wrong_parameter_ends_the_process_with_one_line():
    """Others: see test_online_mapper.py."""
    with NodeProcess('online_mapper', parameters={'resolution': -1.0}) as node:
        assert node.wait() == 2, node.output
    errors = [line for line in node.output.splitlines() if line.startswith('error: ')]
    assert len(errors) == 1
    assert 'resolution' in errors[0]
    assert 'Traceback' not in node.output


@pytest.mark.data
def test_recorded_log_through_everything(data_folder, tmp_path):
    """The Intel Research Lab: log -> bag -> replay -> DDS -> online_mapper -> crisp map."""
    from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen

    bag_path = tmp_path / 'intel'
    import_carmen(data_folder / 'intel' / 'intel.gfs.log', bag_path, ImportOptions())
    parameters = {'save_directory': tmp_path, 'no_return': 'ignore'}
    with NodeProcess('online_mapper', parameters=parameters), Observer() as observer:
        reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        with replay(bag_path, '--rate', 0, '--topics', 'scan,pose') as player:
            observer.until(lambda: not player.running(), 90.0)
        observer.until(lambda: bool(reports) and values_of(reports)['scans used'] == '910')
        assert not any(key.startswith('dropped') for key in values_of(reports))
        assert observer.call(Trigger, 'online_mapper/save_map', Trigger.Request()).success
    walls = load_map(tmp_path / 'map.yaml').probability == 1.0
    # Crisp: walls of one or two cells, so few occupied cells have eight occupied neighbours.
    padded = np.pad(walls, 1)
    around = sum(
        padded[1 + dy : padded.shape[0] - 1 + dy, 1 + dx : padded.shape[1] - 1 + dx].astype(int)
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    )
    assert 8_000 < walls.sum() < 20_000
    assert (around[walls] == 9).mean() < 0.02
