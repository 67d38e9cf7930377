"""The slow twin of the cone of a sonar: cut every shape with the cone, look at what is left.

A cell is a square and a wall is a line, both lists of corners. What lies outside of one of the
cone's two half-planes is cut off, corner by corner; the nearest point is on one of the sides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ogm_mcmc.arrays import UInt8Array

__all__ = ['Echo', 'cell_echoes', 'nearest_in_cone']

Point = tuple[float, float]


class Echo(NamedTuple):
    """Where the beam to the nearest point of a cell enters it and leaves it, cells."""

    enters: float
    leaves: float


def nearest_in_cone(
    corners: list[Point], x: float, y: float, heading: float, half: float
) -> Point:
    """Return the point of a convex shape in the cone at (x, y) next to it, (inf, inf) if none.

    heading, half  of the axis, and half the opening angle below a quarter turn, rad. The point is
    seen from (x, y), which lies outside of the shape.
    """
    shape = [(px - x, py - y) for px, py in corners]
    for border in (heading - half + 0.5 * math.pi, heading + half - 0.5 * math.pi):
        shape = _cut(shape, math.cos(border), math.sin(border))
    sides = zip(shape, shape[1:] + shape[:1], strict=True)
    points = [_nearest_on_side(*side) for side in sides]
    return min(points, key=lambda point: math.hypot(*point), default=(math.inf, math.inf))


def _cut(shape: list[Point], normal_x: float, normal_y: float) -> list[Point]:
    """Return the corners of the part where normal . point >= 0."""
    kept: list[Point] = []
    for k, (bx, by) in enumerate(shape):
        ax, ay = shape[k - 1]
        before, here = normal_x * ax + normal_y * ay, normal_x * bx + normal_y * by
        if (before < 0.0) != (here < 0.0):
            share = before / (before - here)
            kept.append((ax + share * (bx - ax), ay + share * (by - ay)))
        if here >= 0.0:
            kept.append((bx, by))
    return kept


def _nearest_on_side(a: Point, b: Point) -> Point:
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    share = 0.0 if squared == 0.0 else -(a[0] * dx + a[1] * dy) / squared
    share = min(max(share, 0.0), 1.0)
    return (a[0] + share * dx, a[1] + share * dy)


def cell_echoes(
    occupied: UInt8Array, x: float, y: float, heading: float, half: float
) -> list[Echo]:
    """Return the echo of every occupied cell in the cone, all behind each other."""
    echoes = []
    for row in range(occupied.shape[0]):
        for column in range(occupied.shape[1]):
            if not occupied[row, column]:
                continue
            square: list[Point] = [
                (column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1),
            ]  # fmt: skip
            point = nearest_in_cone(square, x, y, heading, half)
            enters = math.hypot(*point)
            if math.isfinite(enters):
                echoes.append(Echo(enters, _leaves(square, x, y, point)))
    return echoes


def _leaves(square: list[Point], x: float, y: float, point: Point) -> float:
    """Return how far the beam to a point of a square is inside of it at all."""
    (left, low), (right, high) = square[0], square[2]
    furthest = 1.0
    lines = [((left - x), point[0]), ((right - x), point[0])]
    lines += [((low - y), point[1]), ((high - y), point[1])]
    for distance, step in lines:
        if step == 0.0:
            continue
        times = distance / step
        at_x, at_y = x + times * point[0], y + times * point[1]
        if left - 1e-9 <= at_x <= right + 1e-9 and low - 1e-9 <= at_y <= high + 1e-9:
            furthest = max(furthest, times)
    return furthest * math.hypot(*point)
