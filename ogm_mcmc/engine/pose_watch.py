"""What poses tell about their source: that they come rarely, and that the past was corrected."""

from __future__ import annotations

import math
from collections import deque

from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import Pose2D, wrap_angle
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

__all__ = ['Corrections', 'RarePoses']

# Poses that come less often leave open how the robot went, if it moved.
RARE_S = 0.5
MOVED_M = 0.05
MOVED_RAD = 0.05

# So many steps of a moving robot are needed to tell.
ENOUGH = 5

# A turn moves walls this far away.
REACH_M = 3.0


class RarePoses:
    """Tells once when the poses of a moving robot come rarely."""

    def __init__(self) -> None:
        self._last: tuple[int, Pose2D] | None = None
        self._steps: deque[tuple[float, float]] = deque(maxlen=ENOUGH)
        self._told = False

    def add(self, stamp_ns: int, pose: Pose2D) -> str:
        """Take a pose; return a line for the user, empty most of the time."""
        last, self._last = self._last, (stamp_ns, pose)
        if last is None or self._told:
            return ''
        apart_s = (stamp_ns - last[0]) / 1e9
        way_m, turn_rad = _motion(last[1], pose)
        if apart_s <= 0.0 or (way_m < MOVED_M and turn_rad < MOVED_RAD):
            return ''
        self._steps.append((apart_s, way_m))
        times, ways = (sorted(values) for values in zip(*self._steps, strict=True))
        middle = len(times) // 2
        if len(times) < ENOUGH or times[middle] <= RARE_S:
            return ''
        self._told = True
        return (
            f'poses come every {times[middle]:.1f} s, and the robot moves {ways[middle]:.2f} m '
            'between them: scans are placed on the straight way from one to the next; with a '
            'localizer that publishes tf (amcl, slam_toolbox) set pose_source to tf'
        )


class Corrections:
    """Notices when a localizer moves the odometry in the map: older scans may lie wrong."""

    def __init__(self, tree: TransformTree, map_frame: str, base_frame: str) -> None:
        self.tree = tree
        self.map_frame = map_frame
        self.base_frame = base_frame
        self._last: Recent[RigidTransform] = Recent()  # by child

    def add(self, entry: StampedTransform, limit_m: float) -> str:
        """Take a transform of tf; return a line for the user where it is a correction.

        What counts is how far it moves the robot, or a wall 3 m from it, at once. With a limit
        of 0 nothing counts.
        """
        child = entry.child
        if entry.parent != self.map_frame or child == self.base_frame:
            return ''
        last = self._last.get(child)
        self._last[child] = entry.transform
        if last is None or last == entry.transform or limit_m <= 0.0:
            return ''
        if child not in self.tree.ancestors(self.base_frame):
            return ''
        before, after = self._base_by(child, last), self._base_by(child, entry.transform)
        if before is None or after is None:
            return ''
        way_m, turn_rad = _motion(before, after)
        if way_m + REACH_M * turn_rad <= limit_m:
            return ''
        return (
            f'{entry.parent} -> {child} moved the robot by {way_m:.2f} m and '
            f'{math.degrees(turn_rad):.1f} degrees at once: scans mapped before may lie wrong; '
            'a corrected trajectory on the topic trajectory moves them (online_mapper: with '
            'keep_scans)'
        )

    def _base_by(self, child: str, in_map: RigidTransform) -> Pose2D | None:
        """Return the newest place of the base if the odometry lies there in the map."""
        try:
            newest_ns = self.tree.newest_common_ns(child, self.base_frame)
            if newest_ns is None:
                return None
            return in_map.compose(self.tree.lookup(child, self.base_frame, newest_ns)).planar()[0]
        except PoseError:
            return None


def _motion(earlier: Pose2D, later: Pose2D) -> tuple[float, float]:
    way_m = math.hypot(later.x_m - earlier.x_m, later.y_m - earlier.y_m)
    return way_m, abs(wrap_angle(later.yaw_rad - earlier.yaw_rad))
