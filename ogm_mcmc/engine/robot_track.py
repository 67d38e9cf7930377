"""Where the robot was said to be whenever a scan was placed: 32 bytes a scan, kept or not.

A correction of the past needs what was said then, also of moments whose scans were let go.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array, Int64Array
from ogm_mcmc.geometry import Pose2D

__all__ = ['MOST_POSES', 'POSE_BYTES', 'RobotTrack', 'turned_back']

NS_PER_S = 1_000_000_000

MOST_POSES = 1_000_000
POSE_BYTES = 32

# Room at first.
FEW = 256

# Stamps that go back further than this are a restart (a bag played again).
RESTART_NS = NS_PER_S

# Steps between two scans that are longer are taken for jumps of the localizer. Robots that are
# faster jump all the time, which does no harm: corrections are interpolated then.
DRIVES_M_S = 1.5
DRIVES_RAD_S = 3.0
SLACK_M = 0.03
SLACK_RAD = 0.03


def turned_back(angle: Float64Array) -> Float64Array:
    """Return the same angles in [-pi, pi)."""
    wrapped: Float64Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped


class RobotTrack:
    """Stamps (N,) and poses (N, 3) in the order of time; at most `most` of them.

    Beyond that every second one of all goes: old and new ones lie a little further apart then.
    """

    def __init__(self, most: int = MOST_POSES) -> None:
        self.most = most
        self._stamps = np.empty(FEW, np.int64)
        self._poses = np.empty((FEW, 3))
        self._count = 0
        self._sorted = True

    def __len__(self) -> int:
        """Return the number of poses."""
        return self._count

    @property
    def n_bytes(self) -> int:
        """Memory that it takes, room for the next ones included."""
        return self._stamps.nbytes + self._poses.nbytes

    def add(self, stamp_ns: int, pose: Pose2D) -> None:
        """Note a pose; a stamp of long before the last one begins a new track."""
        n = self._count
        if n and stamp_ns < self._stamps[n - 1]:
            if stamp_ns < self._stamps[n - 1] - RESTART_NS:
                self.clear()
                n = 0
            else:
                self._sorted = False  # another sensor's scan was placed before this one
        if n == self._stamps.size:
            self._make_room()
            n = self._count
        self._stamps[n] = stamp_ns
        self._poses[n] = pose.x_m, pose.y_m, pose.yaw_rad
        self._count = n + 1

    def _make_room(self) -> None:
        if self._count >= self.most:
            stamps, poses = self.stamps[::2].copy(), self.poses[::2].copy()
            self._count = stamps.size
            self._stamps[: self._count], self._poses[: self._count] = stamps, poses
            return
        size = min(2 * self._count, max(self.most, self._count + 1))
        self._stamps = np.resize(self._stamps, size)
        self._poses = np.resize(self._poses, (size, 3))

    def _order(self) -> None:
        if not self._sorted:
            n = self._count
            order = np.argsort(self._stamps[:n], kind='stable')
            self._stamps[:n], self._poses[:n] = self._stamps[:n][order], self._poses[:n][order]
            self._sorted = True

    @property
    def stamps(self) -> Int64Array:
        """Stamps (N,), ns."""
        self._order()
        return self._stamps[: self._count]

    @property
    def poses(self) -> Float64Array:
        """Poses (N, 3): x, y, m, yaw, rad."""
        self._order()
        return self._poses[: self._count]

    def copy(self) -> RobotTrack:
        """Return the same track, which goes its own way from here."""
        copy = RobotTrack(self.most)
        copy._stamps, copy._poses = self.stamps.copy(), self.poses.copy()
        copy._count = self._count
        return copy

    def clear(self) -> None:
        """Forget everything."""
        self._count, self._sorted = 0, True

    def spans(self, stamps_ns: Int64Array) -> BoolArray:
        """Whether the track was under way at stamps (M,)."""
        if self._count == 0:
            return np.zeros(stamps_ns.size, bool)
        known: BoolArray = (stamps_ns >= self.stamps[0]) & (stamps_ns <= self.stamps[-1])
        return known

    def at(self, stamps_ns: Int64Array) -> Float64Array:
        """Return the poses (M, 3) at stamps within the track, interpolated."""
        stamps, poses = self.stamps, self.poses
        later = np.clip(np.searchsorted(stamps, stamps_ns), 1, max(stamps.size - 1, 1))
        if stamps.size == 1:
            return np.repeat(poses, stamps_ns.size, axis=0)
        before, after = poses[later - 1], poses[later]
        gap = np.maximum(stamps[later] - stamps[later - 1], 1)
        share = ((stamps_ns - stamps[later - 1]) / gap)[:, None]
        step = after - before
        step[:, 2] = turned_back(step[:, 2])
        found: Float64Array = before + share * step
        found[:, 2] = turned_back(found[:, 2])
        return found

    def pieces(self, stamps_ns: Int64Array) -> Int64Array:
        """Number the pieces that jumps cut the track into; return those of stamps (M,)."""
        stamps, poses = self.stamps, self.poses
        seconds = np.diff(stamps) / NS_PER_S
        step = np.diff(poses, axis=0)
        way, turn = np.hypot(step[:, 0], step[:, 1]), np.abs(turned_back(step[:, 2]))
        jumps = (way > SLACK_M + DRIVES_M_S * seconds) | (
            turn > SLACK_RAD + DRIVES_RAD_S * seconds
        )
        piece = np.concatenate(([0], np.cumsum(jumps)))
        index = np.clip(np.searchsorted(stamps, stamps_ns, side='right') - 1, 0, None)
        found: Int64Array = piece[index]
        return found
