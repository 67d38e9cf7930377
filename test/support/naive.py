"""Slow, obvious twins of the kernels, written from the definitions and not from the kernels.

Traversal works in exact fractions. A float is a fraction too, so there is no rounding here:
where a twin and a kernel disagree, the kernel rounded. `corner_margin` says how near to a corner
of the lattice a segment passes, that is, how little rounding it takes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, Pose2D, PoseSamples, Scan
from ogm_mcmc.sensors import GaussianInverseModel

__all__ = [
    'Beam',
    'Cell',
    'NaiveMapper',
    'beams_of',
    'corner_margin',
    'crossed_cells',
    'crosses',
    'evidence_of',
    'mean_evidence',
    'measured_cells',
    'usable_length',
]

Cell = tuple[int, int]
"""Column and row."""


class Beam(NamedTuple):
    """From the sensor to where the reading ends, in cells, and whether something was hit."""

    x0: float
    y0: float
    x1: float
    y1: float
    hit: bool


def crosses(x0: float, y0: float, x1: float, y1: float, cell: Cell) -> bool:
    """Whether the closed segment has a point in common with [i, i + 1) x [j, j + 1)."""
    # The times at which the point start + t * (end - start) is inside form one interval. Each
    # bound is (t, whether t itself is outside).
    lower, upper = [(Fraction(0), False)], [(Fraction(1), False)]
    for start, end, low in ((x0, x1, cell[0]), (y0, y1, cell[1])):
        a, step = Fraction(start), Fraction(end) - Fraction(start)
        if step == 0:
            if not low <= a < low + 1:
                return False
        elif step > 0:
            lower.append(((low - a) / step, False))
            upper.append(((low + 1 - a) / step, True))
        else:
            lower.append(((low + 1 - a) / step, True))
            upper.append(((low - a) / step, False))
    return all(
        enter < leave or (enter == leave and not (enter_open or leave_open))
        for enter, enter_open in lower
        for leave, leave_open in upper
    )


def crossed_cells(x0: float, y0: float, x1: float, y1: float) -> list[Cell]:
    """Every cell the closed segment crosses, in order.

    Between two neighbouring lines of the lattice a segment stays in one cell: it is enough to
    look at the points where it meets a line and at one point between each two of them.
    """
    ax, ay, bx, by = (Fraction(value) for value in (x0, y0, x1, y1))
    times = {Fraction(0), Fraction(1)}
    for a, b in ((ax, bx), (ay, by)):
        if a != b:
            lines = range(math.ceil(min(a, b)), math.floor(max(a, b)) + 1)
            times.update((line - a) / (b - a) for line in lines)
    ordered = sorted(times)
    visited = [ordered[0]]
    for here, there in pairwise(ordered):
        visited += [(here + there) / 2, there]
    cells: list[Cell] = []
    for t in visited:
        cell = math.floor(ax + t * (bx - ax)), math.floor(ay + t * (by - ay))
        if not cells or cells[-1] != cell:
            cells.append(cell)
    return cells


def corner_margin(x0: float, y0: float, x1: float, y1: float) -> float:
    """Smallest distance, in cells along a line of the lattice, from where it is met to a corner.

    The lower end is left out where it is a corner itself: a segment that starts there is walked
    from an exact number. 1 where no row border is met.
    """
    ax, ay, bx, by = (Fraction(value) for value in (x0, y0, x1, y1))
    if by < ay:
        ax, ay, bx, by = bx, by, ax, ay
    margin = Fraction(1)
    for line in range(math.floor(ay) + 1, math.floor(by) + 1):
        met = ax + (line - ay) / (by - ay) * (bx - ax)
        margin = min(margin, abs(met - round(met)))
    return float(margin)


def usable_length(reading: float, scan: Scan, config: MapperConfig) -> tuple[float, bool] | None:
    """How far a reading (REP 117) says anything, m, and whether it ends at something."""
    reach = min(scan.range_max_m, config.max_range or math.inf)
    if math.isnan(reading) or reading == -math.inf:
        return None
    if reading == math.inf:
        return (reach, False) if config.no_return == 'clear' else None
    if reading <= 0.0 or reading < scan.range_min_m or reading > scan.range_max_m:
        return None
    return (reading, True) if reading <= reach else (reach, False)


def beams_of(scan: Scan, sensor: Pose2D, config: MapperConfig) -> list[Beam]:
    """Every reading that says something, as a segment in lattice coordinates."""
    beams = []
    for i, reading in enumerate(scan.ranges_m.tolist()):
        usable = usable_length(reading, scan, config)
        if usable is not None:
            bearing = scan.angle_min_rad + i * scan.angle_increment_rad
            heading = sensor.yaw_rad + bearing
            beams.append(
                Beam(
                    sensor.x_m / config.resolution,
                    sensor.y_m / config.resolution,
                    (sensor.x_m + usable[0] * math.cos(heading)) / config.resolution,
                    (sensor.y_m + usable[0] * math.sin(heading)) / config.resolution,
                    usable[1],
                )
            )
    return beams


class NaiveMapper:
    """The two-assumption update as one would explain it, one list of evidence per cell.

    `margin` is the least distance of any end from a cell border, and of any beam from a corner:
    only where it is tiny may another order of rounding give another cell.
    """

    def __init__(self, config: MapperConfig) -> None:
        self.config = config
        self.evidence: defaultdict[Cell, list[float]] = defaultdict(list)
        self.margin = 1.0

    def update(self, scan: Scan, sensor: Pose2D) -> None:
        """Note what a scan says about each cell."""
        beams = beams_of(scan, sensor, self.config)
        for beam in beams:
            ends = [abs(value - round(value)) for value in beam[:4]]
            self.margin = min(self.margin, corner_margin(*beam[:4]), *ends)
        if self.config.fusion == 'per_scan':
            self._once_per_scan(beams)
        else:
            self._every_beam(beams)

    def _once_per_scan(self, beams: list[Beam]) -> None:
        hit = {(math.floor(beam.x1), math.floor(beam.y1)) for beam in beams if beam.hit}
        crossed = {cell for beam in beams for cell in crossed_cells(*beam[:4])}
        for cell in hit:
            self.evidence[cell].append(self.config.step.l_occ)
        for cell in crossed - hit:
            self.evidence[cell].append(self.config.step.l_free)

    def _every_beam(self, beams: list[Beam]) -> None:
        for beam in beams:
            end = math.floor(beam.x1), math.floor(beam.y1)
            for cell in crossed_cells(*beam[:4]):
                ends_here = beam.hit and cell == end
                step = self.config.step.l_occ if ends_here else self.config.step.l_free
                self.evidence[cell].append(step)

    def log_odds(self) -> dict[Cell, float]:
        """Log-odds of every measured cell, nats: the prior and then each piece of evidence."""
        limit = self.config.log_odds_limit
        log_odds = {}
        for cell, steps in self.evidence.items():
            value = math.log(self.config.prior / (1.0 - self.config.prior))
            for step in steps:
                value = min(max(value + step, -limit), limit)
            log_odds[cell] = value
        return log_odds


def evidence_of(scan: Scan, sensor: Pose2D, config: MapperConfig) -> dict[Cell, float]:
    """Log-odds one scan from one pose gives to each cell it says anything about.

    `per_scan`: the highest of what its beams say; `per_beam`: their sum.
    """
    evidence: dict[Cell, float] = {}
    for beam in beams_of(scan, sensor, config):
        for cell, value in _beam_evidence(beam, scan, config).items():
            if config.fusion == 'per_scan':
                evidence[cell] = max(evidence.get(cell, -math.inf), value)
            else:
                evidence[cell] = evidence.get(cell, 0.0) + value
    return evidence


def _beam_evidence(beam: Beam, scan: Scan, config: MapperConfig) -> dict[Cell, float]:
    if config.inverse_model == 'step':
        values = dict.fromkeys(crossed_cells(*beam[:4]), config.step.l_free)
        if beam.hit:
            values[math.floor(beam.x1), math.floor(beam.y1)] = config.step.l_occ
        return values
    if not beam.hit:
        return dict.fromkeys(crossed_cells(*beam[:4]), config.gaussian.l_min)
    model = GaussianInverseModel(config.gaussian, config.resolution)
    reading = math.hypot(beam.x1 - beam.x0, beam.y1 - beam.y0) * config.resolution
    behind = 0.5 * model.width_m + 3.0 * model.sigma_m(reading)
    reach = min(scan.range_max_m, config.max_range or math.inf)
    share = min(reading + behind, max(reach, reading)) / reading
    end = (beam.x0 + share * (beam.x1 - beam.x0), beam.y0 + share * (beam.y1 - beam.y0))
    cells = crossed_cells(beam.x0, beam.y0, *end)
    distances = np.array([math.hypot(c + 0.5 - beam.x0, r + 0.5 - beam.y0) for c, r in cells])
    log_odds = model.log_odds(distances * config.resolution, reading)
    return dict(zip(cells, log_odds.tolist(), strict=True))


def mean_evidence(scan: Scan, samples: PoseSamples, config: MapperConfig) -> dict[Cell, float]:
    """Weighted mean over pose samples of what a scan says about each cell ([pose] Eq. 9)."""
    mean: defaultdict[Cell, float] = defaultdict(float)
    for pose, weight in zip(samples.poses.tolist(), samples.weights.tolist(), strict=True):
        for cell, value in evidence_of(scan, Pose2D(*pose), config).items():
            mean[cell] += weight * value
    return dict(mean)


def measured_cells(values: Float32Array, box: CellBox) -> dict[Cell, float]:
    """Value of every cell of a box that is not nan, by lattice coordinates."""
    return {
        (box.column0 + int(column), box.row0 + int(row)): float(values[row, column])
        for row, column in np.argwhere(~np.isnan(values))
    }
