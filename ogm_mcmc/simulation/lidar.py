"""A planar lidar: exact ranges to walls, then noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.simulation.wall_kernels import first_walls

__all__ = ['Lidar', 'check_errors', 'observed', 'true_ranges']


def true_ranges(walls: Float64Array, pose: Pose2D, bearings_rad: Float64Array) -> Float64Array:
    """Distance (B,), m, to the first wall (S, 4) along each bearing, inf where there is none."""
    ranges = np.empty(bearings_rad.size)
    walls, bearings = (np.ascontiguousarray(array, np.float64) for array in (walls, bearings_rad))
    first_walls(walls, pose.x_m, pose.y_m, pose.yaw_rad, bearings, ranges)
    return ranges


def observed(
    exact_m: Float64Array,
    rng: np.random.Generator,
    *,
    limits_m: tuple[float, float],
    noise_m: float,
    dropout: float,
    clutter: float,
) -> Float32Array:
    """Turn exact ranges (B,) into measured ones, as REP 117 has them.

    inf: nothing there; -inf: too near to measure; nan: return lost. `limits_m` are range_min and
    range_max, `clutter` and `dropout` shares of the readings.
    """
    nearest, furthest = limits_m
    ranges = exact_m + noise_m * rng.standard_normal(exact_m.size)
    ranges[ranges > furthest] = np.inf
    ranges[ranges < nearest] = -np.inf
    if clutter > 0.0:
        anything = rng.random(ranges.size) < clutter
        ranges[anything] = rng.uniform(nearest, furthest, anything.sum())
    ranges[rng.random(ranges.size) < dropout] = np.nan
    return ranges.astype(np.float32)


def check_errors(noise_m: float, dropout: float, clutter: float) -> None:
    """Refuse what `observed` cannot do. Raises ConfigError."""
    require(0.0 <= noise_m < math.inf, 'noise', noise_m, 'expected 0 or more')
    require(0.0 <= dropout < 1.0, 'dropout', dropout, 'must be in [0, 1)')
    require(0.0 <= clutter < 1.0, 'clutter', clutter, 'must be in [0, 1)')


@dataclass(frozen=True)
class Lidar:
    """Beams at equal angles; Gaussian range noise, a share of lost and of arbitrary returns.

    With a field of view of 2 pi the first beam points backwards and there is none twice;
    otherwise the first and the last one are its borders. `clutter` is the share of readings that
    are anything between range_min and range_max (people, dust, mixed pixels).
    """

    beams: int = 360
    range_min_m: float = 0.1
    range_max_m: float = 12.0
    noise_m: float = 0.01
    dropout: float = 0.002
    clutter: float = 0.0
    field_of_view_rad: float = 2.0 * math.pi

    def __post_init__(self) -> None:
        """Refuse what is no lidar."""
        require(0 < self.beams <= 100_000, 'beams', self.beams, 'expected 1 to 100000')
        valid = 0.0 <= self.range_min_m < self.range_max_m < math.inf
        require(valid, 'range_max', self.range_max_m, 'must be above range_min, and finite')
        check_errors(self.noise_m, self.dropout, self.clutter)
        view = self.field_of_view_rad
        require(0.0 < view <= 2.0 * math.pi, 'field_of_view', view, 'expected up to 2 pi')

    @property
    def angle_min_rad(self) -> float:
        """Bearing of the first beam, rad."""
        return -0.5 * self.field_of_view_rad

    @property
    def angle_increment_rad(self) -> float:
        """Angle between beams, rad."""
        all_around = self.field_of_view_rad == 2.0 * math.pi
        gaps = self.beams if all_around or self.beams == 1 else self.beams - 1
        return self.field_of_view_rad / gaps

    def bearings(self) -> Float64Array:
        """Bearings (B,), rad."""
        bearings: Float64Array = (
            np.arange(self.beams, dtype=np.float64) * self.angle_increment_rad + self.angle_min_rad
        )
        return bearings

    def measure(self, walls: Float64Array, pose: Pose2D, rng: np.random.Generator) -> Float32Array:
        """Measured ranges (B,) to walls that are segments, see `observe`."""
        return self.observe(true_ranges(walls, pose, self.bearings()), rng)

    def observe(self, exact_m: Float64Array, rng: np.random.Generator) -> Float32Array:
        """Turn exact ranges (B,) into measured ones, see `observed`."""
        return observed(
            exact_m,
            rng,
            limits_m=(self.range_min_m, self.range_max_m),
            noise_m=self.noise_m,
            dropout=self.dropout,
            clutter=self.clutter,
        )

    def scan(self, ranges_m: Float32Array, stamp_ns: int, frame_id: str = 'laser') -> Scan:
        """Return measured ranges as a scan."""
        return Scan.checked(
            ranges_m,
            angle_min_rad=self.angle_min_rad,
            angle_increment_rad=self.angle_increment_rad,
            range_min_m=self.range_min_m,
            range_max_m=self.range_max_m,
            stamp_ns=stamp_ns,
            frame_id=frame_id,
        )
