"""What goes out on the map topics: safe for planners, current for everybody, under any name."""

import itertools

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger
from support.local_ros import replayed, spun_node
from support.nav2_rules import FREE, WALL, StaticLayer, amcl_cells, static_layer_cells
from support.ros import NodeProcess, Observer, takes_scans

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.geometry.grid_map import occupancy_values
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.online_mapper import OnlineMapper
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.ros.refine_server import RefineServer
from ogm_mcmc.simulation import WORLDS, Lidar, record

pytestmark = [pytest.mark.ros]

VOLATILE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SCANS = 60


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """A short walk; some probabilities lie between the thresholds."""
    recorded = record(WORLDS['office'](), Lidar(beams=90), np.random.default_rng(5))
    path = tmp_path_factory.mktemp('walk') / 'bag'
    write_recording(path, itertools.islice(recorded, 0, 6 * SCANS, 6))
    return path


def mapped(bag, config):
    """Return the probabilities (height, width) of a bag's map."""
    pipeline, choice = MappingPipeline(config), StreamChoice()
    with BagReader(bag) as reader:
        for placed in PlacedScans(reader, choose_topics(reader, choice), choice):
            pipeline.update(placed)
    return pipeline.method.probabilities(pipeline.method.spec.box)


def as_array(msg):
    return np.frombuffer(msg.data, np.int8).reshape(msg.info.height, msg.info.width)


def values_of(reports):
    return {item.key: item.value for item in reports[-1].status[0].values}


def drive(observer, bag, key, **settings):
    """Replay a bag; wait until a node has used every scan."""
    reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
    observer.until(lambda: takes_scans(reports), 200.0)
    replayed(bag, observer, **settings)
    observer.until(lambda: values_of(reports)[key] == str(SCANS))


def assert_settings_do_not_matter(msg):
    """The static layer takes a map, and its walls stay walls however it is set."""
    layer = StaticLayer()
    layer.take_map(msg)
    assert layer.refused == []
    values = as_array(msg)
    assert np.array_equal(layer.costs, static_layer_cells(values))
    for lethal in (1, 65, 100):
        for trinary in (True, False):
            costs = static_layer_cells(values, lethal, trinary=trinary)
            assert np.array_equal(costs, layer.costs)
    blind = static_layer_cells(values, track_unknown=False)
    assert np.array_equal(blind == WALL, layer.costs == WALL)
    assert (blind[values == -1] == FREE).all()


def test_planners_and_amcl_see_every_wall_of_the_live_map(bag):
    probability = mapped(bag, MapperConfig(log_odds_limit=3.5))
    parameters = {'map_update_interval': 0.1, 'log_odds_limit': 3.5, 'no_return': 'clear'}
    with spun_node(OnlineMapper, **parameters), Observer() as observer:
        maps = observer.collect(OccupancyGrid, 'map', LATCHED)
        percents = observer.collect(OccupancyGrid, 'map_probability', LATCHED)
        extents = observer.collect(MapMetaData, 'map_metadata', LATCHED)
        drive(observer, bag, 'scans used')
        walls, free = probability >= 0.65, probability <= 0.25

        def same():
            return bool(maps) and np.array_equal(as_array(maps[-1]) == 100, walls)

        observer.until(same)
        values = as_array(maps[-1])
        for cells in (static_layer_cells(values), amcl_cells(values)):
            assert np.array_equal(cells == WALL, walls)
            assert np.array_equal(cells == FREE, free)
        assert 0 < walls.sum() < free.sum()
        assert_settings_do_not_matter(maps[-1])
        # What the same rules make of the probabilities: no wall is left.
        percent = occupancy_values(probability)
        observer.until(lambda: np.array_equal(as_array(percents[-1]), percent))
        assert not (static_layer_cells(as_array(percents[-1])) == WALL).any()
        assert extents[-1].width == values.shape[1]


def test_planners_and_amcl_see_every_wall_of_the_refined_map(bag):
    parameters = {
        'window.resolution': 0.1,
        'model.sigma': 0.03,
        'patch.prior': 'uniform',
        'patch.size': 1,
        'max_sweeps': 60,
        'r_hat': 0.0,
    }
    with spun_node(RefineServer, **parameters), Observer() as observer:
        maps = observer.collect(OccupancyGrid, 'map_refined', LATCHED)
        percents = observer.collect(OccupancyGrid, 'map_refined_probability', LATCHED)
        extents = observer.collect(MapMetaData, 'map_refined_metadata', LATCHED)
        drive(observer, bag, 'scans recorded')
        answer = observer.call(Trigger, 'refine_server/refine', Trigger.Request())
        assert answer.success, answer.message

        def same_map():
            # Not by their number: of maps that come fast a reader of depth 1 may lose some.
            if not (maps and percents):
                return False
            percent, values = as_array(percents[-1]), as_array(maps[-1])
            if percent.shape != values.shape:
                return False
            for cells in (static_layer_cells(values), amcl_cells(values)):
                walls, free = percent > 65, (percent >= 0) & (percent < 25)
                if not (walls.any() and (cells[walls] == WALL).all()):
                    return False
                if not (free.any() and (cells[free] == FREE).all()):
                    return False
            return set(np.unique(values)) == {-1, 0, 100}

        observer.until(same_map)
        assert_settings_do_not_matter(maps[-1])
        observer.until(lambda: bool(extents) and extents[-1] == maps[-1].info)
        late = observer.collect(MapMetaData, 'map_refined_metadata', VOLATILE)
        observer.until(lambda: bool(late))
        assert late[-1] == maps[-1].info


def test_newcomers_of_a_settled_map_get_the_current_one(bag):
    """Whatever their quality of service, and under a name that was given at the start."""
    arguments = ['--ros-args', '-r', 'map:=chart', '-r', '__ns:=/robot']
    remap = {'remap': 'scan=/robot/scan,pose=/robot/pose'}
    with NodeProcess('online_mapper', arguments) as node, Observer() as observer:
        first = observer.collect(OccupancyGrid, '/robot/chart', LATCHED)
        drive(observer, bag, 'scans used', **remap)
        observer.until(lambda: bool(first))
        settled = len(first)
        observer.spin_while(lambda: True, 1.5)
        for qos in (VOLATILE, BEST_EFFORT, LATCHED):
            maps = observer.collect(OccupancyGrid, '/robot/chart', qos)
            observer.until(lambda maps=maps: bool(maps), 10.0)
            assert np.array_equal(as_array(maps[-1]), as_array(first[-1]))
        assert len(first) > settled
        assert node.stop() == 0, node.output
