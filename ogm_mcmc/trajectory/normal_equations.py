"""The quadratic model of points and factors around some poses, and one step of an alignment.

What points on lines (`surfels`) and what is known besides (`factors`) say around poses is solved
for all poses together by conjugate gradients: a product costs one pass over the points, nothing
of the size K x K is ever made.

A draw of the poses is a solution for a gradient with the precision as its covariance
(perturb and solve: Papandreou and Yuille 2010): exact for the quadratic model, one solution each.
`curvature` draws them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.trajectory.factors import Linearised, PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints, wrapped
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

__all__ = ['ACCURACY', 'NormalEquations', 'align']

# Conjugate gradients stop when the gradient is so small a part of what it was.
ACCURACY = 1e-4


class NormalEquations(NamedTuple):
    """Gradient and precision of log p around poses: `system` of the points, `factors` and these
    linearised, `at`. With them what preconditions: `inverse` (K, 3, 3) of the blocks of the scans
    and, where errors of beliefs are alike, `soft` (3, 3), the covariance of a motion of all.
    """  # noqa: D205

    system: SurfelSystem
    factors: PoseFactors
    at: Linearised
    inverse: Float64Array
    soft: Float64Array | None

    @classmethod
    def around(
        cls, system: SurfelSystem, factors: PoseFactors, poses: Float64Array
    ) -> NormalEquations:
        """Add factors to the system that was made around the same poses (K, 3)."""
        at = factors.linearised(poses)
        inverse: Float64Array = np.linalg.inv(system.blocks + at.blocks).astype(np.float64)
        without = cls(system, factors, at, inverse, None)
        if not len(at.rigid):
            return without
        stiff = np.array([without.times(mode) for mode in at.rigid])
        return without._replace(soft=np.linalg.inv(np.einsum('akj,bkj->ab', at.rigid, stiff)))

    @property
    def gradient(self) -> Float64Array:
        """Gradient (K, 3) of log p."""
        return self.system.gradient + self.at.gradient

    def times(self, x: Float64Array) -> Float64Array:
        """Return the precision times x (K, 3)."""
        return self.system.times(x) + self.factors.times(self.at, x)

    def each_alone(self, left: Float64Array) -> Float64Array:
        """Return how far each scan alone would go for gradients (K, 3): a step of Jacobi."""
        return np.asarray(np.einsum('kij,kj->ki', self.inverse, left), np.float64)

    def solve(
        self, right: Float64Array, most: int = 60, accuracy: float = ACCURACY
    ) -> Float64Array:
        """Return x (K, 3) with precision times x = right, by conjugate gradients.

        The blocks of the scans are the preconditioner, with moves of all scans as one where
        errors of beliefs are alike: little holds those then. At most so many rounds.
        """
        x, left = np.zeros_like(right), right.copy()
        scaled = self._preconditioned(left)
        along = scaled.copy()
        size = first = float((left * scaled).sum())
        for _ in range(most):
            if size <= accuracy**2 * first or size == 0.0:
                break
            product = self.times(along)
            length = size / float((along * product).sum())
            x += length * along
            left -= length * product
            scaled = self._preconditioned(left)
            before, size = size, float((left * scaled).sum())
            along = scaled + size / before * along
        return x

    def _preconditioned(self, left: Float64Array) -> Float64Array:
        scaled = self.each_alone(left)
        if self.soft is not None:
            together = self.soft @ np.einsum('akj,kj->a', self.at.rigid, left)
            scaled += np.einsum('a,akj->kj', together, self.at.rigid)
        return scaled


def align(
    points: ScanPoints,
    poses: Float64Array,
    factors: PoseFactors,
    stage: Stage,
    fitted: float = 0.0,
) -> tuple[Float64Array, NormalEquations]:
    """Take one step of Gauss and Newton; return the poses (K, 3) and what it solved."""
    system = SurfelSystem.around(points, poses, stage, fitted)
    equations = NormalEquations.around(system, factors, poses)
    return wrapped(poses + equations.solve(equations.gradient)), equations
