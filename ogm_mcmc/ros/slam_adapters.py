"""Corrected trajectories of slam_toolbox and Cartographer, where their messages are installed.

Not run against either of them: only the joining of messages is tested.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.io.messages import frame_of
from ogm_mcmc.io.slam_messages import GraphNodes, read_trajectory_answer
from ogm_mcmc.ros import qos

__all__ = ['Take', 'check_installed', 'follow_cartographer', 'follow_slam_toolbox']

Read = Callable[[], tuple[Int64Array, Float64Array]]

Take = Callable[[str, Read], None]
"""Takes the frame of poses, and what reads them."""

ASK_EVERY_S = 5.0
PATIENCE = 3  # times to ask again that an answer may take


def check_installed(source: str) -> None:
    """Raise ConfigError when the messages of a `trajectory_source` are not installed."""
    if source == 'slam_toolbox':
        _slam_toolbox()
    elif source == 'cartographer':
        _cartographer()


def follow_slam_toolbox(node: Node, take: Take) -> None:
    """Subscribe to `new_node_event` and `pose_graph`. Raises ConfigError without its messages."""
    event, graph_type = _slam_toolbox()
    nodes = GraphNodes()
    node.create_subscription(event, 'new_node_event', nodes.note, qos.POSES)
    node.create_subscription(
        graph_type,
        'pose_graph',
        lambda graph: take(frame_of(graph), lambda: nodes.read(graph)),
        qos.LATEST,
    )


def follow_cartographer(node: Node, map_frame: str, take: Take, trajectory_id: int = 0) -> None:
    """Ask `trajectory_query` every five seconds. Raises ConfigError without its messages."""
    query = _cartographer()
    client = node.create_client(query, 'trajectory_query')
    asked: list[Any] = []  # the answer that is waited for
    waited = 0  # times it was due to ask since

    def read(future: Any) -> tuple[Int64Array, Float64Array]:
        if future.exception() is not None:
            raise PoseError(f'trajectory_query: {future.exception()}: expected an answer')
        return read_trajectory_answer(future.result())

    def ask() -> None:
        nonlocal waited
        waited += 1
        if asked and not asked[-1].done() and waited > PATIENCE:
            client.remove_pending_request(asked.pop())  # lost: no answer comes any more
        if client.service_is_ready() and (not asked or asked[-1].done()):
            waited = 0
            request = query.Request()
            request.trajectory_id = trajectory_id
            future = client.call_async(request)
            asked[:] = [future]
            future.add_done_callback(lambda done: take(map_frame, lambda: read(done)))

    node.create_timer(ASK_EVERY_S, ask, clock=Clock(clock_type=ClockType.STEADY_TIME))


def _slam_toolbox() -> tuple[Any, Any]:
    """Return the types of its messages about new nodes and of the graph."""
    try:
        from slam_toolbox.msg import NewNodeEvent, PoseGraph
    except ImportError as error:
        raise _missing('slam_toolbox', 'slam_toolbox of November 2025 or later', error) from error
    return NewNodeEvent, PoseGraph


def _cartographer() -> Any:
    """Return the type of its service."""
    try:
        from cartographer_ros_msgs.srv import TrajectoryQuery
    except ImportError as error:
        raise _missing('cartographer', 'cartographer_ros_msgs', error) from error
    return TrajectoryQuery


def _missing(source: str, needed: str, error: ImportError) -> ConfigError:
    return ConfigError(
        f'trajectory_source is {source!r}: expected {needed} installed ({error}), or path'
    )
