"""How nodes are made and cleaned up."""

import sys

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.node import Node
from support.ros import Observer

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.ros.running import run_node

pytestmark = [pytest.mark.ros]


def test_a_node_that_is_half_made_is_gone_as_well(capsys):
    """Nobody has it, and it refers to itself; the process may end without the interpreter."""

    class Half(Node):
        def __init__(self):
            super().__init__('half')
            self.itself = self
            observer.until(lambda: 'half' in observer.node.get_node_names(), 10.0)
            raise ConfigError('no laser')

    with Observer() as observer:
        assert run_node(Half, []) == 2
        observer.lets_go_of('half')
    assert capsys.readouterr().err == 'error: no laser\n'


def test_an_error_that_cannot_be_written_keeps_its_code(monkeypatch):
    """Standard error on a full disk: nodes ended with 1, as if the fault were theirs."""

    def at_fault():
        raise ConfigError('no laser')

    with open('/dev/full', 'w', buffering=1) as full:
        monkeypatch.setattr(sys, 'stderr', full)
        assert run_node(at_fault, []) == 2
        assert run_node(at_fault, ['--ros-args', '-p', 'nonsense']) == 2
        full.buffer.raw.close()  # or the rest would be tried again
