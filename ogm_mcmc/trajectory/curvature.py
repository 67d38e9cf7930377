"""How much less points hold poses than the quadratic model of surfels says.

The model keeps surfels as they are while poses move. In truth they give way: lines turn with the
points, points pass to other squares, wide ones lose their weight. So the gradient g of the points
changes less than by its Hessian H when poses move by d, and what was measured of it stands for
the rest:

    held = d . (g(x - d) - g(x + d)) / 2 d . H d,     d drawn from the model itself

Robust weights alone take away all but a share `slope`, and that is in the variance of a point
already. An M-estimator (Huber 1967) that is held by `held` instead scatters slope / held times as
far as the model says: the noise of points is so many times as large in what is drawn. That of
beliefs is not: where the map lies as a whole, points do not tell.

Nor are points of one wall independent: that it is no line, and lies deeper seen from aside, all of
them share. What poses take from a draw d is a sum over points, w r (n . d - its mean on the line).
Summed over squares of 1.6 m (clusters of a sandwich: Liang and Zeger 1986) it has the variance

    shown = sum over squares of (sum of w r (n . d - mean))^2 / slope^2 freedom d . H d

as a share of that of independent points. Of single scans that is .5 to .9, for poses were fitted
to these points; what differs from recording to recording counts, and `trajectory.inflation` is the
rest. Of stretches that move as one (`in_common`: d, smoothed by steps of damped Jacobi) it may be
more, where a common error of many points does not average out: twice as much in a copy of Intel,
whose stretches of 130 scans were off together. Their noise is drawn wider by that.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.trajectory.normal_equations import ACCURACY, NormalEquations
from ogm_mcmc.trajectory.points import ScanPoints, wrapped
from ogm_mcmc.trajectory.surfel_kernels import centre
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

__all__ = [
    'ROUGHLY',
    'drawn_deviation',
    'held_share',
    'in_common',
    'map_squares',
    'numbers_fitted',
    'shown_variance',
    'widening',
]

# Less than this is not believed: deviations would be more than ten times those of the model.
LEAST_HELD = 0.1

# Points that end in one square of this side, m, may err together.
SQUARE_M = 1.6

# Less variance than this share is not believed: points without any error show none.
LEAST_SHOWN = 0.1

# Steps of damped Jacobi, and their length: what a scan does by itself is gone after so many.
SMOOTHED = 4
DAMPING = 0.5

# What holds poses so much less than the points of each scan would, their lines fixed, is rounding.
ROUNDING = 1e-12

# Accurate enough for a sum over all poses.
ROUGHLY = 0.03


def held_share(
    system: SurfelSystem,
    points: ScanPoints,
    poses: Float64Array,
    stage: Stage,
    deviation: Float64Array,
) -> float:
    """Return how much of what `system` around poses (K, 3) says they are held by, 0.1 to 1.

    deviation  (K, 3), along which that is measured
    """
    expected = _expected(system, deviation)
    if expected == 0.0:
        return 1.0
    gradients = []
    for sign in (1.0, -1.0):
        there = SurfelSystem.around(points, wrapped(poses + sign * deviation), stage)
        # Of the points, not of what their spread is taken for: that is the same on both sides.
        gradients.append(there.gradient * (there.variance / system.variance))
    found = 0.5 * float((deviation * (gradients[1] - gradients[0])).sum())
    return float(np.clip(found / expected, LEAST_HELD, 1.0))


def drawn_deviation(
    equations: NormalEquations,
    rng: np.random.Generator,
    wider: float = 1.0,
    accuracy: float = ACCURACY,
    together: float = 1.0,
) -> Float64Array:
    """Draw how far poses (K, 3) may be from where they are, from the quadratic model.

    Points scatter so many times `wider` than it says (a sandwich: Huber 1967), and `together`
    times more in what stretches of scans have in common.
    """
    right = wider * equations.system.noise(rng)
    if together != 1.0:
        # Solved for, that is what points do to poses, and (together - 1) `in_common` of it more.
        smooth = right
        for _ in range(SMOOTHED):
            smooth = smooth - DAMPING * equations.times(equations.each_alone(smooth))
        right = right + (together - 1.0) * smooth
    noise = equations.factors.noise(equations.at, rng)
    return equations.solve(right + noise, accuracy=accuracy)


def in_common(equations: NormalEquations, deviation: Float64Array) -> Float64Array:
    """Return what stretches of scans have in common of a deviation (K, 3)."""
    left = deviation
    for _ in range(SMOOTHED):
        left = left - DAMPING * equations.each_alone(equations.times(left))
    return left


def map_squares(points: ScanPoints, poses: Float64Array, system: SurfelSystem) -> Int64Array:
    """Return the number of the square of the map that every entry (A,) of `system` ends in."""
    cell = np.floor(points.placed(poses) / SQUARE_M).astype(np.int64)
    cell -= cell.min(axis=0)
    _, square = np.unique(cell[:, 1] * (cell[:, 0].max() + 1) + cell[:, 0], return_inverse=True)
    return np.asarray(square.reshape(-1)[system.point], np.int64)


def shown_variance(system: SurfelSystem, square: Int64Array, deviation: Float64Array) -> float:
    """Return the variance that points show along a deviation (K, 3), 1: as independent ones have.

    square  (A,) those entries of the system that may err together have the same number
    """
    expected = _expected(system, deviation)
    if expected == 0.0:
        return 1.0
    along = np.einsum('ai,ai->a', system.jacobian, deviation[system.scan])
    mean = np.empty(system.total.size)
    centre(along, system.weight, system.surfel, system.total, mean)
    pulls = system.weight * system.residual * (along - mean[system.surfel])
    together = np.bincount(square, pulls)
    independent = system.slope**2 * system.freedom * expected
    return max(float((together**2).sum()) / independent, LEAST_SHOWN)


def _expected(system: SurfelSystem, deviation: Float64Array) -> float:
    """Return d . H d of a deviation d (K, 3); 0 where it would be of rounding alone.

    So it is where lines go with all that saw them, such as those of one scan that is shifted.
    """
    expected = float((deviation * system.times(deviation)).sum())
    alone = float(np.einsum('ki,kij,kj->', deviation, system.blocks, deviation))
    return expected if expected > ROUNDING * alone else 0.0


def numbers_fitted(system: SurfelSystem, drawn: Float64Array) -> float:
    """Return how many numbers of the poses points decide, 0 to 3 K: tr(H (H + F)^-1).

    H is the precision by points, F that by factors. It is what d . H d is in the mean over draws
    d of the poses (`drawn_deviation`); one draw (K, 3) is enough, for it is a sum over all.
    """
    return float((drawn * system.times(drawn)).sum())


def widening(system: SurfelSystem, held: float) -> float:
    """Return how many times wider than the model says points scatter that hold by `held`."""
    return max(system.slope / held, 1.0)
