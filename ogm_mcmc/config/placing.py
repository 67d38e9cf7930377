"""Settings of where a scan was taken: poses between messages, and where sensors are mounted."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ogm_mcmc.config.settings import check_bounds, setting
from ogm_mcmc.errors import require

__all__ = ['MountConfig', 'PlacingConfig']


@dataclass(frozen=True)
class MountConfig:
    """Where the sensor sits in the base frame; see `mount_source`."""

    x: float = setting(
        0.0, 'position of the sensor on the robot, forward, m', low=-100.0, high=100.0
    )
    y: float = setting(
        0.0, 'position of the sensor on the robot, to the left, m', low=-100.0, high=100.0
    )
    yaw: float = setting(0.0, 'heading of the sensor on the robot, rad', low=-6.2832, high=6.2832)
    upside_down: bool = setting(
        False, 'the sensor is mounted upside down: its angles run clockwise'
    )
    frames: str = setting(
        '',
        'other mounts by frame_id of the scan: FRAME X Y YAW; FRAME X Y YAW upside_down; ... '
        '(m, rad)',
    )

    def __post_init__(self) -> None:
        """Refuse frames that cannot be read."""
        self.named()

    def named(self) -> dict[str, tuple[float, float, float, bool]]:
        """Return x, y, yaw of the sensors that `frames` names, and which hang head down."""
        mounts = {}
        for entry in filter(None, map(str.strip, self.frames.split(';'))):
            frame, *numbers = entry.split()
            upside_down = numbers[3:] == ['upside_down']
            numbers = numbers[:3] if upside_down else numbers
            try:
                x, y, yaw = map(float, numbers)
            except ValueError:
                x = y = yaw = math.nan
            readable = len(numbers) == 3 and all(map(math.isfinite, (x, y, yaw)))
            require(readable, 'mount.frames', entry, 'expected FRAME X Y YAW')
            require(frame not in mounts, 'mount.frames', entry, 'expected each frame once')
            mounts[frame] = (x, y, yaw, upside_down)
        return mounts


@dataclass(frozen=True)
class PlacingConfig:
    """Where a scan was taken: poses between messages, and the sensor on the robot."""

    max_pose_gap: float = setting(
        2.0,
        'longest time between two poses that a pose is interpolated from, s',
        low=0.0,
        high=3600.0,
        live=True,
    )
    max_speed: float = setting(
        10.0,
        'a faster change between two poses is a jump of the localizer: scans between them are '
        'not used, m/s',
        low=0.01,
        high=1e6,
        live=True,
    )
    max_turn_rate: float = setting(
        10.0,
        'the same for turning, rad/s',
        low=0.01,
        high=1e6,
        live=True,
    )
    deskew: str = setting(
        'auto',
        'correct scans for the motion during a sweep: auto: if the scan has time_increment; on:'
        ' from scan_time too; off: all beams at the stamp of the scan',
        choices=('auto', 'on', 'off'),
    )
    no_return_code: float = setting(
        0.0,
        'laser readings of this value or more mean no return, whatever range_max is, m; 0: such a '
        'code is found from the scans; the value of range_max: there is no such code',
        low=0.0,
        high=10000.0,
        live=True,
    )
    mount: MountConfig = MountConfig()

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)
