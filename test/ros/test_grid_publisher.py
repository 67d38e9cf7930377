"""What goes out when: the whole map, or only what changed where everybody takes updates."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.qos import ReliabilityPolicy
from support.nav2_rules import FREE, UNKNOWN, WALL, StaticLayer, static_layer_cells
from support.strategies import fan

from ogm_mcmc.config import MapperConfig, OutputConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros import grid_publisher


class Topic:
    """Stands in for a publisher: knows who listens and keeps what was sent."""

    def __init__(self, name, matched):
        self.topic_name = name
        self.matched = matched
        self.nodes = []
        self.best_effort = set()
        self.sent = []

    def get_subscription_count(self):
        return len(self.nodes)

    def publish(self, msg):
        self.sent.append(np.array(getattr(msg, 'data', ()), np.int8))

    def come(self, *nodes, best_effort=False):
        """Let nodes subscribe, as DDS tells of it."""
        for node in nodes:
            self.nodes.append(node)
            self.best_effort |= {node} if best_effort else set()
            if self.matched is not None:
                self.matched(SimpleNamespace(total_count_change=1))

    def leave(self, node):
        self.nodes.remove(node)
        self.matched(SimpleNamespace(total_count_change=0))


class Node:
    """Stands in for a node: one `Topic` per name; `map` is remapped to `chart`."""

    def __init__(self, **remaps):
        self.topics = {}
        self.remaps = {'map': 'chart', **remaps}

    def resolve_topic_name(self, name, *, only_expand=False):
        plain = name.removeprefix('/')
        return f'/{plain if only_expand else self.remaps.get(plain, plain)}'

    def create_publisher(self, kind, name, qos, event_callbacks=None):
        name = self.resolve_topic_name(name)
        matched = event_callbacks and event_callbacks.matched
        return self.topics.setdefault(name, Topic(name, matched))

    def get_subscriptions_info_by_topic(self, name):
        topic = self.topics[name]
        kinds = {True: ReliabilityPolicy.BEST_EFFORT, False: ReliabilityPolicy.RELIABLE}
        return [
            SimpleNamespace(
                node_namespace='/',
                node_name=node,
                qos_profile=SimpleNamespace(reliability=kinds[node in topic.best_effort]),
            )
            for node in topic.nodes
        ]


def update_message():
    return SimpleNamespace(
        header=SimpleNamespace(frame_id='', stamp=SimpleNamespace(sec=0, nanosec=0)), data=None
    )


@pytest.fixture
def published(monkeypatch):
    """Map topic, updates, pipeline and publisher, with map_msgs installed as it were."""
    monkeypatch.setattr(grid_publisher, '_update_type', lambda: update_message)
    node, pipeline = Node(), MappingPipeline(MapperConfig(resolution=0.1))
    made = grid_publisher.GridPublisher(node, 'map', pipeline, OutputConfig())
    assert set(node.topics) == {'/chart', '/chart_updates'}
    return node.topics['/chart'], node.topics['/chart_updates'], pipeline, made


def drive(pipeline, publisher, x):
    publisher.mark(pipeline.update(PlacedScan.at(fan(1.0), Pose2D(x, 0.05))))
    publisher.publish_changes('map', 0, 1e9)


def test_only_changes_go_to_those_who_follow_them(published):
    whole, updates, pipeline, publisher = published
    whole.come('rviz')
    updates.come('rviz')
    drive(pipeline, publisher, 0.05)
    assert (len(whole.sent), len(updates.sent)) == (1, 0)
    drive(pipeline, publisher, 0.15)
    assert (len(whole.sent), len(updates.sent)) == (1, 1)
    assert updates.sent[0].size == 11


def test_without_map_msgs_there_are_whole_maps_only(monkeypatch):
    monkeypatch.setattr(grid_publisher, '_update_type', lambda: None)
    node, pipeline = Node(), MappingPipeline(MapperConfig(resolution=0.1))
    publisher = grid_publisher.GridPublisher(node, 'map', pipeline, OutputConfig())
    node.topics['/chart'].come('rviz')
    for x in (0.05, 0.15):
        drive(pipeline, publisher, x)
    assert set(node.topics) == {'/chart'}
    assert len(node.topics['/chart'].sent) == 2


def test_whoever_wants_whole_maps_gets_them(published):
    """Counting is not enough: the one who follows updates is not the one who takes maps."""
    whole, updates, pipeline, publisher = published
    whole.come('nav2')
    updates.come('rviz')
    drive(pipeline, publisher, 0.05)
    drive(pipeline, publisher, 0.15)
    assert (len(whole.sent), len(updates.sent)) == (2, 0)


def test_updates_wait_until_their_followers_are_known(published):
    """A subscription is discovered before its node's name: names cannot be compared yet."""
    whole, updates, pipeline, publisher = published
    whole.come('_NODE_NAME_UNKNOWN_')
    updates.come('_NODE_NAME_UNKNOWN_')
    drive(pipeline, publisher, 0.05)
    drive(pipeline, publisher, 0.15)
    assert (len(whole.sent), len(updates.sent)) == (2, 0)


