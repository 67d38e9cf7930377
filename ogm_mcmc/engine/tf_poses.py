"""Poses and mounts from a tree of transforms, in the types of `ogm_mcmc.geometry`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ogm_mcmc.engine.pose_history import Unplaceable, Waiting
from ogm_mcmc.engine.transform_tree import Edge, TransformError, TransformTree, along
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import Pose2D, PoseBelief, SensorMount
from ogm_mcmc.geometry.motion import MAX_SPEED_M_S, MAX_TURN_RAD_S, jumps

__all__ = ['TfFrames', 'TfPoses', 'guess_frames']

NS_PER_S = 1_000_000_000

# What the base of a robot is called (REP 105), the likeliest first.
BASE_NAMES = ('base_link', 'base_footprint')


class TfPoses:
    """Poses of the base in the map (a `PoseSource`), and mounts of sensors on the base.

    The tree is fed by whoever owns it, all at once or message by message. A stamp that an edge
    has not reached yet is worth waiting for, one before its first entry or in a gap is not. A
    scan waits for the mounts of `sensor_frames` as well, which matters where they move.
    `complete`: the tree holds all there will ever be.

    Poses that come rarely are not held: amcl_pose says nothing while the robot moves up to
    0.25 m, so a scan there would be misplaced by as much; map -> odom -> base knows better.
    """

    def __init__(
        self,
        tree: TransformTree,
        map_frame: str,
        base_frame: str,
        *,
        sensor_frames: Iterable[str] = (),
        complete: bool = False,
        max_gap_s: float = 2.0,
        max_speed_m_s: float = MAX_SPEED_M_S,
        max_turn_rad_s: float = MAX_TURN_RAD_S,
    ) -> None:
        self.tree = tree
        self.map_frame = map_frame
        self.base_frame = base_frame
        self.sensor_frames = tuple(sensor_frames)
        self.complete = complete
        self.max_gap_ns = round(max_gap_s * NS_PER_S)
        self.max_speed_m_s = max_speed_m_s
        self.max_turn_rad_s = max_turn_rad_s
        self._moving: dict[str, bool] = {}

    def at(self, stamp_ns: int) -> PoseBelief:
        """Return the pose of the base in the map; raises Waiting or Unplaceable."""
        for frame in self.sensor_frames:
            self._wait_for(self.base_frame, frame, stamp_ns)
        edges = self._edges(self.map_frame, self.base_frame, stamp_ns)
        try:
            pose, upside_down = along(edges).planar()
            if upside_down:
                raise Unplaceable('pose_unusable')
            if self._jumps(edges) or self._is_stray(edges, stamp_ns, pose):
                raise Unplaceable('pose_jump')
        except PoseError:
            raise Unplaceable('pose_unusable') from None
        return PoseBelief(pose)

    def why_not(self, stamp_ns: int) -> str:
        """Return what is missing for a pose at a stamp; empty where nothing is."""
        gap_ns = self.max_gap_ns
        return self.tree.why_not(self.map_frame, self.base_frame, stamp_ns, max_gap_ns=gap_ns)

    def stands_at(self, belief: PoseBelief, stamp_ns: int) -> bool:
        """Return False: a transform that does not come says nothing."""
        return False

    def restart(self, stamp_ns: int) -> None:
        """Forget what moves where it lies ahead of a stamp: time started again there."""
        self.tree.restart(stamp_ns)

    def clear(self) -> None:
        """Keep what the tree holds: it is not ours alone (`PoseSource`)."""

    def mount_at(self, sensor_frame: str, stamp_ns: int) -> SensorMount:
        """Return where a sensor sits on the base at a stamp.

        In a recording, one that is sent again and again but never moves holds always. Raises
        TransformError where tf does not say, and PoseError for a sensor that is not level
        with the base.
        """
        try:
            mount = self.tree.lookup(
                self.base_frame, sensor_frame, stamp_ns, max_gap_ns=self.max_gap_ns
            )
        except TransformError:
            held = None
            if self.complete:
                held = self.tree.constant(self.base_frame, sensor_frame)
            if held is None:
                raise
            mount = held
        try:
            return SensorMount(*mount.planar())
        except PoseError as error:
            raise PoseError(f'{sensor_frame} on {self.base_frame}: {error}') from error

    def mount_is_sent_again(self, sensor_frame: str) -> bool:
        """Return whether a sensor might move on the base: its place is sent again and again."""
        return self.tree.moves(self.base_frame, sensor_frame)

    def mount_moves(self, sensor_frame: str) -> bool:
        """Return whether a sensor is known to move on the base: all there will ever be says so."""
        if not self.complete:
            return False
        if sensor_frame not in self._moving:  # looks at every entry: once
            again = self.mount_is_sent_again(sensor_frame)
            constant = again and self.tree.constant(self.base_frame, sensor_frame) is not None
            self._moving[sensor_frame] = again and not constant
        return self._moving[sensor_frame]

    def _wait_for(self, target: str, source: str, stamp_ns: int) -> None:
        newest_ns = self.tree.newest_common_ns(target, source)
        if newest_ns is None or newest_ns < stamp_ns:
            raise Waiting

    def _edges(self, target: str, source: str, stamp_ns: int) -> list[Edge]:
        try:
            return self.tree.edges(target, source, stamp_ns, max_gap_ns=self.max_gap_ns)
        except TransformError as error:
            if error.reason == 'early':
                raise Unplaceable('scan_before_poses') from None
            if error.reason == 'gap':
                raise Unplaceable('pose_gap') from None
            self._wait_for(target, source, stamp_ns)
            raise Unplaceable('pose_unavailable') from None

    def _is_stray(self, edges: list[Edge], stamp_ns: int, pose: Pose2D) -> bool:
        """Return whether an entry at the very stamp jumps, and the next one jumps again.

        Raises Waiting, with the pose there, while the next one is not known.
        """
        if all(edge.around.apart_ns or not self.tree.is_moving(edge.child) for edge in edges):
            return False
        try:
            before = self.tree.edges(self.map_frame, self.base_frame, stamp_ns - 1)
        except TransformError:
            return False
        if not self._jumps(before):
            return False
        try:
            after = self.tree.edges(self.map_frame, self.base_frame, stamp_ns + 1)
        except TransformError:
            raise Waiting(PoseBelief(pose)) from None
        return self._jumps(after)

    def _jumps(self, edges: list[Edge]) -> bool:
        """Return whether what one edge did around the stamp moves the base too fast.

        Each edge is judged by itself over its own two entries, with the others as they are at
        the stamp: a small turn of map -> odom far from its origin moves odom a long way and the
        base hardly.
        """
        for k, (child, around, up) in enumerate(edges):
            if around.later is around.earlier:
                continue
            ends: list[Pose2D] = []
            for transform in (around.earlier, around.later):
                held = around._replace(earlier=transform, later=transform)
                ends.append(
                    along([*edges[:k], Edge(child, held, up), *edges[k + 1 :]]).planar()[0]
                )
            if jumps(ends[0], ends[1], around.apart_ns, self.max_speed_m_s, self.max_turn_rad_s):
                return True
        return False


class TfFrames(NamedTuple):
    """The frames to take poses between."""

    map_frame: str
    base_frame: str


def guess_frames(
    tree: TransformTree, sensor_frame: str, *, map_frame: str = '', base_frame: str = ''
) -> TfFrames | None:
    """Return the map's and the base's frame above a sensor, by their names and what moves.

    Names given are taken as they are. Base: `base_link`, else `base_footprint` (with any prefix
    before a slash), else the last frame of those that move one in another from the root down:
    which one it is does not matter to where the sensor is. Map: `map` (likewise), else the root.
    None where nothing lies above the base.
    """
    chain = tree.ancestors(sensor_frame)  # the sensor first, the root last
    base = base_frame or next((found for name in BASE_NAMES if (found := _named(chain, name))), '')
    if not base:
        below_root = chain[::-1][1:]
        still = (k for k, frame in enumerate(below_root) if not tree.is_moving(frame))
        base = chain[::-1][next(still, len(below_root))]
    above = tree.ancestors(base)[1:]
    target = map_frame or _named(above, 'map') or (above[-1] if above else '')
    if not target:
        return None
    return TfFrames(target, base)


def _named(chain: list[str], name: str) -> str:
    return next((frame for frame in chain if frame.rsplit('/')[-1] == name), '')
