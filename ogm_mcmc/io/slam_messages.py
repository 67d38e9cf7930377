"""What SLAM systems tell of their graphs, as stamps and poses; imports no ROS.

slam_toolbox (since November 2025): `NewNodeEvent` names the stamp of a node once, `PoseGraph` the
poses of all nodes by id, again and again. Cartographer: the answer of `TrajectoryQuery` holds
poses with stamps.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.errors import PoseError
from ogm_mcmc.io.messages import read_path

__all__ = ['GraphNodes', 'read_trajectory_answer']


class GraphNodes:
    """Joins the stamps of nodes with their poses of today, by id."""

    def __init__(self) -> None:
        self._stamps: dict[int, Any] = {}

    def note(self, event: Any) -> None:
        """Note the stamp of a node (slam_toolbox/NewNodeEvent)."""
        self._stamps[int(event.new_node_id)] = event.stamp

    def read(self, graph: Any) -> tuple[Int64Array, Float64Array]:
        """Read a slam_toolbox/PoseGraph as `read_path` does a Path; nodes not noted are left out.

        Raises PoseError, also when no stamp of any node is known.
        """
        known = [node for node in graph.nodes if int(node.node_id) in self._stamps]
        if graph.nodes and not known:
            raise PoseError(
                f'{len(graph.nodes)} nodes without stamps: expected a new_node_event of each, so '
                'start before slam_toolbox'
            )
        posed = [_stamped(self._stamps[int(node.node_id)], node.pose) for node in known]
        return read_path(SimpleNamespace(poses=posed))

    def clear(self) -> None:
        """Forget all stamps."""
        self._stamps.clear()


def read_trajectory_answer(answer: Any) -> tuple[Int64Array, Float64Array]:
    """Read the answer of cartographer_ros_msgs/TrajectoryQuery as `read_path` does a Path.

    Raises PoseError, with what Cartographer says where it gives a reason.
    """
    if not answer.trajectory:
        said = str(getattr(answer.status, 'message', '')) or 'no pose'
        raise PoseError(f'trajectory_query: {said}: expected a trajectory')
    return read_path(SimpleNamespace(poses=answer.trajectory))


def _stamped(stamp: Any, pose: Any) -> SimpleNamespace:
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), pose=pose)
