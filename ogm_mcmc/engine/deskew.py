"""Scans taken on the move, cut into pieces that each have the pose of their own time.

A lidar that turns ten times a second on a robot that turns by 60 degrees a second smears a scan
over 6 degrees. Every beam has a time of its own: that of the scan for the first, `time_increment`
later for each one after (sensor_msgs/LaserScan). Beams next to each other are so close in time
that one pose serves a run of them. The cut is as fine as the motion asks for, so that a robot
that stands still keeps whole scans.

To whom a scan is more than its beams (`fusion: per_scan`: each cell once a scan, a hit beats a
miss) the pieces are scans of their own: a cell on the border of two may count twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

from ogm_mcmc.geometry import PoseBelief, Scan, wrap_angle

__all__ = ['MAX_TURN_RAD', 'MAX_WAY_M', 'deskewed', 'last_stamp_ns']

# Within a piece the robot moves by no more: half of it either way of the pose used.
MAX_TURN_RAD = math.radians(0.25)
MAX_WAY_M = 0.02


def last_stamp_ns(scan: Scan, time_increment_s: float) -> int:
    """Return when the last beam was measured: up to here poses have to be known."""
    return _stamp_ns(scan, time_increment_s, scan.ranges_m.size - 1)


def deskewed(
    scan: Scan,
    time_increment_s: float,
    belief_at: Callable[[int], PoseBelief],
    *,
    max_turn_rad: float = MAX_TURN_RAD,
    max_way_m: float = MAX_WAY_M,
) -> list[tuple[Scan, PoseBelief]]:
    """Return the scan in pieces, each stamped with the middle of its time, and their poses.

    `time_increment_s`: between neighbouring beams; 0 for a scan taken at once, which comes back
    as it is. `belief_at(stamp_ns)` may raise what a `PoseSource` raises, for any stamp from that
    of the scan to `last_stamp_ns`. A piece spans no more than `max_turn_rad` and `max_way_m` of
    an even motion, so that no beam is off by more than half of them.
    """
    count = scan.ranges_m.size
    if time_increment_s == 0.0 or count == 1:
        return [(scan, belief_at(scan.stamp_ns))]
    first = belief_at(scan.stamp_ns).mean
    last = belief_at(last_stamp_ns(scan, time_increment_s)).mean
    turn_rad = abs(wrap_angle(last.yaw_rad - first.yaw_rad))
    way_m = math.hypot(last.x_m - first.x_m, last.y_m - first.y_m)
    pieces = min(count, max(1, math.ceil(max(turn_rad / max_turn_rad, way_m / max_way_m))))
    bounds = [count * k // pieces for k in range(pieces + 1)]
    cut = []
    for begin, end in pairwise(bounds):
        stamp_ns = _stamp_ns(scan, time_increment_s, (begin + end - 1) / 2)
        piece = replace(
            scan,
            ranges_m=scan.ranges_m[begin:end],
            angle_min_rad=scan.angle_min_rad + begin * scan.angle_increment_rad,
            stamp_ns=stamp_ns,
        )
        cut.append((piece, belief_at(stamp_ns)))
    return cut


def _stamp_ns(scan: Scan, time_increment_s: float, beam: float) -> int:
    return scan.stamp_ns + round(beam * time_increment_s * 1e9)
