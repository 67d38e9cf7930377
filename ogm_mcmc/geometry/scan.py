"""One laser scan."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, Float64Array
from ogm_mcmc.errors import ScanError

__all__ = ['Remark', 'Scan', 'beam_directions', 'say_nothing']

# Beams may go round once; the last one may meet the first.
WIDEST_SPAN_RAD = 2.0 * math.pi + 0.1

# No planar lidar takes longer for a sweep.
LONGEST_SWEEP_S = 10.0

Remark = Callable[[str], object]


def say_nothing(text: str) -> None:
    """Take a remark and forget it."""


@lru_cache(maxsize=32)
def beam_directions(angle_min_rad: float, angle_increment_rad: float, count: int) -> Float64Array:
    """Unit vectors (2, B) of the beams in the sensor's frame: row 0 x, row 1 y.

    A lidar sends the same angles with every scan, so they are computed once. Do not modify.
    """
    bearings = angle_min_rad + angle_increment_rad * np.arange(count)
    return np.stack((np.cos(bearings), np.sin(bearings)))


@dataclass(frozen=True, slots=True)
class Scan:
    """Ranges of one sweep, as REP 117 has them; nothing is clamped. One sonar reading is one, too.

    `ranges_m` (B,) float32: +inf, nothing hit up to `range_max_m`; -inf and nan, no information;
    outside [range_min_m, range_max_m], no information. Beam i points at
    `angle_min_rad + i * angle_increment_rad`, counter-clockwise seen from above the sensor.
    `beam_width_rad`: full angle of a beam that is a cone, 0 for a narrow one. Beam i was measured
    at `stamp_ns` + i * `time_increment_s`, and a sweep is taken every `scan_time_s`; 0: not known.
    `range_max_m` is inf where the sensor does not say. `bearings_rad` (B,) stands in place of even
    angles where beams are bent: seen from one place though the sensor moved during the sweep.
    """

    ranges_m: Float32Array
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    stamp_ns: int = 0
    frame_id: str = ''
    beam_width_rad: float = 0.0
    time_increment_s: float = 0.0
    scan_time_s: float = 0.0
    bearings_rad: Float64Array | None = None

    @classmethod
    def checked(
        cls,
        ranges_m: AnyArray,
        *,
        angle_min_rad: float,
        angle_increment_rad: float,
        range_min_m: float,
        range_max_m: float,
        angle_max_rad: float | None = None,
        stamp_ns: int = 0,
        frame_id: str = '',
        beam_width_rad: float = 0.0,
        time_increment_s: float = 0.0,
        scan_time_s: float = 0.0,
        remark: Remark = say_nothing,
    ) -> Scan:
        """Validate what came from outside; raises ScanError with the reason.

        With `angle_max_rad` the angles must make sense together. When the number of ranges
        disagrees with it by more than a beam (drivers differ in whether the last angle is
        included), `remark` gets a line, and the increment counts. Times that no lidar has
        become 0, with a line too.
        """
        # Always a copy: a read-only array would be another type to the kernels.
        ranges = np.array(ranges_m, dtype=np.float32)
        count = ranges.size
        if ranges.ndim != 1 or count == 0:
            raise ScanError(f'ranges: expected at least one beam, got {count}')
        if not (math.isfinite(angle_min_rad) and math.isfinite(angle_increment_rad)):
            raise ScanError(
                f'angle_min {angle_min_rad}, angle_increment {angle_increment_rad}: '
                'expected finite numbers'
            )
        if count > 1 and angle_increment_rad == 0.0:
            raise ScanError(f'angle_increment is 0 with {count} ranges: expected another value')
        if not 0.0 <= range_min_m < range_max_m:
            raise ScanError(
                f'range_min {range_min_m}, range_max {range_max_m}: '
                'expected 0 <= range_min < range_max'
            )
        if not 0.0 <= beam_width_rad < math.pi:
            raise ScanError(f'beam width {beam_width_rad}: expected 0 to less than pi')
        if angle_max_rad is not None and count > 1:
            _check_angles(count, angle_min_rad, angle_max_rad, angle_increment_rad, remark)
        if not 0.0 <= time_increment_s * (count - 1) <= LONGEST_SWEEP_S:
            remark(f'time_increment is {time_increment_s:g} s for {count} beams: taken as 0')
            time_increment_s = 0.0
        if not 0.0 <= scan_time_s <= LONGEST_SWEEP_S:
            remark(f'scan_time is {scan_time_s:g} s: taken as 0')
            scan_time_s = 0.0
        return cls(
            ranges,
            float(angle_min_rad),
            float(angle_increment_rad),
            float(range_min_m),
            float(range_max_m),
            stamp_ns,
            frame_id,
            float(beam_width_rad),
            float(time_increment_s),
            float(scan_time_s),
        )

    def measured(self) -> BoolArray:
        """Beams (B,) that met something: a finite range above 0 within the limits (REP 117)."""
        ranges = self.ranges_m.astype(np.float64)
        within = (ranges >= self.range_min_m) & (ranges <= self.range_max_m)
        return np.asarray(within & (ranges > 0.0) & (ranges < np.inf), np.bool_)

    def informative(self, *, no_return_clears: bool = True) -> BoolArray:
        """Beams (B,) that say anything: those measured, and +inf if `no_return_clears`."""
        says: BoolArray = self.measured()
        if no_return_clears:
            says |= self.ranges_m == np.inf
        return says

    def bearings(self) -> Float64Array:
        """Angles (B,) of the beams in the sensor's frame, rad."""
        if self.bearings_rad is not None:
            return self.bearings_rad
        steps = np.arange(self.ranges_m.size, dtype=np.float64)
        return np.asarray(self.angle_min_rad + self.angle_increment_rad * steps, np.float64)

    def n_informative(self) -> int:
        """Return how many beams say something: a return within the limits, or inf."""
        ranges = self.ranges_m
        says = (ranges >= self.range_min_m) & (ranges <= self.range_max_m)
        return int(np.count_nonzero(says | (ranges == np.inf)))

    def directions(self) -> Float64Array:
        """Unit vectors (2, B) of the beams."""
        if self.bearings_rad is not None:
            return np.stack((np.cos(self.bearings_rad), np.sin(self.bearings_rad)))
        return beam_directions(self.angle_min_rad, self.angle_increment_rad, self.ranges_m.size)

    def flipped(self) -> Scan:
        """Return the scan of a sensor that hangs head down, as an upright one would give it.

        Beams keep their order, and so their times.
        """
        return replace(
            self,
            angle_min_rad=-self.angle_min_rad,
            angle_increment_rad=-self.angle_increment_rad,
            bearings_rad=None if self.bearings_rad is None else -self.bearings_rad,
        )

    def thinned(self, stride: int) -> Scan:
        """Return every `stride`-th beam, the first among them."""
        return replace(
            self,
            ranges_m=np.ascontiguousarray(self.ranges_m[::stride]),
            angle_increment_rad=self.angle_increment_rad * stride,
            time_increment_s=self.time_increment_s * stride,
            bearings_rad=None if self.bearings_rad is None else self.bearings_rad[::stride],
        )


def _check_angles(
    count: int, angle_min: float, angle_max: float, increment: float, remark: Remark
) -> None:
    span = (count - 1) * abs(increment)
    if span > WIDEST_SPAN_RAD:
        raise ScanError(
            f'ranges: {count} of them in steps of {increment:.6g} rad go over {span:.3g} rad: '
            'expected at most one turn'
        )
    if not math.isfinite(angle_max):
        remark(f'angle_max is {angle_max}: angle_min and angle_increment are used')
        return
    steps = (angle_max - angle_min) / increment
    if steps < 0.0:
        raise ScanError(
            f'angle_increment {increment:.6g} has the wrong sign '
            f'for angles from {angle_min:.6g} to {angle_max:.6g}'
        )
    if abs(count - (steps + 1.0)) > 1.5:
        remark(
            f'{count} ranges, but angles from {angle_min:.6g} to {angle_max:.6g} in steps of '
            f'{increment:.6g} make {steps + 1.0:.0f}: angle_min and angle_increment are used'
        )
