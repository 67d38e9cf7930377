"""What goes out when: the whole map, or only what changed where everybody takes updates."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from support.strategies import fan

from ogm_mcmc.config import MapperConfig, OutputConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros import grid_publisher


class Topic:
    """Stands in for a publisher: knows who listens and keeps what was sent."""

    def __init__(self, name):
        self.topic_name = name
        self.nodes = []
        self.sent = []

    def get_subscription_count(self):
        return len(self.nodes)

    def publish(self, msg):
        self.sent.append(np.array(msg.data, np.int8))


class Node:
    """Stands in for a node: one `Topic` per name; a listener is (node name, identity)."""

    def __init__(self):
        self.topics = {}

    def create_publisher(self, kind, name, qos):
        return self.topics.setdefault(name, Topic(name))

    def get_subscriptions_info_by_topic(self, name):
        return [
            SimpleNamespace(node_namespace='/', node_name=node, endpoint_gid=[gid])
            for node, gid in self.topics[name].nodes
        ]


def update_message():
    return SimpleNamespace(
        header=SimpleNamespace(frame_id='', stamp=SimpleNamespace(sec=0, nanosec=0)), data=None
    )


@pytest.fixture
def published(monkeypatch):
    """Node, pipeline and publisher, with map_msgs installed as it were."""
    monkeypatch.setattr(grid_publisher, '_update_type', lambda: update_message)
    node, pipeline = Node(), MappingPipeline(MapperConfig(resolution=0.1))
    made = grid_publisher.GridPublisher(node, 'map', pipeline, OutputConfig(), 'map')
    return node.topics, pipeline, made


def drive(pipeline, publisher, x):
    publisher.mark(pipeline.update(PlacedScan.at(fan(1.0), Pose2D(x, 0.05))))
    publisher.publish('map', 0)


RVIZ, NAV2 = ('rviz', 1), ('nav2', 2)


def test_only_changes_go_to_those_who_follow_them(published):
    topics, pipeline, publisher = published
    whole, updates = topics['map'], topics['map_updates']
    whole.nodes, updates.nodes = [RVIZ], [RVIZ]
    drive(pipeline, publisher, 0.05)
    assert (len(whole.sent), len(updates.sent)) == (1, 0)
    drive(pipeline, publisher, 0.15)
    assert (len(whole.sent), len(updates.sent)) == (1, 1)
    assert updates.sent[0].size == 11


def test_whoever_wants_whole_maps_gets_them(published):
    """Counting is not enough: the one who follows updates is not the one who takes maps."""
    topics, pipeline, publisher = published
    whole, updates = topics['map'], topics['map_updates']
    whole.nodes, updates.nodes = [NAV2], [RVIZ]
    drive(pipeline, publisher, 0.05)
    drive(pipeline, publisher, 0.15)
    assert (len(whole.sent), len(updates.sent)) == (2, 0)


def test_somebody_new_and_growth_bring_the_whole_map(published):
    topics, pipeline, publisher = published
    whole, updates = topics['map'], topics['map_updates']
    whole.nodes, updates.nodes = [RVIZ], [RVIZ]
    drive(pipeline, publisher, 0.05)
    # One has left and another come, between two maps.
    whole.nodes, updates.nodes = [('rviz', 7)], [('rviz', 8)]
    drive(pipeline, publisher, 0.15)
    assert (len(whole.sent), len(updates.sent)) == (2, 0)
    drive(pipeline, publisher, 50.0)
    assert (len(whole.sent), len(updates.sent)) == (3, 0)
    drive(pipeline, publisher, 50.1)
    assert (len(whole.sent), len(updates.sent)) == (3, 1)


def test_the_latched_copy_is_known_to_grow_old(published):
    topics, pipeline, publisher = published
    whole, updates = topics['map'], topics['map_updates']
    whole.nodes, updates.nodes = [RVIZ], [RVIZ]
    drive(pipeline, publisher, 0.05)
    assert not publisher.copy_is_old
    drive(pipeline, publisher, 0.15)
    assert publisher.copy_is_old
    assert publisher.publish('map', 0, whole=True)
    assert len(whole.sent) == 2
    assert not publisher.copy_is_old


def test_followers_end_up_with_the_same_map(published):
    """Pasting the updates into the first map gives the last one."""
    topics, pipeline, publisher = published
    topics['map'].nodes, topics['map_updates'].nodes = [RVIZ], [RVIZ]
    drive(pipeline, publisher, 0.05)
    spec = publisher.view.spec
    picture = topics['map'].sent[0].reshape(spec.height, spec.width)
    for x in (0.15, 0.45, 3.0):
        changed = pipeline.update(PlacedScan.at(fan(1.0), Pose2D(x, 0.05)))
        publisher.mark(changed)
        publisher.publish('map', 0)
        rows, columns = spec.slices(changed)
        shape = picture[rows, columns].shape
        picture[rows, columns] = topics['map_updates'].sent[-1].reshape(shape)
    assert publisher.view.spec == spec
    assert np.array_equal(picture, publisher.view.values)
