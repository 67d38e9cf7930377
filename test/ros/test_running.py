"""How nodes are made and cleaned up."""

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
