"""`online_mapper` in the test's own process: messages are handed over, services called directly.

What needs a process, other nodes or DDS is in test_methods.py and test_map_topics.py.
"""

import math
from contextlib import ExitStack
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger
from support.local_ros import Logs, local_node, pose, refusal, scan

from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import CellBox
from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.online_mapper import OnlineMapper, main

pytestmark = [pytest.mark.ros]

# The cell of a wall 2 m in front of a robot at (0.05, 0.05), and one on the way there.
WALL, WAY = CellBox(20, 0, 21, 1), CellBox(10, 0, 11, 1)


@pytest.fixture
def mapper():
    """Make a node with parameters, 0.1 m cells unless told otherwise."""
    with ExitStack() as stack:

        def make(**parameters):
            chosen = {'resolution': 0.1, 'transform_timeout': 0.0, **parameters}
            overrides = [Parameter(name, value=value) for name, value in chosen.items()]
            node = stack.enter_context(local_node(OnlineMapper, parameter_overrides=overrides))
            node.said = Logs(node)
            return node

        yield make


def walk(node, count=10, *, first_s=1.0, ranges=(2.0,)):
    for k in range(count):
        node.intake.on_pose(pose(first_s + k, 0.05, 0.05))
        node.intake.on_scan(scan(first_s + k, ranges))


def probability(node, box):
    return float(node.pipeline.method.probabilities(box)[0, 0])


def trigger(service):
    return service(Trigger.Request(), Trigger.Response())


def change(node, name, value):
    return node.set_parameters([Parameter(name, value=value)])[0]


def test_scans_become_a_map_and_a_reset_forgets_it(mapper):
    node = mapper()
    walk(node)
    assert node.pipeline.scans_used == 10
    assert probability(node, WALL) > 0.99 > 0.01 > probability(node, WAY)
    assert trigger(node.on_reset).message == 'forgot a map of 10 scans'
    assert node.pipeline.scans_used == 0
    assert node.intake.values()['scans forgotten when asked to'] == 10
    walk(node, 1, first_s=20.0)
    assert node.pipeline.scans_used == 1


def test_a_bad_message_is_dropped_and_counted(mapper):
    node = mapper()
    walk(node, 2)
    broken = scan(4.0)
    broken.angle_increment = math.nan
    node.intake.on_scan(broken)
    node.intake.on_pose(pose(5.0, x=math.nan))
    walk(node, 1, first_s=6.0)
    assert node.pipeline.scans_used == 3
    assert node.intake.problems.all() == {'scan_invalid': 1, 'pose_invalid': 1}
    assert node.said.of('error', 'fatal') == []
    node.publish_diagnostics()


def test_no_scan_is_used_in_a_pause(mapper):
    node = mapper()
    assert node.on_pause(SetBool.Request(data=True), SetBool.Response()).success
    walk(node, 3)
    assert node.pipeline.scans_used == 0
    node.on_pause(SetBool.Request(data=False), SetBool.Response())
    walk(node, 3, first_s=10.0)
    assert node.pipeline.scans_used == 3


def test_beams_without_a_return_wait_until_it_is_seen_what_they_cross(mapper):
    """A robot that drives past a pillar it always sees, and past nothing else."""
    node = mapper()
    beyond = CellBox(10, 40, 11, 41)
    for k in range(100):
        x = 0.05 + 0.06 * k
        node.intake.on_pose(pose(1.0 + k, x, 0.05))
        node.intake.on_scan(scan(1.0 + k, (max(6.2 - x, 0.05), *[math.inf] * 3)))
        if k == 90:
            assert math.isnan(probability(node, beyond))
            assert node.no_return.text().startswith('ignore for now (auto)')
    assert node.pipeline.config.no_return == 'clear'
    (line,) = (line for line in node.said.of('info') if 'no_return' in line)
    assert line.startswith('no_return auto: clear, ')
    assert change(node, 'no_return', 'ignore').successful
    assert node.pipeline.config.no_return == 'ignore'
    assert change(node, 'no_return', 'auto').successful
    assert node.pipeline.config.no_return == 'ignore'  # careful again
    node.publish_diagnostics()


