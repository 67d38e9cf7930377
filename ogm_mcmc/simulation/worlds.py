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

__all__ = ['WORLDS', 'Building', 'office', 'rasterised', 'ring_building']


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


class _Room(NamedTuple):
    """Left, bottom, right, top, m; which side its door is in, and where along that side, m."""

    left: float
    bottom: float
    right: float
    top: float
    side: str
    door: float

    def inside(self, depth: float) -> tuple[float, float]:
        """Return the point so deep behind the middle of the door; below 0 it is in front."""
        return {
            'bottom': (self.door, self.bottom + depth),
            'top': (self.door, self.top - depth),
            'left': (self.left + depth, self.door),
            'right': (self.right - depth, self.door),
        }[self.side]


def _row(
    begin: float, ends: tuple[float, ...], across: tuple[float, float], side: str, shift: float
) -> list[_Room]:
    """Return rooms side by side from left to right; the doors are `shift` off their middles."""
    starts = (begin, *ends[:-1])
    return [
        _Room(left, across[0], right, across[1], side, 0.5 * (left + right) + shift)
        for left, right in zip(starts, ends, strict=True)
    ]


def _column(across: tuple[float, float], side: str) -> list[_Room]:
    """Return the rooms at an end of the building from bottom to top."""
    doors = ((0.0, 12.0, 9.8), (12.0, 20.0, 16.3), (20.0, 28.0, 24.1), (28.0, 40.0, 30.2))
    return [_Room(across[0], low, across[1], high, side, door) for low, high, door in doors]


def _ring_rooms() -> list[_Room]:
    """Return the rooms of `ring_building`, those outside of the corridor and those inside."""
    outside, inside = (13.0, 20.0, 26.0, 33.0, 40.0, 46.0, 53.0), (16.0, 23.0, 30.0)
    return [
        *_row(7.0, outside, (0.0, 7.0), 'top', 0.8),
        *_row(9.5, inside, (9.5, 20.0), 'bottom', -1.2),
        *_column((53.0, 60.0), 'left'),
        *_row(7.0, outside, (33.0, 40.0), 'bottom', -0.9),
        *_row(9.5, inside, (20.0, 30.5), 'top', 1.1),
        *_column((0.0, 7.0), 'right'),
        _Room(30.0, 9.5, 50.5, 30.5, 'right', 20.0),
    ]


def _room_walls(room: _Room, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Return the four walls, one with the door, and two pieces of furniture far from it."""
    left, bottom, right, top, side, door = room
    sides = {
        'bottom': ((left, bottom), (right, bottom)), 'top': ((left, top), (right, top)),
        'left': ((left, bottom), (left, top)), 'right': ((right, bottom), (right, top)),
    }  # fmt: skip
    upright = side in ('left', 'right')
    start, end = sides.pop(side)
    along = door - (bottom if upright else left)
    walls = _wall_with_doors(start, end, ((along - 0.55, along + 0.55),))
    walls += [(*a, *b) for a, b in sides.values()]
    far = (right - left if upright else top - bottom) - 1.3
    middle = 0.5 * (bottom + top) if upright else 0.5 * (left + right)
    for aside in (-rng.uniform(1.3, 2.0), rng.uniform(1.3, 2.0)):
        half = np.array([rng.uniform(0.3, 0.7), rng.uniform(0.2, 0.5)])
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
        turn = rng.normal(0.0, 0.2)
        cosine, sine = math.cos(turn), math.sin(turn)
        x, y = room._replace(door=middle + aside).inside(far)
        placed = corners @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)
        walls += _polygon([(float(x), float(y)) for x, y in placed])
    return walls


def ring_building() -> Building:
    """Return a floor of 60 m x 40 m: a corridor around a block, 28 rooms and a hall with pillars.

    The walk goes round the corridor, in and out of every room, and ends where it began.
    """
    rng = np.random.default_rng(60)
    rooms = _ring_rooms()
    walls = [wall for room in rooms for wall in _room_walls(room, rng)]
    for x in (35.0, 40.5, 46.0):
        for y in (14.0, 26.0):
            walls += _pillar(x, y, 0.35)
    middle = np.array([(8.25, 8.25), (51.75, 8.25), (51.75, 31.75), (8.25, 31.75)])
    ways = np.cumsum([0.0, *np.abs(np.diff(middle, axis=0)).sum(axis=1)])
    visits = [(float(way), [(*map(float, at),)]) for way, at in zip(ways, middle, strict=True)]
    for room in rooms:
        door = room.inside(-1.25)
        leg = int(np.argmin([abs(door[1] - 8.25), abs(door[0] - 51.75), abs(door[1] - 31.75),
                             abs(door[0] - 8.25)]))  # fmt: skip
        way = float(ways[leg] + np.abs(np.array(door) - middle[leg]).sum())
        visits.append((way, [door, room.inside(12.0 if room.right == 50.5 else 3.4), door]))
    waypoints = [point for _, points in sorted(visits) for point in points]
    off = np.array([0.02, 0.03])
    once = np.unique(np.array(walls), axis=0)  # neighbours share a wall
    return Building(once + np.tile(off, 2), np.array([*waypoints, waypoints[0]]) + off)


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


WORLDS: dict[str, Callable[[], Building]] = {'office': office, 'ring': ring_building}
