"""Where each sensor sits on the robot: by parameters that name a place, else by tf."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.placing import sensor_mount
from ogm_mcmc.engine.pose_history import Unplaceable, Waiting
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.engine.transform_tree import TransformError
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import SensorMount

__all__ = ['MountFound', 'Mounts', 'mounts_setting', 'names_a_place']

# At most this many lines about mounts are logged.
MAX_TOLD = 20

# Origins of mounts that are, or may be, another one at each stamp.
MOVES = 'tf, moving'
MOVING = ('tf', MOVES, 'topic')


class MountFound(NamedTuple):
    """What was decided about a sensor, for a line in the log.

    `origin`: `tf_static`, `tf` (sent again and again), `tf, moving`, `topic`, `parameters`, or
    empty where nothing says where it sits and it is taken to be at the origin of the base.
    """

    frame: str
    base_frame: str
    mount: SensorMount
    origin: str

    @property
    def moves(self) -> bool:
        """Whether a recording says that the sensor moves on the robot."""
        return self.origin == MOVES

    @property
    def guessed(self) -> bool:
        """Whether a sensor with a frame of its own is taken to be at the base."""
        return not self.origin and self.frame != self.base_frame

    @property
    def shown(self) -> bool:
        """Whether there is anything to tell: more than a sensor in the frame of the base."""
        return self.frame != self.base_frame or self.origin == 'parameters'

    def __str__(self) -> str:
        """Return one line for the user."""
        if self.guessed:
            frame = self.frame or '(no name)'
            return (
                f'sensor frame {frame} is not {self.base_frame}, and neither tf nor parameters '
                'say where it sits: taken as at its origin, not turned; expected a transform '
                f'{self.base_frame} -> {frame}, or mount.x, mount.y, mount.yaw'
            )
        pose = self.mount.pose
        return (
            f'{self.frame} on {self.base_frame} at {pose.x_m:g} {pose.y_m:g} m, turned by '
            f'{math.degrees(pose.yaw_rad):.4g} degrees'
            + (', upside down' if self.mount.upside_down else '')
            + (f' (from {self.origin})' if self.origin else '')
        )


class Mounts:
    """Mounts by frame and stamp; `tell` hears once of each sensor, and when one was moved.

    `source`: `auto` (parameters where they name a place for the frame, else tf, else the origin
    of the base), `tf`, `topic` (parameters likewise, else what comes on a topic of its own into
    `transforms`) or `parameters`. A frame that tf does not know is waited for, up to
    `patience_s` after its first scan. A mount that moves is that at the stamp.
    """

    def __init__(
        self,
        config: MountConfig,
        base_frame: str,
        *,
        source: str = 'auto',
        transforms: TfPoses | None = None,
        patience_s: float = 1.0,
        tell: Callable[[MountFound], None] = lambda found: None,
    ) -> None:
        self.config = config
        self.base_frame = base_frame
        self.source = source
        self.transforms = transforms
        self.patience_s = patience_s
        self.tell = tell
        self.faults: Recent[str] = Recent()  # what is wrong with the mount of a frame now
        self._first_s: Recent[float] = Recent()
        self._told: Recent[MountFound] = Recent()
        self._n_told = 0

    def at(self, frame: str, stamp_ns: int, now_s: float) -> SensorMount:
        """Return where the sensor of a frame sits; raises Waiting or Unplaceable."""
        named = names_a_place(self.config, frame)
        if self.source == 'parameters' or (self.source != 'tf' and named):
            origin = 'parameters' if named else ''
            return self._found(frame, sensor_mount(self.config, frame), origin)
        if self.transforms is None:
            return self._unknown(frame)
        try:
            mount = self.transforms.mount_at(frame, stamp_ns)
        except TransformError as error:
            if error.reason == 'late':
                raise Waiting from None
            if error.reason in ('early', 'gap'):
                raise Unplaceable('scan_no_mount') from None
            if frame not in self._first_s:
                self._first_s[frame] = now_s
            if now_s - self._first_s[frame] < self.patience_s:
                raise Waiting from None
            return self._unknown(frame)
        except PoseError as error:
            self.faults[frame] = str(error)
            raise Unplaceable('scan_bad_mount') from None
        self.faults.pop(frame, None)
        if self.source == 'topic':
            return self._found(frame, mount, 'topic')
        origin = 'tf_static'
        if self.transforms.mount_is_sent_again(frame):
            origin = MOVES if self.transforms.mount_moves(frame) else 'tf'
        return self._found(frame, mount, origin)

    def restart(self, stamp_ns: int) -> None:
        """Forget what moves ahead of a stamp: time started again there."""
        if self.transforms is not None:
            self.transforms.restart(stamp_ns)

    def stop_waiting(self) -> None:
        """Wait no longer for frames that tf does not know: too many scans do."""
        for frame in list(self._first_s):
            self._first_s[frame] = -math.inf

    def _unknown(self, frame: str) -> SensorMount:
        if self.source in ('tf', 'topic') and frame != self.base_frame:
            raise Unplaceable('scan_no_mount')
        return self._found(frame, SensorMount(), '')

    def _found(self, frame: str, mount: SensorMount, origin: str) -> SensorMount:
        before = self._told.get(frame)
        news = before is None or before.origin != origin
        moved = before is not None and origin not in MOVING and before.mount != mount
        if news or moved:
            self._told[frame] = found = MountFound(frame, self.base_frame, mount, origin)
            self._n_told += 1
            if self._n_told <= MAX_TOLD:
                self.tell(found)
        return mount


def mounts_setting(found: Iterable[MountFound]) -> str:
    """Return `mount.frames` for mounts that were found."""
    return '; '.join(
        f'{one.frame} {one.mount.pose.x_m:.6g} {one.mount.pose.y_m:.6g} '
        f'{one.mount.pose.yaw_rad:.6g}' + (' upside_down' if one.mount.upside_down else '')
        for one in found
        if one.frame
    )


@lru_cache(maxsize=64)
def names_a_place(config: MountConfig, frame: str) -> bool:
    """Return whether parameters say where the sensor of a frame sits: by name, or for all."""
    return frame in config.named() or replace(config, frames='') != MountConfig()
