"""Scans taken on the move, bent so that all of their beams are seen from one place.

A lidar that turns ten times a second on a robot that turns by 60 degrees a second smears a scan
over 6 degrees. Every beam has a time of its own: that of the scan for the first, `time_increment`
later for each one after (sensor_msgs/LaserScan). What a beam met is carried into the frame that
the sensor had at the first beam; its distance and direction from there are the bent beam. So a
scan stays one scan with one pose, and only the way to what it met is off, by no more than the
sensor moved meanwhile.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry import Pose2D, Scan

__all__ = ['bent', 'bent_by_parts', 'last_stamp_ns', 'time_between_beams']

# A sweep in which the sensor moves less is left as it is.
LEAST_TURN_RAD = math.radians(0.01)
LEAST_WAY_M = 0.001

# Times of beams that go so far beyond `scan_time` contradict it.
SLACK = 1.1


def time_between_beams(scan: Scan, deskew: str) -> float:
    """Return the time from one beam to the next in s; 0 for a scan to be taken as it is.

    `deskew` auto: where `time_increment` names it, unless a sweep would last longer than
    `scan_time` says. on: elsewhere as well, from `scan_time` as the time of a full turn (auto
    does not: simulators name it for scans taken at once). off: never.
    """
    if deskew == 'off' or scan.ranges_m.size < 2:
        return 0.0
    increment, sweep = scan.time_increment_s, scan.scan_time_s
    if deskew == 'on':
        return increment or sweep * abs(scan.angle_increment_rad) / (2.0 * math.pi)
    if 0.0 < sweep * SLACK < increment * (scan.ranges_m.size - 1):
        return 0.0
    return increment


def last_stamp_ns(scan: Scan, time_between_beams_s: float) -> int:
    """Return when the last beam was measured: up to here poses have to be known."""
    return scan.stamp_ns + round((scan.ranges_m.size - 1) * time_between_beams_s * 1e9)


def bent(scan: Scan, way: Pose2D) -> Scan:
    """Return the scan as the sensor would have given it from where it was at the first beam.

    `way`: where the sensor was at the last beam, seen from there; between, it moved evenly. A
    reading within the limits stays within them, and one that says nothing as it is.
    """
    if abs(way.yaw_rad) < LEAST_TURN_RAD and math.hypot(way.x_m, way.y_m) < LEAST_WAY_M:
        return scan
    return bent_by_parts(scan, way, np.linspace(0.0, 1.0, scan.ranges_m.size))


def bent_by_parts(scan: Scan, way: Pose2D, part: Float64Array) -> Scan:
    """Return the scan as seen from one place: each beam was a part (B,) of `way` further on."""
    direction = scan.bearings() + part * way.yaw_rad
    ranges = scan.ranges_m.astype(np.float64)
    hit = scan.measured()
    # What met nothing is bent for where it ends, if that is known.
    lengths = np.where(hit, ranges, scan.range_max_m)
    known = np.isfinite(lengths)
    lengths[~known] = 0.0
    ahead = part * way.x_m + lengths * np.cos(direction)
    left = part * way.y_m + lengths * np.sin(direction)
    moved = np.clip(np.hypot(ahead, left), scan.range_min_m, scan.range_max_m)
    return replace(
        scan,
        ranges_m=np.where(hit, moved, ranges).astype(np.float32),
        bearings_rad=np.where(known, np.arctan2(left, ahead), direction),
    )
