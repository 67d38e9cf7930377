"""Readings that a driver sends in place of "nothing was hit", found from the scans themselves.

REP 117 has +inf for that, and many drivers send range_max, which counts as the same. Others send
a value below it: 3.499 of 3.5 m, or 25.0 of 30 m; mapped as they come they are walls around the
robot. What gives a code away is told by `ogm_mcmc.io.no_return.recognised_codes`. Here nobody
knows yet where the laser was, so what counts is that one scan has more of one value, bit for bit,
than a flat wall at that distance could give. A few beams are let be: they may be chance.

A code may come late, when a robot leaves a small room. So the latest scans are looked at beside
those kept from all over, of which few would have it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.geometry.scan import Remark, say_nothing
from ogm_mcmc.io.no_return import AT_LEAST, Code, are_codes, recognised_codes

__all__ = ['RangeCodes']

# Scans of a sensor that are looked at, spread over all of them.
KEPT = 25

# Live, a look is taken after so many scans, and at these of the latest.
LOOK_EVERY = 100
LATEST, LATEST_EVERY = 10, 10

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
        self._latest: deque[_Readings] = deque(maxlen=LATEST)
        self._every = 1
        self._seen = 0

    def see(self, scan: Scan) -> None:
        """Take note of a scan."""
        spread, late = self._seen % self._every == 0, self._seen % LATEST_EVERY == 0
        if (spread or late) and not self.settled and scan.ranges_m.size <= MOST_BEAMS:
            ranges = scan.ranges_m[scan.measured()].astype(np.float64)
            readings = _Readings(ranges, scan.angle_increment_rad)
            if late:
                self._latest.append(readings)
            if spread:
                self._keep(readings)
        self._seen += 1

    def _keep(self, readings: _Readings) -> None:
        self._kept.append(readings)
        if len(self._kept) >= 2 * KEPT:
            del self._kept[1::2]
            self._every *= 2

    def is_due(self) -> bool:
        """Whether there are twice as many scans as at some look, or a hundred more."""
        return not self.settled and (
            self._seen & (self._seen - 1) == 0 or self._seen % LOOK_EVERY == 0
        )

    def look(self, *, at_latest: bool = True) -> str:
        """Find the codes anew; return what to say, empty: nothing new."""
        latest = list(self._latest) if at_latest else []
        scans = list({id(scan): scan for scan in (*self._kept, *latest)}.values())
        if not scans:
            return ''
        found, before = recognised_codes(scans), self.codes
        everywhere, lately = _together(scans), _together(latest)
        shares = {code: max(_share(everywhere, code), _share(lately, code)) for code in found}
        codes = [code for code in found if shares[code] >= SHARE or _is_among(code, before)]
        quiet = everywhere[~are_codes(everywhere, codes)]
        for old in before:
            if not _is_among(old, codes) and _says_nothing_of(quiet, old):
                codes.append(old)
        self.codes = codes
        return _remark(
            [code for code in before if not _is_among(code, codes)],
            {code: shares.get(code, 0.0) for code in codes},
            news=any(not _is_among(code, before) for code in codes),
        )


def _together(scans: list[_Readings]) -> Float64Array:
    return np.concatenate([np.empty(0), *(scan.ranges_m for scan in scans)])


def _share(readings: Float64Array, code: Code) -> float:
    """Return which share of readings is this code."""
    return float(are_codes(readings, [code]).sum()) / max(readings.size, 1)


def _is_among(code: Code, codes: Iterable[Code]) -> bool:
    """Whether it is one of these: a code may tremble."""
    return any(code.low_m <= one.high_m and one.low_m <= code.high_m for one in codes)


def _says_nothing_of(readings: Float64Array, code: Code) -> bool:
    """Whether readings are too few to tell, and none lies beyond the code."""
    few = int(are_codes(readings, [code]).sum()) < AT_LEAST
    return few and float(readings.max(initial=0.0)) <= code.high_m


def _remark(gone: list[Code], shares: dict[Code, float], *, news: bool) -> str:
    """Say which codes are none after all, and which there are; empty: nothing changed."""
    said = []
    if gone:
        lows = _listed(code.low_m for code in gone)
        said.append(f'readings of {lows} m are surfaces after all, and mapped from now on')
    if shares and (gone or news):
        said.append(
            f'readings of {_listed(code.low_m for code in shares)} m '
            f'({sum(shares.values()):.0%} of them) are taken as no return: so many beams of one '
            'value look like no surface (no_return_code)'
        )
    return '; '.join(said)


class RangeCodes:
    """Turns codes for "nothing" into +inf: of each sensor (`frame_id`) its own.

    `chosen_m`: readings from here on are codes, and no others; 0: found from the scans. `tell`
    gets a line whenever something else is found.
    """

    def __init__(self, chosen_m: float = 0.0, tell: Remark = say_nothing) -> None:
        self.chosen_m = chosen_m
        self._tell = tell
        self._sensors: Recent[_Sensor] = Recent(MOST_SENSORS)
        self._doubted_m = 0.0  # the chosen code that was last said to leave nothing

    def learn(self, scans: Iterable[Scan]) -> None:
        """Look at scans from all over a recording, before the first is used; that settles it."""
        frames = set()
        for scan in scans:
            frames.add(scan.frame_id)
            self._sensor(scan.frame_id).see(scan)
        for frame in sorted(frames) if self.chosen_m == 0.0 else ():
            self._look(frame, at_latest=False)
            self._sensor(frame).settled = True

    def taken(self, scan: Scan) -> Scan:
        """Return a scan without codes.

        A sensor that nobody learned is looked at when its first scan comes, whenever there are
        twice as many, and after every hundred: what a scan or two made believe does not last.
        """
        if self.chosen_m == 0.0:
            sensor = self._sensor(scan.frame_id)
            sensor.see(scan)
            if sensor.is_due():
                self._look(scan.frame_id)
        return self.without_codes(scan)

    def without_codes(self, scan: Scan) -> Scan:
        """Return a scan without the codes that are known now; it may have been taken before.

        In scans that were bent for motion since they came, codes are no longer one value: they
        stay. What was taken for a code stays `+inf` where it turned out to be none.
        """
        if self.chosen_m > 0.0:
            if self.chosen_m <= scan.range_min_m and self.chosen_m != self._doubted_m:
                self._doubted_m = self.chosen_m
                self._say(
                    scan.frame_id,
                    f'no_return_code is {self.chosen_m:g} m, and range_min {scan.range_min_m:g} '
                    'm: no reading is left; expected a greater code, or 0',
                )
            return _without(scan, [Code('chosen', self.chosen_m, math.inf, self.chosen_m)])
        sensor = self._sensors.get(scan.frame_id)
        return scan if sensor is None else _without(scan, sensor.codes)

    def _sensor(self, frame: str) -> _Sensor:
        if frame not in self._sensors:
            self._sensors[frame] = _Sensor()
        return self._sensors[frame]

    def _look(self, frame: str, *, at_latest: bool = True) -> None:
        said = self._sensor(frame).look(at_latest=at_latest)
        if said:
            self._say(frame, said)

    def _say(self, frame: str, text: str) -> None:
        self._tell(f'{frame}: {text}' if frame else text)


def _without(scan: Scan, codes: list[Code]) -> Scan:
    """Return a scan whose codes are +inf; up to there, or to its farthest hit, nothing was met."""
    if not codes:
        return scan
    is_code = are_codes(scan.ranges_m.astype(np.float64), codes) & scan.measured()
    if not is_code.any():
        return scan
    hits = scan.ranges_m[scan.measured() & ~is_code]
    told = min(code.reach_m for code in codes)
    reach = max(told, float(hits.max(initial=0.0)), scan.range_min_m)
    ranges = scan.ranges_m.copy()
    ranges[is_code] = np.inf
    return replace(scan, ranges_m=ranges, range_max_m=min(scan.range_max_m, reach))


def _listed(values: Iterable[float]) -> str:
    return ', '.join(f'{value:.6g}' for value in values)
