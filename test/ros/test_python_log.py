"""Lines of Python's logging in the log of a node."""

import logging
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from support.local_ros import Logs

from ogm_mcmc.ros.python_log import PythonLog


def test_the_node_says_what_the_package_says():
    node, source = SimpleNamespace(), logging.getLogger('ogm_mcmc.engine.prior_files')
    logs, log = Logs(node), PythonLog(node)
    source.warning('before')
    log.begin()
    source.warning('%s: %s', 'prior.npz', 'of another resolution')
    source.error('lost')
    source.info('not asked for')
    log.end()
    source.warning('after')
    assert logs.said == [('warning', 'prior.npz: of another resolution'), ('error', 'lost')]
