"""Beams against straight walls."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ['first_walls']

TURN = 2.0 * math.pi

# Beams that pass the end of a wall so nearly, rad, are looked at, too: more than rounding.
MARGIN = 1e-6


@njit(cache=True, nogil=True)
def place_of(rising, value):
    """Return how many numbers of rising ones are below a value, by halving."""
    low, high = 0, rising.size
    while low < high:
        middle = (low + high) // 2
        if rising[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def meet(wall, x, y, dx, dy, first, last, ranges):
    """Lower the `ranges` of the beams from `first` to `last` - 1 to their distance from a wall.

    A beam p + r d meets a wall from a to b where its ends lie on different sides of the beam:
    p + r d = a + s (b - a), 0 <= s <= 1, r > 0.
    """
    ax, ay, bx, by = wall[0] - x, wall[1] - y, wall[2] - x, wall[3] - y
    for beam in range(first, last):
        side_a = dx[beam] * ay - dy[beam] * ax
        side_b = dx[beam] * by - dy[beam] * bx
        if side_a * side_b > 0.0 or side_a == side_b:
            continue
        distance = (ax * by - ay * bx) / (side_b - side_a)
        if 0.0 < distance < ranges[beam]:
            ranges[beam] = distance


@njit(cache=True, nogil=True)
def first_walls(walls, x, y, yaw, bearings, ranges):
    """Distance from (x, y) to the first wall along each bearing, inf where there is none.

    walls     (S, 4) float64  x1, y1, x2, y2, m
    bearings  (B,)   float64  rad, from the heading `yaw`
    ranges    (B,)   float64  written: m
    Cost: O(S log B + pairs of a wall and a beam that points at it) where bearings rise, else
    O(B S). Of 424 walls 1080 beams all around look at one in a hundred.
    """
    n_beams = bearings.size
    dx, dy = np.empty(n_beams), np.empty(n_beams)
    rising = n_beams > 0
    for beam in range(n_beams):
        dx[beam], dy[beam] = math.cos(yaw + bearings[beam]), math.sin(yaw + bearings[beam])
        ranges[beam] = math.inf
        rising = rising and (beam == 0 or bearings[beam - 1] <= bearings[beam])
    for number in range(walls.shape[0]):
        wall = walls[number]
        ax, ay, bx, by = wall[0] - x, wall[1] - y, wall[2] - x, wall[3] - y
        # The wall lies in a sector, less than half a turn, from one end to the other.
        turn = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        if not rising or abs(turn) > math.pi - MARGIN:
            meet(wall, x, y, dx, dy, 0, n_beams, ranges)
            continue
        end = math.atan2(ay, ax) - yaw
        low, high = end + min(turn, 0.0) - MARGIN, end + max(turn, 0.0) + MARGIN
        turns = math.ceil((bearings[0] - high) / TURN)
        while low + turns * TURN <= bearings[-1]:
            first = place_of(bearings, low + turns * TURN)
            last = place_of(bearings, high + turns * TURN)
            meet(wall, x, y, dx, dy, first, last, ranges)
            turns += 1
