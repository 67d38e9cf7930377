"""Poses and mounts from tf, with a stand-in for tf2_ros (it is not on PyPI)."""

import math
import sys
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.geometry import Scan
from ogm_mcmc.ros.tf_poses import TfTree

NS = 1_000_000_000


class TransformError(Exception):
    """What the stand-in raises."""


class Buffer:
    """Transforms at whole seconds; anything else between them is held, nothing extrapolated."""

    def __init__(self):
        self.held = {}

    def put(self, target, source, second, x, y, quaternion):
        self.held.setdefault((target, source), {})[second] = (x, y, quaternion)

    def clear(self):
        self.held.clear()

    def lookup_transform(self, target, source, time):
        known = self.held.get((target, source), {})
        newest = max(known, default=None)
        second = newest if time.nanoseconds == 0 else time.nanoseconds / NS
        if newest is None or not min(known) <= second <= newest:
            raise TransformError('extrapolation')
        x, y, (qx, qy, qz, qw) = known[math.floor(second)]
        transform = SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=0.0),
            rotation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw),
        )
        stamp = SimpleNamespace(sec=math.floor(second), nanosec=0)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp), transform=transform)


@pytest.fixture
def tree(monkeypatch):
    module = ModuleType('tf2_ros')
    module.Buffer = Buffer
    module.TransformListener = lambda buffer, node: None
    module.TransformException = TransformError
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    return TfTree(SimpleNamespace(), 'map', 'base_link')


def scan_at(second):
    return Scan.checked(
        [1.0], angle_min_rad=0.0, angle_increment_rad=1.0, range_min_m=0.0, range_max_m=5.0,
        stamp_ns=second * NS,
    )  # fmt: skip


LEVEL = (0.0, 0.0, math.sin(0.25), math.cos(0.25))
HEAD_DOWN = (1.0, 0.0, 0.0, 0.0)


def test_scans_wait_for_tf_and_are_never_misplaced(tree):
    placer = ScanPlacer(tree, timeout_s=1.0)
    tree._buffer.put('map', 'base_link', 5, 1.0, 2.0, LEVEL)
    for second in (3, 5, 6):
        placer.add_scan(scan_at(second), now_s=0.0)
    placed = list(placer.placed(0.0))
    assert [placement.scan.stamp_ns for placement in placed] == [5 * NS]
    mean = placed[0].belief.mean
    assert (mean.x_m, mean.y_m, mean.yaw_rad) == (1.0, 2.0, pytest.approx(0.5))
    assert placer.dropped == {'pose_unavailable': 1}
    tree._buffer.put('map', 'base_link', 6, 3.0, 2.0, LEVEL)
    assert [placement.belief.mean.x_m for placement in placer.placed(0.5)] == [3.0]
    placer.add_scan(scan_at(9), now_s=1.0)
    assert list(placer.placed(2.5)) == []
    assert placer.dropped == {'pose_unavailable': 1, 'pose_timeout': 1}


def test_a_base_that_is_not_level_is_counted_and_nothing_else(tree):
    placer = ScanPlacer(tree)
    tree._buffer.put('map', 'base_link', 5, 1.0, 2.0, (math.sin(0.4), 0.0, 0.0, math.cos(0.4)))
    tree._buffer.put('map', 'base_link', 6, 1.0, 2.0, HEAD_DOWN)
    placer.add_scan(scan_at(5))
    placer.add_scan(scan_at(6))
    assert list(placer.placed(0.0)) == []
    assert placer.dropped == {'pose_unusable': 2}


def test_a_restart_of_time_empties_the_buffer(tree):
    placer = ScanPlacer(tree)
    tree._buffer.put('map', 'base_link', 50, 1.0, 2.0, LEVEL)
    placer.add_scan(scan_at(50))
    assert len(list(placer.placed(0.0))) == 1
    placer.add_scan(scan_at(3))
    tree._buffer.put('map', 'base_link', 4, 7.0, 2.0, LEVEL)
    placer.add_scan(scan_at(4))
    assert [placement.belief.mean.x_m for placement in placer.placed(0.1)] == [7.0]
    assert placer.dropped == {'scan_jumped_back': 1}


def test_mounts_from_tf(tree):
    assert tree.mount_of('laser') is None
    tree._buffer.put('base_link', 'laser', 1, 0.3, -0.1, HEAD_DOWN)
    mount = tree.mount_of('laser')
    assert (mount.pose.x_m, mount.pose.y_m) == (0.3, -0.1)
    assert mount.upside_down
    tree._buffer.put('base_link', 'tilted', 1, 0.0, 0.0, (math.sin(0.4), 0.0, 0.0, math.cos(0.4)))
    with pytest.raises(PoseError, match='tilted by 46 degrees'):
        tree.mount_of('tilted')


def test_without_tf2_ros_the_reason_is_given(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    with pytest.raises(ConfigError, match='tf2_ros is not installed'):
        TfTree(SimpleNamespace(), 'map', 'base_link')
