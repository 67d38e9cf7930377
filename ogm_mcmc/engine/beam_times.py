"""Scans bent for when their beams were taken, where joint poses found that out.

`ogm_mcmc.trajectory.beam_times` finds two numbers of a recording; here they are used on scans, so
that maps are made of what lies where it was seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.engine.deskew import LEAST_TURN_RAD, LEAST_WAY_M, bent_by_parts
from ogm_mcmc.geometry import Pose2D, Scan
from ogm_mcmc.trajectory.beam_times import BeamTimes
from ogm_mcmc.trajectory.points import beam_parts

__all__ = ['BentScans', 'beam_times_figures', 'said_beam_times']

NAMES = ('turns', 'sweep')


class _Bent(NamedTuple):
    before: Scan
    moves: Float64Array
    scan: Scan


class BentScans:
    """The scans of before, bent; one that would hardly be bent otherwise stays the same object.

    Chains know scans by that: those of scans that are the same go on.
    """

    def __init__(self) -> None:
        self._known: dict[int, _Bent] = {}

    def bent(
        self, scans: Sequence[Scan], speeds: Float64Array, seconds: Float64Array
    ) -> list[Scan]:
        """Return K scans as seen from where the sensor was in the middle of each.

        speeds  (K, 3) of the sensor, m/s, m/s, rad/s, as it saw itself; `seconds`: `BeamTimes`
        """
        before, self._known = self._known, {}
        found = []
        for scan, speed in zip(scans, speeds, strict=True):
            moves = np.outer(seconds, speed)
            if _matters(moves):
                one = before.get(id(scan))
                if one is None or one.before is not scan or _matters(moves - one.moves):
                    one = _Bent(scan, moves, _bent(scan, speed, seconds))
                self._known[id(scan)] = one
                scan = one.scan
            found.append(scan)
        return found


def _bent(scan: Scan, speed: Float64Array, seconds: Float64Array) -> Scan:
    size = scan.ranges_m.size
    times_s = beam_parts(np.arange(size), size) @ seconds
    return bent_by_parts(scan, Pose2D(*map(float, speed)), times_s)


def _matters(moves: Float64Array) -> bool:
    """Whether the sensor moved enough in a turn and in a sweep, (2, 3), to bend a scan."""
    way, turn = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
    return bool((way > LEAST_WAY_M).any() or (turn > LEAST_TURN_RAD).any())


def beam_times_figures(found: BeamTimes) -> dict[str, float | None]:
    """Return plain values for JSON, seconds; a deviation that is not known is None."""
    figures: dict[str, float | None] = {}
    for name, second, deviation in zip(NAMES, found.seconds, found.deviations, strict=True):
        figures[f'{name}_s'] = round(float(second), 6)
        unknown = math.isnan(deviation)
        figures[f'{name}_deviation_s'] = None if unknown else round(float(deviation), 6)
    return figures


def said_beam_times(found: BeamTimes) -> str:
    """Return a line for the user: when beams were taken; empty where all were at once."""
    turns, sweep = found.seconds * 1000.0
    said = []
    if turns:
        said.append(f'odd ones {abs(turns):.2f} ms {"after" if turns > 0 else "before"} even ones')
    if sweep:
        ends = 'first to the last' if sweep > 0 else 'last to the first'
        said.append(f'{abs(sweep):.2f} ms from the {ends}')
    return f'beams of a scan were taken at different times: {", ".join(said)}' if said else ''
