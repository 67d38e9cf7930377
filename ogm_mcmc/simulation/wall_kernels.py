"""Beams against straight walls."""

from __future__ import annotations

import math

from numba import njit

__all__ = ['first_walls']


@njit(cache=True, nogil=True)
def first_walls(walls, x, y, yaw, bearings, ranges):
    """Distance from (x, y) to the first wall along each bearing, inf where there is none.

    walls     (S, 4) float64  x1, y1, x2, y2, m
    bearings  (B,)   float64  rad, from the heading `yaw`
    ranges    (B,)   float64  written: m
    A beam p + r d meets a wall from a to b where its ends lie on different sides of the beam:
    p + r d = a + s (b - a), 0 <= s <= 1, r > 0. Cost: O(B * S).
    """
    for beam in range(bearings.size):
        dx, dy = math.cos(yaw + bearings[beam]), math.sin(yaw + bearings[beam])
        nearest = math.inf
        for wall in range(walls.shape[0]):
            ax, ay = walls[wall, 0] - x, walls[wall, 1] - y
            bx, by = walls[wall, 2] - x, walls[wall, 3] - y
            side_a, side_b = dx * ay - dy * ax, dx * by - dy * bx
            if side_a * side_b > 0.0 or side_a == side_b:
                continue
            distance = (ax * by - ay * bx) / (side_b - side_a)
            if 0.0 < distance < nearest:
                nearest = distance
        ranges[beam] = nearest
