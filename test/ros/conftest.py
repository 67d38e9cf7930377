"""Fixtures that several modules of nodes share; what needs rclpy is imported by its users only."""

from dataclasses import replace

import numpy as np
import pytest

from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.simulation import WORLDS, Lidar, record


@pytest.fixture(scope='module')
def node():
    from support.local_ros import local_node

    with local_node() as local:
        yield local


@pytest.fixture
def bench(node):
    from support.intake import Bench

    return lambda *args, **settings: Bench(node, *args, **settings)


@pytest.fixture
def tf_bench(bench, monkeypatch):
    """With the messages of tf, installed or not; they are handed over directly."""
    from support.local_ros import tf2_msgs_stand_in

    with tf2_msgs_stand_in(monkeypatch):
        yield bench


@pytest.fixture(scope='session')
def walks(tmp_path_factory):
    """Two bags of the walk through the office, one after the other; 193 scans of 90 beams each."""
    folder = tmp_path_factory.mktemp('walks')
    lidar = Lidar(beams=90, range_max_m=8.0)
    recording = list(record(WORLDS['office'](), lidar, np.random.default_rng(5)))
    # Without a gap in which scans would be missing.
    later_ns = recording[-1].scan.stamp_ns - recording[0].scan.stamp_ns
    write_recording(folder / 'first', recording[::6])
    second = (
        placed._replace(scan=replace(placed.scan, stamp_ns=placed.scan.stamp_ns + later_ns))
        for placed in recording[3::6]
    )
    write_recording(folder / 'second', second)
    return folder / 'first', folder / 'second'
