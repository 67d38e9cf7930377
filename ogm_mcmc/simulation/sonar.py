"""A ring of sonars: each returns the nearest wall anywhere in its cone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.simulation.lidar import true_ranges

__all__ = ['SonarReading', 'SonarRing']

RAYS_PER_RADIAN = 60.0


class SonarReading(NamedTuple):
    """One reading as a scan of one cone, and where its sonar truly was."""

    scan: Scan
    sonar: Pose2D


@dataclass(frozen=True)
class SonarRing:
    """Sonars at equal angles on a circle around the robot, looking outwards."""

    sonars: int = 16
    radius_m: float = 0.2
    field_of_view_rad: float = 0.4
    range_min_m: float = 0.05
    range_max_m: float = 4.0
    noise_m: float = 0.02

    def __post_init__(self) -> None:
        """Refuse what is no ring of sonars."""
        require(0 < self.sonars <= 1000, 'sonars', self.sonars, 'expected 1 to 1000')
        cone = 0.0 < self.field_of_view_rad < math.pi
        require(cone, 'field_of_view', self.field_of_view_rad, 'expected 0 to pi')
        valid = 0.0 <= self.range_min_m < self.range_max_m < math.inf
        require(valid, 'range_max', self.range_max_m, 'must be above range_min, and finite')

    def mounts(self) -> dict[str, Pose2D]:
        """Return where each sonar sits on the robot, by frame."""
        turns = np.arange(self.sonars) * (2.0 * math.pi / self.sonars)
        return {
            f'sonar_{k}': Pose2D(
                self.radius_m * math.cos(turn), self.radius_m * math.sin(turn), float(turn)
            )
            for k, turn in enumerate(turns)
        }

    def mounts_setting(self) -> str:
        """Return the mounts as the parameter `mount.frames` takes them."""
        return '; '.join(
            f'{frame} {pose.x_m:.6f} {pose.y_m:.6f} {pose.yaw_rad:.6f}'
            for frame, pose in self.mounts().items()
        )

    def measure(
        self, walls: Float64Array, robot: Pose2D, rng: np.random.Generator, stamp_ns: int = 0
    ) -> Iterator[SonarReading]:
        """Yield a reading of every sonar; inf where no wall is near enough."""
        half = 0.5 * self.field_of_view_rad
        bearings = np.linspace(-half, half, 2 + math.ceil(RAYS_PER_RADIAN * 2.0 * half))
        for frame, mount in self.mounts().items():
            sonar = robot.compose(mount)
            nearest = float(true_ranges(walls, sonar, bearings).min())
            reading = nearest + self.noise_m * float(rng.standard_normal())
            scan = Scan.checked(
                np.array([reading if reading < self.range_max_m else math.inf]),
                angle_min_rad=0.0,
                angle_increment_rad=0.0,
                range_min_m=self.range_min_m,
                range_max_m=self.range_max_m,
                stamp_ns=stamp_ns,
                frame_id=frame,
                beam_width_rad=self.field_of_view_rad,
            )
            yield SonarReading(scan, sonar)
