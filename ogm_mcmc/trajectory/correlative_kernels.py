"""Kernels of the look-up of a scan in a field of what other scans saw."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def paint(field, kernel, columns, rows):
    """Raise the field (H, W) to the kernel (2 r + 1, 2 r + 1) around every point."""
    height, width = field.shape
    reach = kernel.shape[0] // 2
    for i in range(columns.size):
        for a in range(-reach, reach + 1):
            for b in range(-reach, reach + 1):
                r, c = rows[i] + a, columns[i] + b
                if 0 <= r < height and 0 <= c < width:
                    field[r, c] = max(field[r, c], kernel[a + reach, b + reach])


@njit(cache=True, nogil=True)
def paint_free(field, x, y, to_x, to_y, short, below, value):
    """Lower cells of the field (H, W) to `value` along beams from (x, y), lengths in cells.

    to_x, to_y  (n,) where they end; short: so much before that nothing is known to be free
    below       cells that hold more stay as they are: others saw something there
    """
    height, width = field.shape
    for i in range(to_x.size):
        dx, dy = to_x[i] - x, to_y[i] - y
        length = math.hypot(dx, dy)
        steps = int(2.0 * (length - short))
        for k in range(steps):
            share = 0.5 * k / length
            r, c = int(y + share * dy), int(x + share * dx)
            if 0 <= r < height and 0 <= c < width and field[r, c] < below:
                field[r, c] = value


@njit(cache=True, nogil=True)
def best_pose(field, points, at, mean, precision, reach, step, turns, turn, scale):
    """Return (score, x, y, yaw), the best pose on a lattice around `at`.

    field      (H, W) log-likelihood of a point, cells of 1 / scale m; outside nothing is said
    points     (n, 2) m, in the frame of the sensor
    at, mean   (3,) m, m, rad, x and y from the corner of the field; precision (3, 3), 1 / (m, rad)
    reach      steps of `step` m to every side; turns: steps of `turn` rad
    The score is the sum over points and the log-density of the belief. Of equal ones the first.
    """
    height, width = field.shape
    n = points.shape[0]
    x, y = np.empty(n), np.empty(n)
    best, best_x, best_y, best_yaw = -math.inf, at[0], at[1], at[2]
    for k in range(-turns, turns + 1):
        yaw = at[2] + k * turn
        cosine, sine = math.cos(yaw) * scale, math.sin(yaw) * scale
        for i in range(n):
            x[i] = cosine * points[i, 0] - sine * points[i, 1]
            y[i] = sine * points[i, 0] + cosine * points[i, 1]
        c = (yaw - mean[2] + math.pi) % (2.0 * math.pi) - math.pi
        for row in range(-reach, reach + 1):
            to_y = at[1] + row * step
            b = to_y - mean[1]
            for column in range(-reach, reach + 1):
                to_x = at[0] + column * step
                a = to_x - mean[0]
                score = -0.5 * (
                    precision[0, 0] * a * a + precision[1, 1] * b * b + precision[2, 2] * c * c
                ) - (precision[0, 1] * a * b + precision[0, 2] * a * c + precision[1, 2] * b * c)
                over_x, over_y = to_x * scale, to_y * scale
                for i in range(n):
                    u, v = int(x[i] + over_x), int(y[i] + over_y)
                    if 0 <= u < width and 0 <= v < height:
                        score += field[v, u]
                if score > best:
                    best, best_x, best_y, best_yaw = score, to_x, to_y, yaw
    return best, best_x, best_y, best_yaw
