"""Poses of all scans at once, from what they saw of the same surfaces.

The model. Space is cut into squares of side h, and each of them into the two sides it can be seen
from. What scans saw there lies on one line, at a distance that is unknown (a flat prior) and is
integrated out; n the normal, p_i(x) a point as placed by the pose of its scan:

    log p(z | x) = -1/2 sum over surfels of [ sum_i w_i r_i^2 - (sum_i w_i r_i)^2 / sum_i w_i ]
    r_i = n . p_i(x),  w_i = f(r_i / cut) / variance

f makes points that are no part of the line count little (Geman and McClure). Squares lie in four
layers, shifted by half a side, each with a quarter of the weight. Together with the factors of
`ogm_mcmc.trajectory.factors` this is quadratic around given poses; `normal_equations` solves for
all poses together. Eliminating the surfaces is what BALM does for three dimensions (Liu and Zhang
2021, "BALM: Bundle Adjustment for Lidar Mapping").
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int64Array
from ogm_mcmc.trajectory.points import ScanPoints
from ogm_mcmc.trajectory.surfel_kernels import (
    SUMS,
    centre,
    choose_sides,
    fit_lines,
    gather,
    own_blocks,
    sum_up,
    times_precision,
    weigh,
)

__all__ = ['Stage', 'SurfelSystem']

LAYERS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))

# A line is at least so many sides long (standard deviation of the points along it).
LEAST_LENGTH = 0.125

# Points are left at least such a share of their number to show how they scatter.
LEAST_FREEDOM = 0.1


class Stage(NamedTuple):
    """One stage of an alignment: squares of `side_m`; points further than about twice `cut_m`
    from a line do not count; a line is `flatness` times as narrow as long (variances).
    """  # noqa: D205

    side_m: float
    cut_m: float
    flatness: float
    steps: int


class SurfelSystem(NamedTuple):
    """The log-likelihood around poses: A entries of V surfels, see `surfel_kernels`.

    Entry a is point `point[a]`, of scan `scan[a]`, in one of the layers.

    `variance` is that of a point around its line, m^2, as the points themselves show it; `slope`
    is the mean change of r f(r / cut) with r, as a share of the mean weight, `doubt`
    the standard deviation of the variance, as a share of it, points taken for independent.
    `freedom` is the share of the points that is left to show it: lines and poses took the rest.
    """

    residual: Float64Array
    jacobian: Float64Array
    weight: Float64Array
    surfel: Int64Array
    point: Int64Array
    scan: Int64Array
    total: Float64Array
    blocks: Float64Array
    gradient: Float64Array
    variance: float
    slope: float
    doubt: float
    freedom: float

    @classmethod
    def around(
        cls, points: ScanPoints, poses: Float64Array, stage: Stage, fitted: float = 0.0
    ) -> SurfelSystem:
        """Fit the surfels to the points as the poses (K, 3) place them.

        fitted  so many numbers of the poses the points decide, see `curvature.numbers_fitted`
        """
        residual, jacobian, weight, surfel, point = _entries(points, poses, stage)
        scan = points.scan[point]
        shift = int(surfel.max(initial=-1)) + 1
        total: Float64Array = np.bincount(surfel, weight, minlength=shift).astype(np.float64)
        mean = np.empty(shift)
        centre(residual, weight, surfel, total, mean)
        off = residual - mean[surfel]
        lines = int(np.count_nonzero(total))
        variance, slope, doubt, freedom = _spread(off, weight, lines, stage.cut_m, fitted)
        weight /= variance
        total /= variance
        n_scans = points.n_scans
        gradient, blocks = np.zeros((n_scans, 3)), np.zeros((n_scans, 3, 3))
        gather(-off, jacobian, weight, scan, gradient)
        own_blocks(jacobian, weight, scan, blocks)
        solved = total, blocks, gradient, variance, slope, doubt, freedom
        return cls(off, jacobian, weight, surfel, point, scan, *solved)

    def times(self, x: Float64Array) -> Float64Array:
        """Return the precision times x (K, 3)."""
        out = np.zeros_like(x)
        along, mean = np.empty(self.weight.size), np.empty(self.total.size)
        times_precision(
            x, self.jacobian, self.weight, self.surfel, self.scan, self.total, along, mean, out
        )
        return out

    def noise(self, rng: np.random.Generator) -> Float64Array:
        """Draw (K, 3) with the precision as its covariance."""
        white = rng.standard_normal(self.weight.size) / np.sqrt(self.weight)
        mean = np.empty(self.total.size)
        centre(white, self.weight, self.surfel, self.total, mean)
        out = np.zeros_like(self.gradient)
        gather(white - mean[self.surfel], self.jacobian, self.weight, self.scan, out)
        return out


def _entries(
    points: ScanPoints, poses: Float64Array, stage: Stage
) -> tuple[Float64Array, Float64Array, Float64Array, Int64Array, Int64Array]:
    """Return residual, Jacobian, weight, surfel and point of those entries that count."""
    parts: list[tuple[AnyArray, ...]] = []
    shift = 0
    for offset in LAYERS:
        residual, jacobian, weight, surfel, n_surfels = _layer(points, poses, stage, offset)
        used = np.flatnonzero(weight > 0.0)
        parts.append((residual[used], jacobian[used], weight[used], surfel[used] + shift, used))
        shift += n_surfels
    residual, jacobian, weight, surfel, point = (
        np.concatenate(arrays) for arrays in zip(*parts, strict=True)
    )
    return residual, jacobian, weight, surfel, point


def _spread(
    off: Float64Array, weight: Float64Array, surfels: int, cut_m: float, fitted: float
) -> tuple[float, float, float, float]:
    """Return variance (of a point that counts in full, m^2), slope, doubt and freedom of a system.

    The variance is such that (sum of weights) / variance is the information that the points have
    of a common distance: sum psi'(r)^2 / sum psi(r)^2 for the influence psi(r) = f(r / cut) r
    (Huber 1964).
    """
    if off.size == 0:
        return 1.0, 1.0, 1.0, 1.0
    squares = 0.25 * (off / cut_m) ** 2
    share = 1.0 / len(LAYERS)
    influence = (weight / share * off) ** 2 * share
    weights = float(weight.sum())
    slope = float((weight * (1.0 - 4.0 * squares / (1.0 + squares))).sum()) / weights
    points = share * off.size
    # Where a line is and how it runs was taken from the points themselves, and so were poses.
    freedom = max(1.0 - (2.0 * share * surfels + fitted) / points, LEAST_FREEDOM)
    slope = max(slope, 0.1)
    variance = float(influence.sum()) / (slope**2 * weights * freedom)
    middle = max(float(influence.mean()), 1e-30)
    doubt = float(influence.std()) / middle / np.sqrt(points * freedom)
    return max(variance, 1e-8), slope, doubt, freedom


def _layer(
    points: ScanPoints, poses: Float64Array, stage: Stage, offset: tuple[float, float]
) -> tuple[Float64Array, Float64Array, Float64Array, Int64Array, int]:
    """Return the entries of one layer and the number of its surfels."""
    placed = points.placed(poses)
    # Sums of squares lose digits far from where they are counted from.
    origin = np.floor(placed.min(axis=0) / stage.side_m) * stage.side_m
    cell = np.floor(placed / stage.side_m + offset).astype(np.int64)
    cell -= cell.min(axis=0)
    _, surfel = np.unique(cell[:, 1] * (cell[:, 0].max() + 1) + cell[:, 0], return_inverse=True)
    surfel = surfel.reshape(-1).astype(np.int64)
    n_squares = int(surfel.max()) + 1
    x, y = np.ascontiguousarray((placed - origin).T)
    sensor_x, sensor_y = np.ascontiguousarray((poses[points.scan, :2] - origin).T)
    sums, line = np.empty((n_squares, SUMS)), np.zeros((n_squares, 5))
    least = LEAST_LENGTH * stage.side_m
    sum_up(x, y, surfel, sums)
    fit_lines(sums, stage.flatness, least, line)
    sided = np.empty_like(surfel)
    choose_sides(x, y, sensor_x, sensor_y, surfel, line, sided)
    sums, line = np.empty((2 * n_squares, SUMS)), np.zeros((2 * n_squares, 5))
    sum_up(x, y, sided, sums)
    fit_lines(sums, stage.flatness, least, line)
    residual, jacobian, weight = np.empty(x.size), np.empty((x.size, 3)), np.empty(x.size)
    share = 1.0 / len(LAYERS)
    weigh(x, y, sensor_x, sensor_y, sided, line, stage.cut_m, share, residual, jacobian, weight)
    return residual, jacobian, weight, sided, 2 * n_squares
