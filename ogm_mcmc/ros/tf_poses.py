"""Poses and mounts from tf, where tf2_ros is installed."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.time import Time

from ogm_mcmc.engine.placing import Unplaceable, Waiting
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import Pose2D, PoseBelief, SensorMount, pose_from_quaternion

__all__ = ['TfTree']


class TfTree:
    """A tf buffer that answers in the types of `ogm_mcmc.geometry`.

    Raises ConfigError on construction where tf2_ros is missing (it is not on PyPI).
    """

    def __init__(self, node: Node, map_frame: str, base_frame: str) -> None:
        try:
            import tf2_ros
        except ImportError as error:
            raise ConfigError(
                'tf was asked for, but tf2_ros is not installed: '
                'choose another pose_source and mount_source, or install ros-jazzy-tf2-ros-py'
            ) from error
        self.map_frame = map_frame
        self.base_frame = base_frame
        self._missing = tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)

    def at(self, stamp_ns: int) -> PoseBelief:
        """Return the pose of the base in the map (`PoseSource`)."""
        if stamp_ns < 0:
            raise Unplaceable('pose_unavailable')
        try:
            transform = self._buffer.lookup_transform(
                self.map_frame, self.base_frame, Time(nanoseconds=stamp_ns)
            )
        except self._missing:
            newest = self._newest_ns()
            if newest is None or newest < stamp_ns:
                raise Waiting from None
            raise Unplaceable('pose_unavailable') from None
        pose, upside_down = _planar(transform)
        if upside_down:
            raise Unplaceable('pose_unusable')
        return PoseBelief(pose)

    def restart(self, stamp_ns: int) -> None:
        """Forget all transforms: time started again."""
        self._buffer.clear()

    def clear(self) -> None:
        """Keep what tf holds: it is not ours alone (`PoseSource`)."""

    def mount_of(self, sensor_frame: str) -> SensorMount | None:
        """Return where a sensor sits on the base, or None while tf does not know it."""
        try:
            transform = self._buffer.lookup_transform(self.base_frame, sensor_frame, Time())
        except self._missing:
            return None
        return SensorMount(*_planar(transform))

    def _newest_ns(self) -> int | None:
        try:
            latest = self._buffer.lookup_transform(self.map_frame, self.base_frame, Time())
        except self._missing:
            return None
        stamp = latest.header.stamp
        return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _planar(transform: Any) -> tuple[Pose2D, bool]:
    move, turn = transform.transform.translation, transform.transform.rotation
    return pose_from_quaternion((move.x, move.y), (turn.x, turn.y, turn.z, turn.w))
