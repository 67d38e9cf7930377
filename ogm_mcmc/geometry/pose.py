"""Poses in the plane and beliefs about them.

A pose `Pose2D` says where frame B lies in frame A; `a_from_b.compose(b_from_c)` chains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import PoseError

__all__ = [
    'FURTHEST_M',
    'Pose2D',
    'PoseBelief',
    'PoseSamples',
    'interpolate',
    'pose_from_quaternion',
    'wrap_angle',
]

# A planar scan taken by a sensor tilted further than this is not a scan of the plane any more.
MAX_TILT_RAD = math.radians(10.0)

# No robot is further from the origin of its map, be that the equator: UTM counts north from there.
FURTHEST_M = 1e7


def wrap_angle(angle_rad: float) -> float:
    """Return the same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(frozen=True, slots=True)
class Pose2D:
    """Position in metres and heading in radians, counter-clockwise."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a place."""
        if not (
            math.isfinite(self.x_m) and math.isfinite(self.y_m) and math.isfinite(self.yaw_rad)
        ):
            raise PoseError(
                f'pose ({self.x_m}, {self.y_m}, {self.yaw_rad}): expected finite numbers'
            )

    def compose(self, other: Pose2D) -> Pose2D:
        """Return the pose of C in A from self (B in A) and other (C in B)."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Pose2D(
            self.x_m + cosine * other.x_m - sine * other.y_m,
            self.y_m + sine * other.x_m + cosine * other.y_m,
            wrap_angle(self.yaw_rad + other.yaw_rad),
        )

    def inverse(self) -> Pose2D:
        """Return the pose of A in B."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Pose2D(
            -cosine * self.x_m - sine * self.y_m,
            sine * self.x_m - cosine * self.y_m,
            wrap_angle(-self.yaw_rad),
        )


def interpolate(earlier: Pose2D, later: Pose2D, fraction: float) -> Pose2D:
    """Return the pose at a fraction (0 to 1) of the way, yaw the short way round."""
    turn = wrap_angle(later.yaw_rad - earlier.yaw_rad)
    return Pose2D(
        earlier.x_m + fraction * (later.x_m - earlier.x_m),
        earlier.y_m + fraction * (later.y_m - earlier.y_m),
        wrap_angle(earlier.yaw_rad + fraction * turn),
    )


class PoseSamples(NamedTuple):
    """A belief as weighted samples: poses (M, 3) x, y, yaw in m and rad; weights (M,), sum 1."""

    poses: Float64Array
    weights: Float64Array

    @classmethod
    def checked(cls, poses: AnyArray, weights: AnyArray | None = None) -> PoseSamples:
        """Validate and normalise; equal weights when none are given.

        Raises PoseError when empty, not finite, or with weights that cannot be normalised.
        """
        array = np.ascontiguousarray(poses, dtype=np.float64).reshape(-1, 3)
        if array.shape[0] == 0:
            raise PoseError('particles: expected at least one, got none')
        if not np.isfinite(array).all():
            raise PoseError('particles: expected finite poses')
        if weights is None:
            return cls(array, np.full(array.shape[0], 1.0 / array.shape[0]))
        weight = np.ascontiguousarray(weights, dtype=np.float64)
        total = float(weight.sum())
        if weight.shape != array.shape[:1] or not math.isfinite(total) or total <= 0.0:
            raise PoseError(f'weights: expected one per particle and a positive sum, got {total}')
        if weight.min() < 0.0:
            raise PoseError(f'weights: expected none below 0, got {weight.min()}')
        return cls(array, weight / total)

    def mean(self) -> Pose2D:
        """Weighted mean; the heading is the direction of the mean unit vector."""
        x, y = self.weights @ self.poses[:, :2]
        yaw = self.poses[:, 2]
        heading = math.atan2(self.weights @ np.sin(yaw), self.weights @ np.cos(yaw))
        return Pose2D(float(x), float(y), heading)

    def covariance(self) -> Float64Array:
        """Weighted covariance (3, 3) around the mean, yaw differences the short way round."""
        mean = self.mean()
        difference = self.poses - (mean.x_m, mean.y_m, mean.yaw_rad)
        difference[:, 2] = (difference[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        covariance: Float64Array = (difference * self.weights[:, None]).T @ difference
        return covariance

    def moved(self, by: Pose2D) -> PoseSamples:
        """Return the samples composed with a pose each carries (sensor on robot)."""
        cosine, sine = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        poses = self.poses.copy()
        poses[:, 0] += cosine * by.x_m - sine * by.y_m
        poses[:, 1] += sine * by.x_m + cosine * by.y_m
        poses[:, 2] = (poses[:, 2] + by.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        return PoseSamples(poses, self.weights)


class PoseBelief(NamedTuple):
    """What is believed of one pose: its mean and, where known, covariance or particles.

    `offset` is where that frame sits in the one the localizer spoke of: the sensor on the robot.
    """

    mean: Pose2D
    covariance: Float64Array | None = None
    particles: PoseSamples | None = None
    offset: Pose2D = Pose2D()

    def moved(self, by: Pose2D) -> PoseBelief:
        """Return the belief about a frame fixed to this one (the sensor on the robot)."""
        mean = self.mean.compose(by)
        covariance = self.covariance
        if covariance is not None:
            # First order: a turn of the robot swings the sensor sideways.
            swing = np.eye(3)
            swing[0, 2] = self.mean.y_m - mean.y_m
            swing[1, 2] = mean.x_m - self.mean.x_m
            covariance = swing @ covariance @ swing.T
        particles = None if self.particles is None else self.particles.moved(by)
        return PoseBelief(mean, covariance, particles, self.offset.compose(by))

    def of_robot(self) -> PoseBelief:
        """Return the belief about the frame the localizer spoke of."""
        return self.moved(self.offset.inverse())

    def carried_to(self, mean: Pose2D) -> PoseBelief:
        """Return the belief as one body set elsewhere: doubt keeps its shape and turns along."""
        step = mean.compose(self.mean.inverse())
        cosine, sine = math.cos(step.yaw_rad), math.sin(step.yaw_rad)
        covariance, particles = self.covariance, None
        if covariance is not None:
            turn = np.array([(cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)])
            covariance = turn @ covariance @ turn.T
        if self.particles is not None:
            old = self.particles.poses
            poses = np.empty_like(old)
            poses[:, 0] = step.x_m + cosine * old[:, 0] - sine * old[:, 1]
            poses[:, 1] = step.y_m + sine * old[:, 0] + cosine * old[:, 1]
            poses[:, 2] = (old[:, 2] + step.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
            particles = PoseSamples(poses, self.particles.weights)
        return PoseBelief(mean, covariance, particles, self.offset)


def pose_from_quaternion(
    position: tuple[float, float], quaternion: tuple[float, float, float, float]
) -> tuple[Pose2D, bool]:
    """Return the planar pose and whether the frame is upside down; quaternion is x, y, z, w.

    Raises PoseError for a quaternion of length far from 1 or a frame tilted out of the plane.
    """
    x, y, z, w = quaternion
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0.99 < norm < 1.01:
        raise PoseError(f'quaternion ({x}, {y}, {z}, {w}): expected unit length, got {norm:.3g}')
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    up = 1.0 - 2.0 * (x * x + y * y)
    if abs(up) < math.cos(MAX_TILT_RAD):
        tilt = math.degrees(math.acos(abs(up)))
        raise PoseError(
            f'orientation is tilted by {tilt:.0f} degrees: expected a frame level with the map'
        )
    yaw = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return Pose2D(position[0], position[1], yaw), up < 0.0
