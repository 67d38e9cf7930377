"""Shapes on cells: a cell belongs to a shape if its centre does. Coordinates in cells."""

from __future__ import annotations

import math
from typing import Self

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array

__all__ = ['Canvas']

Point = AnyArray | tuple[float, float]


class Canvas:
    """Cells (height, width) bool to draw on, and the box around all that was drawn."""

    def __init__(self, width: int, height: int) -> None:
        self.cells: BoolArray = np.zeros((height, width), np.bool_)
        self._box = [width, height, 0, 0]

    @property
    def touched(self) -> tuple[slice, slice]:
        """Return (rows, columns) of the box around all that was drawn."""
        return self.around(0)

    def around(self, margin: int) -> tuple[slice, slice]:
        """Return that box with a margin on every side."""
        left, bottom, right, top = self._box
        return (
            slice(max(0, bottom - margin), max(0, top + margin)),
            slice(max(0, left - margin), max(0, right + margin)),
        )

    def stroke(self, start: Point, end: Point, thickness: float) -> Self:
        """Draw a thick line with round ends: all centres within half its thickness."""
        x, y, window = self._centres(np.array([start, end]), 0.5 * thickness)
        dx, dy = end[0] - start[0], end[1] - start[1]
        squared = max(dx * dx + dy * dy, 1e-12)
        along = np.clip(((x - start[0]) * dx + (y - start[1]) * dy) / squared, 0.0, 1.0)
        gap = np.hypot(x - start[0] - along * dx, y - start[1] - along * dy)
        self.cells[window] |= gap <= 0.5 * thickness
        return self

    def disc(self, centre: Point, radius: float) -> Self:
        """Draw a disc."""
        return self.stroke(centre, centre, 2.0 * radius)

    def box(self, centre: Point, sides: tuple[float, float], angle_rad: float) -> Self:
        """Draw a rectangle turned by an angle."""
        reach = 0.5 * math.hypot(*sides)
        x, y, window = self._centres(np.array([centre]), reach)
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        along = (x - centre[0]) * cosine + (y - centre[1]) * sine
        across = (y - centre[1]) * cosine - (x - centre[0]) * sine
        self.cells[window] |= (abs(along) <= 0.5 * sides[0]) & (abs(across) <= 0.5 * sides[1])
        return self

    def polygon(self, corners: Float64Array) -> Self:
        """Draw a convex polygon, corners (V, 2) counter-clockwise."""
        x, y, window = self._centres(corners, 0.0)
        inside = np.ones(np.broadcast_shapes(x.shape, y.shape), np.bool_)
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0
        self.cells[window] |= inside
        return self

    def grown(self, radius: float) -> BoolArray:
        """Return all cells within a radius of a drawn one."""
        whole = math.floor(radius)
        height, width = self.cells.shape
        padded = np.pad(self.cells, whole)
        result = np.zeros_like(self.cells)
        for row in range(-whole, whole + 1):
            for column in range(-whole, whole + 1):
                if row * row + column * column <= radius * radius:
                    result |= padded[
                        whole + row : whole + row + height, whole + column : whole + column + width
                    ]
        return result

    def _centres(
        self, points: Float64Array, reach: float
    ) -> tuple[Float64Array, Float64Array, tuple[slice, slice]]:
        """Return x (1, n) and y (m, 1) of the centres around points (P, 2), and their place."""
        height, width = self.cells.shape
        margin = reach + 1.0
        left, bottom = np.floor(points.min(axis=0) - margin).astype(int).tolist()
        right, top = np.ceil(points.max(axis=0) + margin).astype(int).tolist()
        left, bottom = min(max(left, 0), width), min(max(bottom, 0), height)
        right, top = max(min(right, width), left), max(min(top, height), bottom)
        box = self._box
        box[0], box[1] = min(box[0], left), min(box[1], bottom)
        box[2], box[3] = max(box[2], right), max(box[3], top)
        x = np.arange(left, right)[None, :] + 0.5
        y = np.arange(bottom, top)[:, None] + 0.5
        return x, y, (slice(bottom, top), slice(left, right))
