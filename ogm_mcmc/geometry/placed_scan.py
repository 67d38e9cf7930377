"""A scan and what is believed of the pose its sensor had: what every mapper and judge takes.

There are two doors: a node's intake and the reader of bags. Both know where the robot was and
how the sensor sits on it, and call `PlacedScan.on_robot`; nothing downstream knows of mounts.
The simulator makes placed scans of its own, whose sensor sits at the robot's origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.geometry.pose import Pose2D, PoseBelief
from ogm_mcmc.geometry.scan import Scan

__all__ = ['PlacedScan', 'SensorMount']


# Bytes of the objects of a placed scan without its arrays, and of an array without its numbers.
OBJECTS = 700
ARRAY = 112


@dataclass(frozen=True, slots=True)
class SensorMount:
    """Where the sensor sits on the robot; upside down means its bearings run clockwise."""

    pose: Pose2D = Pose2D()  # noqa: RUF009 - frozen
    upside_down: bool = False


class PlacedScan(NamedTuple):
    """An upright scan and the belief about the pose of its sensor in the map, at its stamp."""

    scan: Scan
    belief: PoseBelief

    @property
    def pose(self) -> Pose2D:
        """The mean of the belief."""
        return self.belief.mean

    @property
    def n_bytes(self) -> int:
        """Memory that it takes, about; with all arrays, also those that others share."""
        bearings, (_, covariance, particles, _) = self.scan.bearings_rad, self.belief
        arrays: list[AnyArray] = [self.scan.ranges_m]
        arrays.extend(array for array in (bearings, covariance) if array is not None)
        if particles is not None:
            arrays.extend(particles)
        return OBJECTS + sum(array.nbytes + ARRAY for array in arrays)

    def along(self, beams: AnyArray, lengths_m: Float64Array) -> Float64Array:
        """Return the points (2, ...) at so many metres (...) along beams of these indices, m."""
        x_m, y_m = lengths_m * self.ways(beams)
        return np.stack((self.pose.x_m + x_m, self.pose.y_m + y_m))

    def ways(self, beams: AnyArray) -> Float64Array:
        """Return which way beams of these indices look in the map: unit vectors (2, ...)."""
        angles = self.pose.yaw_rad + self.scan.bearings()[beams]
        return np.stack((np.cos(angles), np.sin(angles)))

    def thinned(self, stride: int) -> PlacedScan:
        """Return every `stride`-th beam, the first among them; with 1 the scan itself."""
        return self if stride == 1 else self._replace(scan=self.scan.thinned(stride))

    @classmethod
    def at(cls, scan: Scan, pose: Pose2D) -> PlacedScan:
        """Place a scan whose sensor's pose is known."""
        return cls(scan, PoseBelief(pose))

    @classmethod
    def on_robot(
        cls, scan: Scan, robot: PoseBelief, mount: SensorMount | None = None
    ) -> PlacedScan:
        """Place a scan by the belief about the robot and where the sensor sits on it."""
        if mount is None or mount == SensorMount():
            return cls(scan, robot)
        return cls(scan.flipped() if mount.upside_down else scan, robot.moved(mount.pose))
