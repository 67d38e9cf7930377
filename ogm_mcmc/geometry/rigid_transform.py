"""Transforms in space, as tf has them: translation and unit quaternion.

Chains of frames are multiplied in space and only their product is projected to the plane: a laser
that hangs head down on a tilted arm may yet be level. Plain floats: a scan needs a handful of
products, and arrays of three numbers are slower than the numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry.pose import Pose2D, pose_from_quaternion

__all__ = ['RigidTransform', 'StampedTransform']

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

# Quaternions of messages are of unit length but for so much (tf2 refuses others as well).
LENGTH_SLACK = 0.01

# Below this angle between quaternions the sine of slerp loses more than the straight line does.
SMALL_RAD = 1e-6


class RigidTransform(NamedTuple):
    """Where frame B lies in frame A: translation in m, unit quaternion x, y, z, w."""

    translation: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def checked(cls, translation: Vector, quaternion: Quaternion) -> RigidTransform:
        """Validate and normalise; raises PoseError for numbers that are no transform."""
        if not all(map(math.isfinite, (*translation, *quaternion))):
            raise PoseError(f'transform {translation} {quaternion}: expected finite numbers')
        norm = math.hypot(*quaternion)
        if abs(norm - 1.0) > LENGTH_SLACK:
            raise PoseError(f'quaternion {quaternion}: expected unit length, got {norm:.3g}')
        x, y, z, w = quaternion
        return cls(translation, (x / norm, y / norm, z / norm, w / norm))

    def compose(self, other: RigidTransform) -> RigidTransform:
        """Return the transform of C in A from self (B in A) and other (C in B)."""
        x, y, z = _rotated(self.quaternion, other.translation)
        tx, ty, tz = self.translation
        return RigidTransform(
            (tx + x, ty + y, tz + z), _product(self.quaternion, other.quaternion)
        )

    def inverse(self) -> RigidTransform:
        """Return the transform of A in B."""
        qx, qy, qz, qw = self.quaternion
        back = (-qx, -qy, -qz, qw)
        x, y, z = _rotated(back, self.translation)
        return RigidTransform((-x, -y, -z), back)

    def towards(self, later: RigidTransform, fraction: float) -> RigidTransform:
        """Return what lies a fraction (0 to 1) of the way to another, as tf2 interpolates.

        The translation goes straight, the orientation at an even rate the short way round.
        """
        ax, ay, az = self.translation
        bx, by, bz = later.translation
        straight = (
            ax + fraction * (bx - ax),
            ay + fraction * (by - ay),
            az + fraction * (bz - az),
        )
        return RigidTransform(straight, _slerp(self.quaternion, later.quaternion, fraction))

    def planar(self) -> tuple[Pose2D, bool]:
        """Return the pose in the plane and whether the frame is upside down.

        Raises PoseError for a frame tilted out of the plane.
        """
        return pose_from_quaternion(self.translation[:2], self.quaternion)


class StampedTransform(NamedTuple):
    """One entry of tf: the child frame in the parent frame at a stamp, ns."""

    parent: str
    child: str
    stamp_ns: int
    transform: RigidTransform


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _rotated(quaternion: Quaternion, vector: Vector) -> Vector:
    qx, qy, qz, qw = quaternion
    x, y, z = vector
    # v + 2 w (q x v) + 2 q x (q x v)
    cx, cy, cz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    return (
        x + qw * cx + qy * cz - qz * cy,
        y + qw * cy + qz * cx - qx * cz,
        z + qw * cz + qx * cy - qy * cx,
    )


def _slerp(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if cosine < 0.0 else 1.0  # q and -q are the same turn
    angle = math.acos(min(abs(cosine), 1.0))
    if angle < SMALL_RAD:
        to_a, to_b = 1.0 - fraction, sign * fraction
    else:
        sine = math.sin(angle)
        to_a = math.sin((1.0 - fraction) * angle) / sine
        to_b = sign * math.sin(fraction * angle) / sine
    x, y, z, w = (to_a * p + to_b * q for p, q in zip(a, b, strict=True))
    norm = math.hypot(x, y, z, w)
    return (x / norm, y / norm, z / norm, w / norm)
