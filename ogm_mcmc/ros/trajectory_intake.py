"""Corrected trajectories in: `trajectory`, a nav_msgs/Path whose poses carry their own stamps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nav_msgs.msg import Path
from rclpy.node import Node

from ogm_mcmc.engine.corrections import Corrected, Nodes
from ogm_mcmc.errors import GridError, PoseError
from ogm_mcmc.io import messages
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.pose_topics import AnyReliability
from ogm_mcmc.ros.scan_intake import ScanIntake
from ogm_mcmc.ros.slam_adapters import Read, follow_cartographer, follow_slam_toolbox

__all__ = ['TrajectoryIntake']


class TrajectoryIntake:
    """Receives and hands nodes to `apply`, which places scans anew and says how many.

    None of `apply`: that is said later, by setting `last`.
    What cannot be used is counted and warned about like any other message; so is a GridError of
    `apply`. Raises ConfigError when `trajectory_source` names a system whose messages are not
    installed.
    """

    def __init__(
        self, node: Node, intake: ScanIntake, apply: Callable[[Nodes], Corrected | None]
    ) -> None:
        self.intake = intake
        self.apply = apply
        self.received = 0
        self.last: Corrected | None = None
        self._topic: AnyReliability | None = None
        source = intake.settings.trajectory_source
        if source == 'slam_toolbox':
            follow_slam_toolbox(node, self.take)
        elif source == 'cartographer':
            follow_cartographer(node, intake.settings.map_frame, self.take)
        else:
            self._topic = AnyReliability(node, Path, 'trajectory', self.on_path, qos.LATEST)

    def adapt(self) -> None:
        """Listen as the publisher speaks."""
        if self._topic is not None:
            self._topic.adapt()

    def on_path(self, msg: Any) -> None:
        """Take a corrected trajectory."""
        self.take(messages.frame_of(msg), lambda: messages.read_path(msg))

    def take(self, frame: str, read: Read) -> None:
        """Take what `read` gives, poses in a frame."""
        self.received += 1
        problems, wanted = self.intake.problems, self.intake.settings.map_frame
        if frame != wanted:
            problems.warn(
                'trajectory_wrong_frame', f'trajectory in frame {frame!r}: expected {wanted!r}'
            )
            return
        try:
            corrected = self.apply(Nodes(*read()))
            self.last = corrected or self.last
        except PoseError as error:
            problems.warn('trajectory_invalid', f'trajectory dropped: {error}')
        except GridError as error:
            problems.warn('trajectory_off_map', f'trajectory dropped: {error}')

    def values(self) -> dict[str, object]:
        """Return what was corrected, for /diagnostics."""
        last = self.last
        values: dict[str, object] = {'trajectories received': self.received}
        if last is not None:
            values['scans covered by the last trajectory'] = last.covered
            values['scans placed anew by it'] = last.moved
            values['furthest move by it (m)'] = f'{last.furthest_m:.3f}'
        return values
