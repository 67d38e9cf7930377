"""The bond with a lifecycle manager: heartbeats while the node is active, a last word after."""

import sys
import threading
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.parameter import Parameter
from support.local_ros import local_node

from ogm_mcmc.config.nodes import ManagedConfig
from ogm_mcmc.ros import bond
from ogm_mcmc.ros.bond import Bond
from ogm_mcmc.ros.managed_node import ManagedNode


def status(**values):
    return SimpleNamespace(header=SimpleNamespace(stamp=None), **values)


class Node:
    """Stands in for a node; keeps (active, instance_id) of what it publishes."""

    def __init__(self):
        self.said, self.topics, self.beats = [], [], threading.Event()
        self.context = SimpleNamespace(ok=lambda: True)

    def get_name(self):
        return 'mapper'

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: 'now'))

    def create_publisher(self, kind, topic, depth):
        self.topics.append(topic)
        return self

    def destroy_publisher(self, publisher):
        self.topics.remove('bond')

    def wait_for_all_acked(self, limit):
        assert not self.said[-1][0]

    def publish(self, message):
        assert (message.id, message.header.stamp) == ('mapper', 'now')
        self.said.append((message.active, message.instance_id))
        if len(self.said) >= 3:
            self.beats.set()


@pytest.fixture
def node(monkeypatch):
    package, messages = ModuleType('bond'), ModuleType('bond.msg')
    messages.Status = status
    monkeypatch.setitem(sys.modules, 'bond', package)
    monkeypatch.setitem(sys.modules, 'bond.msg', messages)
    monkeypatch.setattr(bond, 'PERIOD_S', 0.01)
    return Node()


def test_it_says_that_the_node_lives_until_it_does_not(node):
    one = Bond(node)
    one.begin()
    one.begin()  # is no second one
    assert node.topics == ['bond']
    assert node.beats.wait(10.0)
    one.end()
    one.end()
    *alive, last = [active for active, _ in node.said]
    assert all(alive)
    assert not last
    assert node.topics == []
    assert len({instance for _, instance in node.said}) == 1


def test_each_activation_is_a_bond_of_its_own(node):
    one = Bond(node)
    for _ in range(2):
        one.begin()
        one.end()
    assert len({instance for _, instance in node.said}) == 2


def test_without_its_messages_there_is_none(monkeypatch):
    monkeypatch.setitem(sys.modules, 'bond', None)
    node = Node()
    one = Bond(node)
    one.begin()
    one.end()
    assert node.topics == node.said == []


class Idle(ManagedNode):
    """A node that does nothing."""

    def __init__(self, **options):
        super().__init__('idle', [ManagedConfig], frozenset(), **options)
        self.start()

    def warm_up(self):
        pass

    set_up = begin = end = tear_down = parameters_changed = warm_up


@pytest.mark.ros
@pytest.mark.parametrize(('autostart', 'bonds'), [(True, 0), (False, 2)])
def test_a_managed_node_is_bonded_while_it_is_active(monkeypatch, autostart, bonds):
    """One that starts by itself has nobody to be bonded with."""
    said = []
    monkeypatch.setattr(Bond, 'begin', lambda one: said.append('begin'))
    monkeypatch.setattr(Bond, 'end', lambda one: said.append('end'))
    options = [Parameter('autostart', value=autostart)]
    with local_node(Idle, ready=False, parameter_overrides=options) as node:
        if not autostart:
            node.trigger_configure()
            assert said == []
            node.trigger_activate()
        node.trigger_deactivate()
        assert said[-1] == 'end'
        node.trigger_activate()
        node.trigger_shutdown()
        assert said[-1] == 'end'
    assert said.count('begin') == bonds
