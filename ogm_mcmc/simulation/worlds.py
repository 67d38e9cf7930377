"""Buildings made of straight walls."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.geometry.traversal_kernels import trace_ray
from ogm_mcmc.simulation.raster_kernels import walk_distances

__all__ = ['WORLDS', 'Building', 'office', 'rasterised']


class Building(NamedTuple):
    """Walls (S, 4) as x1, y1, x2, y2 and a walk (W, 2) that touches none of them; metres."""

    walls: Float64Array
    waypoints: Float64Array


def _wall_with_doors(
    start: tuple[float, float], end: tuple[float, float], doors: tuple[tuple[float, float], ...]
) -> list[tuple[float, float, float, float]]:
    """Cut doors, given as (from, to) in metres along it, out of a straight wall."""
    length = math.hypot(end[0] - start[0], end[1] - start[1])
    step = ((end[0] - start[0]) / length, (end[1] - start[1]) / length)
    marks = [0.0, *(edge for door in doors for edge in door), length]
    return [
        (
            start[0] + a * step[0],
            start[1] + a * step[1],
            start[0] + b * step[0],
            start[1] + b * step[1],
        )
        for a, b in zip(marks[::2], marks[1::2], strict=True)
    ]


def _polygon(points: list[tuple[float, float]]) -> list[tuple[float, float, float, float]]:
    return [(*a, *b) for a, b in zip(points, points[1:] + points[:1], strict=True)]


def _pillar(x: float, y: float, radius: float) -> list[tuple[float, float, float, float]]:
    angles = np.arange(12) * (2.0 * math.pi / 12.0)
    ring = [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles]
    return _polygon(ring)


def office() -> Building:
    """Return a floor of 16 m x 12 m: a corridor, five rooms, a slanted wall, a pillar, desks."""
    walls = [
        # Outside, with one corner cut off.
        *_polygon([(0, 0), (16, 0), (16, 9.5), (13.5, 12), (0, 12)]),
        # The corridor, 2 m wide, with doors of 1 m.
        *_wall_with_doors((0, 5), (16, 5), ((2.0, 3.0), (7.5, 8.5), (13.0, 14.0))),
        *_wall_with_doors((0, 7), (16, 7), ((4.0, 5.0), (11.0, 12.0))),
        # Between the rooms; one wall is neither straight up nor across.
        (5.0, 0.0, 5.0, 5.0),
        *_wall_with_doors((11.0, 0.0), (10.0, 5.0), ((2.0, 3.0),)),
        (8.0, 7.0, 8.0, 12.0),
        *_pillar(13.2, 9.4, 0.3),
        # Desks and cabinets.
        *_polygon([(0.6, 0.6), (2.2, 0.6), (2.2, 1.4), (0.6, 1.4)]),
        *_polygon([(6.2, 0.5), (7.8, 0.5), (7.8, 1.3), (6.2, 1.3)]),
        *_polygon([(1.0, 10.2), (1.8, 10.6), (1.4, 11.4), (0.6, 11.0)]),
        *_polygon([(14.9, 3.0), (15.7, 3.0), (15.7, 4.4), (14.9, 4.4)]),
    ]
    waypoints = [
        (0.8, 6.0), (2.5, 6.0), (2.5, 3.0), (3.8, 2.0), (2.5, 3.0), (2.5, 6.0),
        (4.5, 6.0), (4.5, 9.0), (2.6, 9.4), (4.5, 9.0), (4.5, 6.0),
        (8.0, 6.0), (8.0, 3.0), (8.8, 1.6), (8.0, 3.0), (8.0, 6.0),
        (11.5, 6.0), (11.5, 9.0), (9.4, 10.6), (11.5, 9.0), (11.5, 6.0),
        (13.5, 6.0), (13.5, 3.0), (12.6, 1.6), (13.5, 3.0), (13.5, 6.0), (15.2, 6.0),
    ]  # fmt: skip
    # Off the borders of the usual cells, where rounding would decide which side a wall is on.
    off = np.array([0.02, 0.03])
    return Building(np.array(walls) + np.tile(off, 2), np.array(waypoints) + off)


def rasterised(building: Building, resolution_m: float) -> GridMap:
    """Return the true map: cells that a wall crosses are occupied, those behind all walls unknown.

    Free is what can be reached from the first waypoint, side by side.
    """
    x, y = building.walls[:, ::2], building.walls[:, 1::2]
    column0, row0 = (math.floor(v.min() / resolution_m) - 1 for v in (x, y))
    column1, row1 = (math.floor(v.max() / resolution_m) + 2 for v in (x, y))
    spec = GridSpec(resolution_m, column1 - column0, row1 - row0, column0, row0)
    occupied = np.zeros((spec.height, spec.width), np.uint8)
    scratch = np.empty((2, spec.width + spec.height + 3), np.int64)
    for wall in building.walls / resolution_m:
        # The traversal counts from the corner of the segment's first cell.
        column, row = math.floor(wall[0]), math.floor(wall[1])
        ends = (wall[0] - column, wall[1] - row, wall[2] - column, wall[3] - row)
        count = trace_ray(column - column0, row - row0, *ends, scratch[0], scratch[1])
        occupied[scratch[1, :count], scratch[0, :count]] = 1
    distances = np.empty(occupied.shape, np.int32)
    queue = np.empty(occupied.size, np.int32)
    start = spec.cell_of(*map(float, building.waypoints[0]))
    walk_distances(occupied == 0, *start, distances, queue)
    probability = np.full(occupied.shape, np.nan, np.float32)
    probability[distances >= 0] = 0.0
    probability[occupied == 1] = 1.0
    return GridMap(spec, probability)


WORLDS: dict[str, Callable[[], Building]] = {'office': office}
