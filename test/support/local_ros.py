"""Nodes in the test's own process: a context of their own, messages handed over directly."""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan

from ogm_mcmc.ros.replay import Replay, ReplayCounts
from support.ros import spin_until

__all__ = [
    'Logs',
    'local_node',
    'odometry',
    'pose',
    'pose_stamped',
    'refusal',
    'replayed',
    'scan',
    'spinning',
    'spun_node',
    'tf2_msgs_stand_in',
    'tf2_msgs_twin',
    'transforms',
]


class Logs:
    """What a node logs, as (level, text)."""

    def __init__(self, node: Any) -> None:
        self.said: list[tuple[str, str]] = []
        self._levels = ('debug', 'info', 'warning', 'error', 'fatal')
        node.get_logger = lambda: self

    def __getattr__(self, level: str) -> Any:
        """Return what takes a line of a level."""
        if level not in self._levels:
            raise AttributeError(level)
        return lambda text: self.said.append((level, str(text)))

    def of(self, *levels: str) -> list[str]:
        """Return the lines of some levels."""
        return [text for level, text in self.said if level in levels]


@contextmanager
def local_node(
    make: Any = Node, name: str = 'local', *, ready: bool = True, **options: Any
) -> Iterator[Any]:
    """Make a node in a context of its own, `ready` to work; `node.until(condition)` spins it."""
    context = rclpy.context.Context()
    rclpy.init(context=context, args=[])
    node = (
        make(name, context=context, **options)
        if make is Node
        else make(context=context, **options)
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.until = lambda condition, timeout_s=10.0: spin_until(executor, condition, timeout_s)
    try:
        # One of ours compiles its kernels first, beside.
        node.until(lambda: not ready or getattr(node, 'working', True), 300.0)
        yield node
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


@contextmanager
def spinning(*nodes: Any) -> Iterator[None]:
    """Spin nodes of `local_node`, each in a thread of its own."""
    done = threading.Event()
    threads = [threading.Thread(target=node.until, args=(done.is_set, 300.0)) for node in nodes]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        done.set()
        for thread in threads:
            thread.join()


@contextmanager
def spun_node(make: Any, **parameters: Any) -> Iterator[Any]:
    """Make a node as `NodeProcess` does, but in this process, and spin it in a thread.

    It talks by DDS with the test's `Observer` all the same. A process costs two to five seconds of
    CPU time more, for imports and compiled kernels.
    """
    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    with (
        local_node(make, ready=False, parameter_overrides=overrides) as node,
        spinning(node),
    ):
        yield node


def replayed(bag: Any, observer: Any, timeout_s: float = 90.0, **settings: Any) -> ReplayCounts:
    """Replay a bag from this process while `observer` spins; return what was sent."""
    settings = {'rate': 0.0, 'wait': 200.0, 'wait_topics': 2, **settings}
    with spun_node(partial(Replay, Path(bag)), **settings) as node:
        player = threading.Thread(target=node.play)
        player.start()
        try:
            observer.until(lambda: not player.is_alive(), timeout_s)
        finally:
            node.stopped.set()
            player.join()
        assert not node.unheard
        return node.counts


def refusal(
    main: Callable[[list[str]], None], capfd: Any, *arguments: str, **parameters: Any
) -> str:
    """Start a node as its process does, in this one; return the one line that it ends with.

    A process costs two seconds of imports. `capfd` is pytest's: rcl prints by itself.
    """
    ros_args = [word for one in parameters.items() for word in ('-p', '{}:={}'.format(*one))]
    with pytest.raises(SystemExit) as left:
        main([*arguments, *(['--ros-args', *ros_args] if ros_args else [])])
    printed = ''.join(capfd.readouterr())
    assert left.value.code == 2, printed
    assert 'Traceback' not in printed
    errors = [line for line in printed.splitlines() if line.startswith('error: ')]
    assert len(errors) == 1, printed
    return errors[0]


@contextmanager
def tf2_msgs_stand_in(monkeypatch: Any) -> Iterator[None]:
    """Let `tf2_msgs` be found where it is not installed; nothing can be subscribed with it."""
    package, messages = ModuleType('tf2_msgs'), ModuleType('tf2_msgs.msg')
    messages.TFMessage = object  # type: ignore[attr-defined]
    package.msg = messages  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, 'tf2_msgs', package)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', messages)
    yield


@contextmanager
def tf2_msgs_twin(monkeypatch: Any) -> Iterator[None]:
    """Let a message of one transform stand for tf2_msgs/TFMessage, on the wire as well.

    No wheel holds tf2_msgs. With this one all else is as with the real one: topics, QoS, latching,
    frames, the tree.
    """
    one_of_one = property(lambda message: [message])
    monkeypatch.setattr(TransformStamped, 'transforms', one_of_one, raising=False)
    with tf2_msgs_stand_in(monkeypatch):
        sys.modules['tf2_msgs.msg'].TFMessage = TransformStamped  # type: ignore[attr-defined]
        yield


def _stamped(msg: Any, time_s: float, frame: str) -> Any:
    msg.header.frame_id = frame
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(round(time_s * 1e9), 10**9)
    return msg


def _fill(holder: Any, x: float, y: float, yaw: float) -> None:
    holder.position.x, holder.position.y = float(x), float(y)
    holder.orientation.z, holder.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)


def scan(time_s: float, ranges: Any = (1.0,), frame: str = 'laser', **fields: Any) -> LaserScan:
    """Return a scan; neighbouring beams are 90 degrees apart."""
    msg = LaserScan(range_min=0.05, range_max=5.0, angle_increment=math.pi / 2, **fields)
    msg.ranges = [float(one) for one in ranges]
    msg.angle_max = msg.angle_increment * (len(msg.ranges) - 1)
    return _stamped(msg, time_s, frame)


def pose(
    time_s: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, frame: str = 'map'
) -> Any:
    """Return a PoseWithCovarianceStamped."""
    msg = _stamped(PoseWithCovarianceStamped(), time_s, frame)
    _fill(msg.pose.pose, x, y, yaw)
    return msg


def pose_stamped(time_s: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Any:
    """Return a PoseStamped in the map."""
    msg = _stamped(PoseStamped(), time_s, 'map')
    _fill(msg.pose, x, y, yaw)
    return msg


def odometry(
    time_s: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, child: str = 'base_link'
) -> Any:
    """Return an Odometry in `odom`."""
    msg = _stamped(Odometry(child_frame_id=child), time_s, 'odom')
    _fill(msg.pose.pose, x, y, yaw)
    return msg


def transforms(*entries: tuple[Any, ...]) -> Any:
    """Return a message like TFMessage of (parent, child, time in s, x, y, yaw) each."""
    return SimpleNamespace(transforms=[_transform(*entry) for entry in entries])


def _transform(
    parent: str, child: str, time_s: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0
) -> Any:
    stamp = SimpleNamespace()
    stamp.sec, stamp.nanosec = divmod(round(time_s * 1e9), 10**9)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=parent),
        child_frame_id=child,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=0.0),
            rotation=SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)),
        ),
    )
