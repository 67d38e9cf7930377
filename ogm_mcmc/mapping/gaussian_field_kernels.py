"""Kernels of the Gaussian random field: one observation at a time, no matrix inverse ([field]).

field   `FieldArrays`; D is symmetric and D_ij is kept only for cells up to `radius` rows and
        columns apart. The row of cell i holds D_ij for the j above it and those right of it in
        its own row: rows[k, dr, radius + dc], dr >= 0; entries left of i in row 0 are unused.
        A cell that no observation has reached has no row: its D is still `start`.

Nothing is checked: cells must lie inside the field, and there must be room for
(2 radius + 1)^2 more rows.
"""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def gather(field, radius, row, column, out):
    """Collect D_ij of one cell j for all cells i around it, 0 outside of the field.

    out  (2 radius + 1, 2 radius + 1) float64, output
    """
    height, width = field.row_of.shape
    row_of, rows, start = field.row_of, field.rows, field.start
    for dr in range(-radius, radius + 1):
        for dc in range(-radius, radius + 1):
            r, c = row + dr, column + dc
            if r < 0 or c < 0 or r >= height or c >= width:
                out[dr + radius, dc + radius] = 0.0
                continue
            up, right, owner = dr, dc, row_of[row, column]
            if dr < 0 or (dr == 0 and dc < 0):
                up, right, owner = -dr, -dc, row_of[r, c]
            if owner < 0:
                out[dr + radius, dc + radius] = start[up, radius + right]
            else:
                out[dr + radius, dc + radius] = rows[owner, up, radius + right]


@njit(cache=True, nogil=True)
def observe(field, radius, variance, row, column, value, around):
    """Take in the first observation O_j of a cell.

    D_i <- D_i - D_ij / (sigma_j^2 + D_jj) D_j     [field] Eq. 24 with the current D
    l_i <- l_i + D_ij / (sigma_j^2 + D_jj) (O_j - l_j)
    Deviation: Eq. 24 as printed has K in place of D, which holds for the first step only.
    Cost: (2 radius + 1)^2 rows of at most (radius + 1) (2 radius + 1) elements.
    """
    height, width = field.row_of.shape
    row_of, rows, mean, used = field.row_of, field.rows, field.mean, field.used
    gather(field, radius, row, column, around)
    # Below 0 only where too much is dropped; then the gain still has the right sign.
    gain = 1.0 / (variance + max(0.0, around[radius, radius]))
    surprise = gain * (value - mean[row, column])
    for dr in range(max(-radius, -row), min(radius, height - 1 - row) + 1):
        for dc in range(max(-radius, -column), min(radius, width - 1 - column) + 1):
            d_ij = around[dr + radius, dc + radius]
            r, c = row + dr, column + dc
            if row_of[r, c] < 0:
                row_of[r, c] = used[0]
                rows[used[0]] = field.start
                used[0] += 1
            mean[r, c] += d_ij * surprise
            factor = d_ij * gain
            own = rows[row_of[r, c]]
            for up in range(min(radius, radius - dr) + 1):
                first = 0 if up == 0 else max(-radius, -radius - dc)
                last = min(radius, radius - dc)
                ours = own[up, radius + first : radius + last + 1]
                theirs = around[dr + up + radius, dc + first + radius : dc + last + radius + 1]
                for k in range(last - first + 1):
                    ours[k] -= factor * theirs[k]


@njit(cache=True, nogil=True)
def revise(field, radius, variance, row, column, change, around):
    """Change an observation by `change`: l_i <- l_i + D_ij / sigma_j^2 change ([field] Eq. 21).

    D does not depend on what was observed, so it stays ([field] section IV).
    """
    height, width = field.row_of.shape
    mean = field.mean
    gather(field, radius, row, column, around)
    for dr in range(max(-radius, -row), min(radius, height - 1 - row) + 1):
        for dc in range(max(-radius, -column), min(radius, width - 1 - column) + 1):
            mean[row + dr, column + dc] += around[dr + radius, dc + radius] * change / variance


@njit(cache=True, nogil=True)
def take_in(field, radius, variance, observed, row0, column0, start):
    """Take in what changed in a box of observations; return the row of it where no room is left.

    observed  (h, w) float32, nats, nan where there is no observation
    row0, column0  cell of the field that `observed[0, 0]` belongs to
    Returns h when all is taken in. Call it again with the row that it returns as `start`: what
    was taken in is known by then.
    """
    side = 2 * radius + 1
    around = np.empty((side, side), np.float64)
    taken = field.taken
    for line in range(start, observed.shape[0]):
        row = row0 + line
        for k in range(observed.shape[1]):
            column = column0 + k
            value, before = observed[line, k], taken[row, column]
            if value != value or value == before:
                continue
            if before != before:
                if field.rows.shape[0] - field.used[0] < side * side:
                    return line
                observe(field, radius, variance, row, column, np.float64(value), around)
            else:
                change = np.float64(value) - np.float64(before)
                revise(field, radius, variance, row, column, change, around)
            taken[row, column] = value
    return observed.shape[0]


@njit(cache=True, nogil=True)
def predict(field, radius, variance, prior_mean, length_scale, reach, points, mean, doubt):
    """Mean and variance of the field at any points, from its values at observed cells.

    With n the observed cells and k the covariances of a point with them ([field] Eq. 21 with the
    point in it):
    l = mu + k^T a,  a = (K_nn + sigma^2 I)^-1 (O - mu) = (O - l_n) / sigma^2
    v = 1 - k^T (K_nn + sigma^2 I)^-1 k = 1 - k^T (k - D_nn k / sigma^2) / sigma^2
    points  (N, 2) row and column, cells, 0.5 is the centre of cell 0; reach  cells, beyond which
    k is taken as 0; mean, doubt  (N,) output
    """
    height, width = field.row_of.shape
    side = 2 * radius + 1
    around = np.empty((side, side), np.float64)
    for n in range(points.shape[0]):
        y, x = points[n, 0] - 0.5, points[n, 1] - 0.5
        first_row, last_row = max(0, math.ceil(y - reach)), min(height, math.floor(y + reach) + 1)
        first, last = max(0, math.ceil(x - reach)), min(width, math.floor(x + reach) + 1)
        near = np.zeros((max(0, last_row - first_row), max(0, last - first)))
        for r in range(first_row, last_row):
            for c in range(first, last):
                if field.taken[r, c] == field.taken[r, c]:
                    squared = (r - y) ** 2 + (c - x) ** 2
                    near[r - first_row, c - first] = math.exp(-squared / (2.0 * length_scale))
        total, known = prior_mean, 0.0
        for r in range(first_row, last_row):
            for c in range(first, last):
                k = near[r - first_row, c - first]
                if k == 0.0:
                    continue
                total += k * (np.float64(field.taken[r, c]) - field.mean[r, c]) / variance
                gather(field, radius, r, c, around)
                carried = 0.0
                for i in range(max(first_row, r - radius), min(last_row, r + radius + 1)):
                    for j in range(max(first, c - radius), min(last, c + radius + 1)):
                        carried += (
                            around[i - r + radius, j - c + radius] * near[i - first_row, j - first]
                        )
                known += k * (k - carried / variance) / variance
        mean[n], doubt[n] = total, 1.0 - known
