"""Maps from sonars: each reading is a cone ([slides])."""

from __future__ import annotations

import math

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, PlacedScan
from ogm_mcmc.geometry.rays import on_lattice, usable_range
from ogm_mcmc.mapping.log_odds_mapper import NOTHING, LogOddsMapper
from ogm_mcmc.mapping.sonar_kernels import add_cone
from ogm_mcmc.sensors import SonarInverseModel

__all__ = ['SonarMapper']


class SonarMapper(LogOddsMapper):
    """Log-odds of every cell, updated by cones at the mean of the believed pose.

    A scan is one reading or several, each a cone of `Scan.beam_width_rad` (of
    `sonar.opening_angle` where that is 0), and each an update of its own: there is no `fusion`.
    """

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; see `LogOddsMapper.configure`."""
        super().configure(config)
        self._cone = SonarInverseModel(config.sonar)

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        scan, sonar = placed.scan, placed.pose
        spec, metres = self.grid.spec, self.config.resolution
        reach = usable_range(scan, spec, self.config.max_range)
        column, row, x, y = on_lattice(sonar, spec)
        opening = scan.beam_width_rad or self.config.sonar.opening_angle
        says = scan.informative(no_return_clears=self.config.no_return == 'clear')
        cones = [
            (sonar.yaw_rad + bearing, min(reading, reach), reading <= reach)
            for bearing, reading in zip(
                scan.bearings()[says].tolist(), scan.ranges_m[says].tolist(), strict=True
            )
        ]
        box, boxes = NOTHING, []
        for heading, length, hit in cones:
            furthest = (length + (self.config.sonar.thickness if hit else 0.0)) / metres
            boxes.append(_around_sector(column, row, x, y, heading, 0.5 * opening, furthest))
            box = box.union(boxes[-1])
        if box.empty:
            return NOTHING
        self.grid.cover(box)
        spec = self.grid.spec
        for (heading, length, hit), own in zip(cones, boxes, strict=True):
            add_cone(
                self.grid.log_odds,
                own.column0 - spec.column0,
                own.row0 - spec.row0,
                own.column1 - spec.column0,
                own.row1 - spec.row0,
                column - spec.column0 + x,
                row - spec.row0 + y,
                math.cos(heading),
                math.sin(heading),
                length,
                hit,
                0.5 * opening,
                self._cone.strength(length, scan.range_max_m),
                self._cone.sigma_rad(opening),
                float(self.config.sonar.thickness),
                float(metres),
                self._prior,
                self._limit,
            )
        return box


def _around_sector(
    column: int, row: int, x: float, y: float, heading: float, half: float, furthest: float
) -> CellBox:
    """Return a box around a sector of a circle, one cell to spare; lattice coordinates, cells."""
    low, high = heading - half, heading + half
    quarter = 0.5 * math.pi
    turns = np.arange(math.ceil(low / quarter), math.floor(high / quarter) + 1) * quarter
    angles = np.concatenate(([low, high], turns))
    across = np.append(x + furthest * np.cos(angles), x)
    upwards = np.append(y + furthest * np.sin(angles), y)
    return CellBox(
        column + math.floor(float(across.min())) - 1,
        row + math.floor(float(upwards.min())) - 1,
        column + math.floor(float(across.max())) + 2,
        row + math.floor(float(upwards.max())) + 2,
    )
