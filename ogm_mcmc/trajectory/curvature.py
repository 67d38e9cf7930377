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
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.trajectory.factors import Linearised, PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints, wrapped
from ogm_mcmc.trajectory.surfels import ACCURACY, Stage, SurfelSystem, solve

__all__ = ['ROUGHLY', 'drawn_deviation', 'held_share', 'numbers_fitted', 'widening']

# Less than this is not believed: deviations would be more than ten times those of the model.
LEAST_HELD = 0.1

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
    expected = float((deviation * system.times(deviation)).sum())
    if expected <= 0.0:
        return 1.0
    gradients = []
    for sign in (1.0, -1.0):
        there = SurfelSystem.around(points, wrapped(poses + sign * deviation), stage)
        # Of the points, not of what their spread is taken for: that is the same on both sides.
        gradients.append(there.gradient * (there.variance / system.variance))
    found = 0.5 * float((deviation * (gradients[1] - gradients[0])).sum())
    return float(np.clip(found / expected, LEAST_HELD, 1.0))


def drawn_deviation(
    system: SurfelSystem,
    factors: PoseFactors,
    at: Linearised,
    rng: np.random.Generator,
    wider: float = 1.0,
    accuracy: float = ACCURACY,
) -> Float64Array:
    """Draw how far poses (K, 3) may be from where they are, from the quadratic model.

    Points scatter so many times `wider` than it says (a sandwich: Huber 1967).
    """
    right = wider * system.noise(rng) + factors.noise(at, rng)
    return solve(system, factors, at, right, accuracy=accuracy)


def numbers_fitted(system: SurfelSystem, drawn: Float64Array) -> float:
    """Return how many numbers of the poses points decide, 0 to 3 K: tr(H (H + F)^-1).

    H is the precision by points, F that by factors. It is what d . H d is in the mean over draws
    d of the poses (`drawn_deviation`); one draw (K, 3) is enough, for it is a sum over all.
    """
    return float((drawn * system.times(drawn)).sum())


def widening(system: SurfelSystem, held: float) -> float:
    """Return how many times wider than the model says points scatter that hold by `held`."""
    return max(system.slope / held, 1.0)
