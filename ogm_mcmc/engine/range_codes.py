"""Readings that a driver sends in place of "nothing was hit", found from the scans themselves.

REP 117 has +inf for that, and many drivers send range_max, which counts as the same. Others send
a value below it: 3.499 of 3.5 m, or 25.0 of 30 m; mapped as they come they are walls around the
robot. What gives a code away is told by `ogm_mcmc.io.no_return.recognised_codes`. Here nobody
knows yet where the laser was, so what counts is that one scan has more of one value, bit for bit,
than a flat wall at that distance could give. A few beams are let be: they may be chance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.geometry.scan import Remark, say_nothing
from ogm_mcmc.io.no_return import Code, are_codes, recognised_codes

__all__ = ['RangeCodes']

# Scans of a sensor that are looked at, spread over all of them.
KEPT = 25

# No planar lidar has more beams, and no robot more of them: what is kept stays small.
MOST_BEAMS = 5000
MOST_SENSORS = 16

# At least this share of the readings.
SHARE = 0.01

NOWHERE = Pose2D(0.0, 0.0, 0.0)


class _Readings(NamedTuple):
    """What a scan measured; where the laser was is not known."""

    ranges_m: Float64Array
    increment_rad: float
    laser_pose: Pose2D = NOWHERE


class _Sensor:
    """Scans of one sensor that were kept, and the codes that they gave away."""

    def __init__(self) -> None:
        self.codes: list[Code] = []
        self.settled = False
        self._kept: list[_Readings] = []
        self._every = 1
        self._seen = 0

    def see(self, scan: Scan) -> None:
        """Take note of a scan."""
        if self._seen % self._every == 0 and scan.ranges_m.size <= MOST_BEAMS:
            ranges = scan.ranges_m[scan.measured()].astype(np.float64)
            self._kept.append(_Readings(ranges, scan.angle_increment_rad))
            if len(self._kept) >= 2 * KEPT:
                del self._kept[1::2]
                self._every *= 2
        self._seen += 1

    def is_due(self) -> bool:
        """Whether there are twice as many scans as at the last look."""
        return not self.settled and self._seen & (self._seen - 1) == 0

    def look(self) -> str:
        """Find the codes anew; return what to say, empty: nothing new."""
        before = [code.low_m for code in self.codes]
        if not self._kept:
            return ''
        readings = np.concatenate([one.ranges_m for one in self._kept])
        shares = {
            code: float(are_codes(readings, [code]).mean())
            for code in recognised_codes(self._kept)
        }
        self.codes = [code for code, share in shares.items() if share >= SHARE]
        if [code.low_m for code in self.codes] == before:
            return ''
        if not self.codes:
            return (
                f'readings of {_listed(before)} m are surfaces after all, and mapped from now on'
            )
        share = sum(shares[code] for code in self.codes)
        return (
            f'readings of {_listed(code.low_m for code in self.codes)} m ({share:.0%} of them) '
            'are taken as no return: no surface gives so many beams one value (no_return_code)'
        )


class RangeCodes:
    """Turns codes for "nothing" into +inf: of each sensor (`frame_id`) its own.

    `chosen_m`: readings from here on are codes, and no others; 0: found from the scans. `tell`
    gets a line whenever something else is found.
    """

    def __init__(self, chosen_m: float = 0.0, tell: Remark = say_nothing) -> None:
        self.chosen_m = chosen_m
        self._tell = tell
        self._sensors: Recent[_Sensor] = Recent(MOST_SENSORS)

    def learn(self, scans: Iterable[Scan]) -> None:
        """Look at scans from all over a recording, before the first is used; that settles it."""
        frames = set()
        for scan in scans:
            frames.add(scan.frame_id)
            self._sensor(scan.frame_id).see(scan)
        for frame in sorted(frames) if self.chosen_m == 0.0 else ():
            self._look(frame)
            self._sensor(frame).settled = True

    def taken(self, scan: Scan) -> Scan:
        """Return a scan without codes.

        A sensor that nobody learned is looked at when its first scan comes, and whenever there
        are twice as many: what a scan or two made believe does not last.
        """
        if self.chosen_m > 0.0:
            return _without(scan, [Code('chosen', self.chosen_m, math.inf, self.chosen_m)])
        sensor = self._sensor(scan.frame_id)
        sensor.see(scan)
        if sensor.is_due():
            self._look(scan.frame_id)
        return _without(scan, sensor.codes)

    def _sensor(self, frame: str) -> _Sensor:
        if frame not in self._sensors:
            self._sensors[frame] = _Sensor()
        return self._sensors[frame]

    def _look(self, frame: str) -> None:
        said = self._sensor(frame).look()
        if said:
            self._tell(f'{frame}: {said}')


def _without(scan: Scan, codes: list[Code]) -> Scan:
    """Return a scan whose codes are +inf; up to there, or to its farthest hit, nothing was met."""
    if not codes:
        return scan
    is_code = are_codes(scan.ranges_m.astype(np.float64), codes) & scan.measured()
    if not is_code.any():
        return scan
    hits = scan.ranges_m[scan.measured() & ~is_code]
    reach = max(min(code.reach_m for code in codes), float(hits.max(initial=0.0)))
    ranges = scan.ranges_m.copy()
    ranges[is_code] = np.inf
    return replace(scan, ranges_m=ranges, range_max_m=min(scan.range_max_m, reach))


def _listed(values: Iterable[float]) -> str:
    return ', '.join(f'{value:.6g}' for value in values)