def test_somebody_new_gets_the_current_map_at_once(published):
    """Also while the others take updates, and after the robot has come to rest."""
    whole, updates, pipeline, publisher = published
    whole.come('rviz')
    updates.come('rviz')
    for x in (0.05, 0.15):
        drive(pipeline, publisher, x)
    publisher.serve_newcomers('map', 0)
    assert len(whole.sent) == 1
    # One has left and another come, between two maps.
    whole.leave('rviz')
    whole.come('other')
    publisher.mark(pipeline.update(PlacedScan.at(fan(1.0), Pose2D(0.25, 0.05))))
    publisher.serve_newcomers('map', 0)
    assert len(whole.sent) == 2
    assert not publisher.view.stale
    assert np.array_equal(whole.sent[-1], publisher.view.values.ravel())
    publisher.serve_newcomers('map', 0)
    assert len(whole.sent) == 2


def test_best_effort_newcomers_get_it_twice(published, monkeypatch):
    """They do not ask again for what they missed before they knew the sender."""
    whole, _, pipeline, publisher = published
    drive(pipeline, publisher, 0.05)
    whole.come('foxglove', best_effort=True)
    now = time.monotonic()
    for seconds, sent in ((0.0, 2), (0.1, 2), (3.0, 3), (6.0, 3)):
        monkeypatch.setattr(time, 'monotonic', lambda at=now + seconds: at)
        publisher.serve_newcomers('map', 0)
        assert len(whole.sent) == sent


def test_growth_brings_the_whole_map(published):
    whole, updates, pipeline, publisher = published
    whole.come('rviz')
    updates.come('rviz')
    drive(pipeline, publisher, 0.05)
    drive(pipeline, publisher, 50.0)
    assert (len(whole.sent), len(updates.sent)) == (2, 0)
    drive(pipeline, publisher, 50.1)
    assert (len(whole.sent), len(updates.sent)) == (2, 1)


def test_the_latched_copy_is_renewed(published):
    whole, updates, pipeline, publisher = published
    whole.come('rviz')
    updates.come('rviz')
    for x in (0.05, 0.15):
        drive(pipeline, publisher, x)
    publisher.publish_changes('map', 0, 1e9)
    assert len(whole.sent) == 1
    for _ in range(2):
        publisher.publish_changes('map', 0, 0.0)
    assert len(whole.sent) == 2


def test_what_nobody_asked_for_waits(published):
    """Entropy: infinite interval, nobody listens."""
    whole, _, pipeline, publisher = published
    publisher.mark(pipeline.update(PlacedScan.at(fan(1.0), Pose2D(0.05, 0.05))))
    publisher.publish_changes('map', 0, float('inf'))
    assert whole.sent == []


def test_followers_end_up_with_the_same_map(published):
    """Pasting the updates into the first map gives the last one."""
    whole, updates, pipeline, publisher = published
    whole.come('rviz')
    updates.come('rviz')
    drive(pipeline, publisher, 0.05)
    spec = publisher.view.spec
    picture = whole.sent[0].reshape(spec.height, spec.width)
    for x in (0.15, 0.45, 3.0):
        changed = pipeline.update(PlacedScan.at(fan(1.0), Pose2D(x, 0.05)))
        publisher.mark(changed)
        publisher.publish('map', 0)
        rows, columns = spec.slices(changed)
        shape = picture[rows, columns].shape
        picture[rows, columns] = updates.sent[-1].reshape(shape)
    assert publisher.view.spec == spec
    assert np.array_equal(picture, publisher.view.values)


@pytest.mark.parametrize(
    ('remaps', 'expected'),
    [({}, '/chart_updates'), ({'map_updates': 'news'}, '/news'), ({'map': 'map'}, '/map_updates')],
)
def test_updates_go_where_the_map_goes_or_they_are_remapped(monkeypatch, remaps, expected):
    monkeypatch.setattr(grid_publisher, '_update_type', lambda: update_message)
    node, pipeline = Node(**remaps), MappingPipeline(MapperConfig(resolution=0.1))
    publisher = grid_publisher.GridPublisher(node, 'map', pipeline, OutputConfig())
    assert publisher.updates is node.topics[expected]


def test_a_static_layer_that_follows_updates_misses_none(published, monkeypatch):
    """It holds whole maps back until its cycle, which wipes out updates that came meanwhile."""
    whole, updates, pipeline, publisher = published
    layer, clock = StaticLayer(), [0.0]
    monkeypatch.setattr(time, 'monotonic', lambda: clock[0])
    whole.publish, updates.publish = layer.take_map, layer.take_update
    whole.come('costmap')
    updates.come('costmap')
    for tick in range(60):
        clock[0] = 0.1 * tick
        if tick in (0, 12, 14, 17):  # the second makes the map grow
            x = 30.0 + tick if tick else 0.0
            publisher.mark(pipeline.update(PlacedScan.at(fan(1.0), Pose2D(x, 0.05))))
        if tick % 2 == 0:
            publisher.publish_changes('map', 0, 1e9)
        if tick % 10 == 9:
            layer.cycle()
    assert set(layer.refused) == {'update'}  # of the grown map, before it had that
    shown = publisher.view.values
    assert np.array_equal(layer.costs, static_layer_cells(shown))
    assert {FREE, WALL, UNKNOWN} == set(np.unique(layer.costs))


def test_the_extent_is_published_with_whole_maps(monkeypatch):
    monkeypatch.setattr(grid_publisher, '_update_type', lambda: None)
    node, pipeline = Node(), MappingPipeline(MapperConfig(resolution=0.1))
    publisher = grid_publisher.GridPublisher(
        node, 'map', pipeline, OutputConfig(), metadata='map_metadata'
    )
    kept = []
    node.topics['/map_metadata'].publish = kept.append
    drive(pipeline, publisher, 0.05)
    spec = pipeline.method.spec
    (info,) = kept
    assert (info.width, info.height) == (spec.width, spec.height)
