"""A planar lidar: exact ranges to walls, then noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import Pose2D

__all__ = ['Lidar', 'true_ranges']


def true_ranges(walls: Float64Array, pose: Pose2D, bearings_rad: Float64Array) -> Float64Array:
    """Distance (B,) to the first wall along each bearing, inf where there is none.

    Solves p + r d = a + s (b - a), 0 <= s <= 1, r > 0, for all beams and walls at once.
    """
    heading = pose.yaw_rad + bearings_rad
    dx, dy = np.cos(heading)[:, None], np.sin(heading)[:, None]
    ax, ay = walls[:, 0] - pose.x_m, walls[:, 1] - pose.y_m
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    across = dx * ey - dy * ex
    with np.errstate(divide='ignore', invalid='ignore'):
        distance = (ax * ey - ay * ex) / across
        along = (ax * dy - ay * dx) / across
    met = (across != 0.0) & (distance > 0.0) & (along >= 0.0) & (along <= 1.0)
    ranges: Float64Array = np.where(met, distance, np.inf).min(axis=1)
    return ranges


@dataclass(frozen=True)
class Lidar:
    """Beams at equal angles around, Gaussian range noise, a share of lost returns."""

    beams: int = 360
    range_min_m: float = 0.1
    range_max_m: float = 12.0
    noise_m: float = 0.01
    dropout: float = 0.002

    def __post_init__(self) -> None:
        """Refuse what is no lidar."""
        require(0 < self.beams <= 100_000, 'beams', self.beams, 'expected 1 to 100000')
        valid = 0.0 <= self.range_min_m < self.range_max_m < math.inf
        require(valid, 'range_max', self.range_max_m, 'must be above range_min, and finite')
        require(0.0 <= self.noise_m < math.inf, 'noise', self.noise_m, 'expected 0 or more')
        require(0.0 <= self.dropout < 1.0, 'dropout', self.dropout, 'must be in [0, 1)')

    @property
    def angle_increment_rad(self) -> float:
        """Angle between beams, rad; the first one points backwards."""
        return 2.0 * np.pi / self.beams

    def bearings(self) -> Float64Array:
        """Bearings (B,), rad."""
        bearings: Float64Array = (
            np.arange(self.beams, dtype=np.float64) * self.angle_increment_rad - np.pi
        )
        return bearings

    def measure(self, walls: Float64Array, pose: Pose2D, rng: np.random.Generator) -> Float32Array:
        """Measured ranges (B,) as REP 117 has them: inf, nothing there; nan, return lost."""
        ranges = true_ranges(walls, pose, self.bearings())
        ranges += self.noise_m * rng.standard_normal(ranges.size)
        ranges[ranges > self.range_max_m] = np.inf
        ranges[rng.random(ranges.size) < self.dropout] = np.nan
        return ranges.astype(np.float32)
