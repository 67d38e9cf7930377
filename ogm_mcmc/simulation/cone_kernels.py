"""The nearest point of walls, or of occupied cells, in the cone of a sonar.

A cone narrower than half a turn is where two half-planes meet, and so cuts one piece out of a
segment; the nearest point of that piece is the foot of the perpendicular, or the end next to it.
Nothing is sampled: no wall is too thin to be heard. Coordinates `along` and `across` are those of
the cone: the sensor in the origin, the axis to the right.
"""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def nearest_on_segment(along_a, across_a, along_b, across_b, cosine, sine, point):
    """Squared distance to the nearest point of a segment within the cone, inf if it has none.

    cosine, sine  of half the opening angle, below a quarter turn
    point         (2,) output: where that is
    """
    step_along, step_across = along_b - along_a, across_b - across_a
    first, last = 0.0, 1.0
    for side in (-1.0, 1.0):
        inside = sine * along_a + side * cosine * across_a
        change = sine * step_along + side * cosine * step_across
        if change == 0.0:
            if inside < 0.0:
                return math.inf
        elif change > 0.0:
            first = max(first, -inside / change)
        else:
            last = min(last, -inside / change)
    if first > last:
        return math.inf
    length = step_along * step_along + step_across * step_across
    share = 0.0
    if length > 0.0:
        share = -(along_a * step_along + across_a * step_across) / length
    share = min(max(share, first), last)
    point[0] = along_a + share * step_along
    point[1] = across_a + share * step_across
    return point[0] * point[0] + point[1] * point[1]


@njit(cache=True, nogil=True)
def nearest_wall(walls, x, y, heading_cosine, heading_sine, cosine, sine):
    """Distance to the nearest point of any wall (S, 4) in a cone at (x, y), inf if there is none.

    heading_cosine, heading_sine  of the axis; cosine, sine  of half the opening angle
    """
    nearest = math.inf
    point = np.empty(2)
    for wall in range(walls.shape[0]):
        ax, ay = walls[wall, 0] - x, walls[wall, 1] - y
        bx, by = walls[wall, 2] - x, walls[wall, 3] - y
        squared = nearest_on_segment(
            ax * heading_cosine + ay * heading_sine, ay * heading_cosine - ax * heading_sine,
            bx * heading_cosine + by * heading_sine, by * heading_cosine - bx * heading_sine,
            cosine, sine, point,
        )  # fmt: skip
        nearest = min(nearest, squared)
    return math.sqrt(nearest)


@njit(cache=True, nogil=True)
def nearest_cell(
    occupied, x, y, heading_cosine, heading_sine, cosine, sine, reach, depth
):  # fmt: skip
    """Distance to the nearest occupied cell in a cone at (x, y), cells; inf if none in reach.

    occupied  (height, width) uint8; outside of it there is nothing
    heading_cosine, heading_sine  of the axis; cosine, sine  of half the opening angle
    depth  how far in that cell the echo comes from: share of the way of a beam through it
    0 where the sensor is in an occupied cell or touches one.
    """
    height, width = occupied.shape
    best, column_of, row_of = reach * reach, -1, -1
    found_x = found_y = 0.0
    point = np.empty(2)
    for row in range(max(0, math.floor(y - reach)), min(height, math.floor(y + reach) + 1)):
        for column in range(max(0, math.floor(x - reach)), min(width, math.floor(x + reach) + 1)):
            if not occupied[row, column]:
                continue
            left, right, low, high = column - x, column + 1.0 - x, row - y, row + 1.0 - y
            beside, above = max(left, -right, 0.0), max(low, -high, 0.0)
            if beside == 0.0 and above == 0.0:
                return 0.0
            if beside * beside + above * above > best:
                continue
            # Only the sides that face the sensor: a beam to another one crosses one of them first.
            for side in range(2):
                if side == 0:
                    if beside == 0.0:
                        continue
                    ax = bx = left if left > 0.0 else right
                    ay, by = low, high
                else:
                    if above == 0.0:
                        continue
                    ax, bx = left, right
                    ay = by = low if low > 0.0 else high
                squared = nearest_on_segment(
                    ax * heading_cosine + ay * heading_sine,
                    ay * heading_cosine - ax * heading_sine,
                    bx * heading_cosine + by * heading_sine,
                    by * heading_cosine - bx * heading_sine,
                    cosine, sine, point,
                )  # fmt: skip
                if squared < best or (column_of < 0 and squared == best):
                    best, column_of, row_of = squared, column, row
                    found_x = point[0] * heading_cosine - point[1] * heading_sine
                    found_y = point[0] * heading_sine + point[1] * heading_cosine
    if column_of < 0:
        return math.inf
    # The beam to that point leaves the cell at this multiple of the way to it.
    leaves = math.inf
    if found_x != 0.0:
        leaves = (column_of + (1.0 if found_x > 0.0 else 0.0) - x) / found_x
    if found_y != 0.0:
        leaves = min(leaves, (row_of + (1.0 if found_y > 0.0 else 0.0) - y) / found_y)
    return math.sqrt(best) * (1.0 + depth * max(leaves - 1.0, 0.0))