def test_until_it_clears_a_live_map_is_that_without_beams_without_a_return(mapper):
    """Offline they clear from the first scan on: more is known, nothing is more occupied."""
    node, taken = mapper(), []
    update = node.pipeline.update
    node.pipeline.update = lambda placed: (taken.append(placed), update(placed))[1]
    for k in range(110):
        x = 0.05 + 0.06 * k
        node.intake.on_pose(pose(1.0 + k, x, 0.05))
        node.intake.on_scan(scan(1.0 + k, (max(7.2 - x, 0.05), *[math.inf] * 3)))
    assert node.pipeline.config.no_return == 'clear'
    offline = MappingPipeline(replace(node.pipeline.config, no_return='clear'))
    without = MappingPipeline(offline.config)
    for k, placed in enumerate(taken):
        offline.update(placed)
        ranges = placed.scan.ranges_m
        silent = np.where(np.isinf(ranges) & (k < 100), np.float32(np.nan), ranges)
        without.update(placed._replace(scan=replace(placed.scan, ranges_m=silent)))
    live = node.pipeline.map()
    assert np.array_equal(live.probability, without.map().probability, equal_nan=True)
    at_once, known = offline.method.probabilities(live.spec.box), np.isfinite(live.probability)
    assert (at_once[known] <= live.probability[known]).all()
    assert 0 < known.sum() < np.isfinite(offline.map().probability).sum()


def test_a_reset_forgets_what_beams_without_a_return_meant(mapper):
    """What was seen elsewhere has no vote in the next building."""
    node = mapper(keep_scans=True)
    node.no_return.choice = node.no_return.choice._replace(value='clear')
    walk(node, 3)
    assert node.pipeline.config.no_return == 'clear'
    node.trajectory.last = object()
    assert trigger(node.on_reset).success
    assert node.no_return.choice.value == node.pipeline.config.no_return == 'ignore'
    assert node.no_return._watch.seen == 0
    assert node.trajectory.last is None


def test_cones_without_an_echo_clear_from_the_start(mapper):
    assert mapper(method='sonar').pipeline.config.no_return == 'clear'


def test_a_map_is_saved_with_what_its_method_adds(mapper, tmp_path):
    node = mapper(method='adaptive', save_directory=str(tmp_path), save_name='floor')
    nothing = trigger(node.on_save_map)
    assert (nothing.success, nothing.message) == (
        False,
        'no scan was mapped yet: nothing to save',
    )
    walk(node)
    saved = trigger(node.on_save_map)
    assert saved.success
    assert saved.message.startswith(f'{tmp_path / "floor.yaml"}: ')
    assert (load_map(tmp_path / 'floor.yaml').probability == 1.0).any()
    tree = load_tree(tmp_path / 'floor_tree.npz')
    assert tree.probabilities(WALL)[0, 0] == probability(node, WALL)


def test_a_place_that_cannot_be_written_to_is_an_answer(mapper, tmp_path):
    (tmp_path / 'taken').write_text('')
    node = mapper(save_directory=str(tmp_path / 'taken'))
    walk(node, 1)
    saved = trigger(node.on_save_map)
    assert not saved.success
    assert 'expected a writable folder' in saved.message


def test_live_parameters_take_effect_and_others_are_refused(mapper):
    node = mapper(method='counting')
    walk(node, 3)
    for name, value, reason in (
        ('step.l_occ', 2.0, 'step.l_occ has no effect with method counting'),
        ('resolution', 0.2, ''),
        ('max_range', -1.0, ''),
    ):
        refused = change(node, name, value)
        assert not refused.successful
        assert reason in refused.reason
    assert change(node, 'counting.show', 'ml').successful
    assert node.pipeline.config.counting.show == 'ml'
    assert probability(node, WALL) == 1.0
    assert change(node, 'free_thresh', 0.1).successful
    assert node.maps.map.view.output.free_thresh == 0.1
    assert change(node, 'map_update_interval', 5.0).successful
    assert node.map_timer.timer_period_ns == 5_000_000_000


def test_a_parameter_that_is_not_there_is_refused_by_its_name(mapper):
    asked = [Parameter('step.l_ok', value=1.0)]
    result = mapper().set_parameters_atomically(asked)  # what the services call
    assert (result.successful, result.reason) == (
        False,
        'step.l_ok is not known; ros2 param list shows what is',
    )


def test_a_wrong_parameter_ends_the_start_in_one_line(mapper):
    with pytest.raises(ConfigError, match=r'^[^\n]*free_thresh[^\n]*$'):
        mapper(free_thresh=0.9, occupied_thresh=0.2)


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'resolution': -1.0}, 'resolution'),
        ({'fusion': 'per_sometimes'}, 'one of per_scan, per_beam'),
        ({'resolution': 1}, 'resolution'),
        ({'free_thresh': 0.9}, 'free_thresh'),
        ({'pose_source': 'tf'}, 'pose_source tf needs tf2_msgs'),
        ({'pose_source': 'particle_cloud'}, 'pose_source particle_cloud needs nav2_msgs'),
    ],
)
def test_wrong_parameters_end_the_node_with_one_line(capfd, parameters, reason):
    for package in ('tf2_msgs', 'nav2_msgs'):
        if f'needs {package}' in reason and find_spec(package) is not None:
            pytest.skip(f'{package} is installed here')
    assert reason in refusal(main, capfd, **parameters)
