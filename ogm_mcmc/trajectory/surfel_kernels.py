"""Kernels of the alignment over surfels; the model is in `ogm_mcmc.trajectory.surfels`.

N points of K scans in L layers of surfels, in one row of A entries: an entry is a point in one
layer.
"""

import math

from numba import njit

# Numbers of a surfel while it is summed up.
SUMS = 6

# Fewer points make no line.
FEWEST = 3.0


@njit(cache=True, nogil=True)
def sum_up(x, y, surfel, sums):
    """Add weight 1, x, y, x x, x y, y y of every point to its surfel: sums (V, 6)."""
    sums[:] = 0.0
    for i in range(x.size):
        v = surfel[i]
        sums[v, 0] += 1.0
        sums[v, 1] += x[i]
        sums[v, 2] += y[i]
        sums[v, 3] += x[i] * x[i]
        sums[v, 4] += x[i] * y[i]
        sums[v, 5] += y[i] * y[i]


@njit(cache=True, nogil=True)
def fit_lines(sums, flatness, least_length, line):
    """Fit a line to every surfel: line (V, 5), normal x y, mean x y, 1 where it is one.

    It is one where the variance across is below `flatness` of that along, and that along above
    least_length ** 2.
    """
    for v in range(sums.shape[0]):
        line[v, 4] = 0.0
        n = sums[v, 0]
        if n < 1.0:
            continue
        mean_x, mean_y = sums[v, 1] / n, sums[v, 2] / n
        a = sums[v, 3] / n - mean_x * mean_x
        b = sums[v, 4] / n - mean_x * mean_y
        c = sums[v, 5] / n - mean_y * mean_y
        angle = 0.5 * math.atan2(2.0 * b, a - c) + 0.5 * math.pi
        line[v, 0], line[v, 1] = math.cos(angle), math.sin(angle)
        line[v, 2], line[v, 3] = mean_x, mean_y
        middle, half = 0.5 * (a + c), math.sqrt(0.25 * (a - c) ** 2 + b * b)
        across, along = max(middle - half, 0.0), middle + half
        if n >= FEWEST and across < flatness * along and along > least_length**2:
            line[v, 4] = 1.0


@njit(cache=True, nogil=True)
def choose_sides(x, y, sensor_x, sensor_y, surfel, line, sided):
    """Split surfels by the side they were seen from: sided (N,) is 2 v or 2 v + 1."""
    for i in range(x.size):
        v = surfel[i]
        towards = line[v, 0] * (sensor_x[i] - x[i]) + line[v, 1] * (sensor_y[i] - y[i])
        sided[i] = 2 * v + (1 if towards > 0.0 else 0)


@njit(cache=True, nogil=True)
def weigh(x, y, sensor_x, sensor_y, surfel, line, cut, share, residual, jacobian, weight):
    """Fill the entries of one layer: distance from the line, its derivatives, a weight.

    weight  share / (1 + (r / (2 cut))^2)^2, 0 where there is no line
    """
    for i in range(x.size):
        v = surfel[i]
        weight[i] = 0.0
        if line[v, 4] == 0.0:
            continue
        nx, ny = line[v, 0], line[v, 1]
        r = nx * (x[i] - line[v, 2]) + ny * (y[i] - line[v, 3])
        residual[i] = r
        jacobian[i, 0], jacobian[i, 1] = nx, ny
        jacobian[i, 2] = ny * (x[i] - sensor_x[i]) - nx * (y[i] - sensor_y[i])
        inner = 1.0 / (1.0 + 0.25 * (r / cut) ** 2)
        weight[i] = share * inner * inner


@njit(cache=True, nogil=True)
def centre(values, weight, surfel, total, mean):
    """Fill mean (V,) with the weighted mean of the values (A,) of every surfel."""
    mean[:] = 0.0
    for i in range(values.size):
        mean[surfel[i]] += weight[i] * values[i]
    for v in range(mean.size):
        if total[v] > 0.0:
            mean[v] /= total[v]


@njit(cache=True, nogil=True)
def gather(off, jacobian, weight, scan, out):
    """Add J^T w off of the entries to their scans: out (K, 3)."""
    for i in range(off.size):
        k, value = scan[i], weight[i] * off[i]
        out[k, 0] += value * jacobian[i, 0]
        out[k, 1] += value * jacobian[i, 1]
        out[k, 2] += value * jacobian[i, 2]


@njit(cache=True, nogil=True)
def own_blocks(jacobian, weight, scan, blocks):
    """Add w J J^T of the entries to their scans: blocks (K, 3, 3)."""
    for i in range(weight.size):
        k = scan[i]
        for a in range(3):
            for b in range(3):
                blocks[k, a, b] += weight[i] * jacobian[i, a] * jacobian[i, b]


@njit(cache=True, nogil=True)
def times_precision(x, jacobian, weight, surfel, scan, total, along, mean, out):
    """Add J^T W (I - mean over surfels) J x to out (K, 3); along (A,), mean (V,) are scratch."""
    for i in range(weight.size):
        k = scan[i]
        along[i] = jacobian[i, 0] * x[k, 0] + jacobian[i, 1] * x[k, 1] + jacobian[i, 2] * x[k, 2]
    centre(along, weight, surfel, total, mean)
    for i in range(weight.size):
        along[i] -= mean[surfel[i]]
    gather(along, jacobian, weight, scan, out)
