"""What is known of the poses of a recording besides its ranges.

p(x) = prod over k of N(x_k; mean_k, s covariance_k) * prod over neighbours of f(u_a, u_b)
       * prod over moves of p(x_a^-1 x_b)

Localizers are shy, or too sure of themselves, as a whole: `s` is one factor for all beliefs that
say how sure they are, estimated with the poses (`doubt`). Their errors u may be alike from one
scan to the next: f is in `ogm_mcmc.trajectory.alike`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.alike import Alike, effective_count, symmetric_roots
from ogm_mcmc.trajectory.moves import Moves, jacobians
from ogm_mcmc.trajectory.points import wrapped, xyyaw

__all__ = ['Linearised', 'PoseFactors']

# Particles that agree exactly, or one particle, are no reason to believe a pose to be exact.
LEAST_SPREAD = np.array([1e-3, 1e-3, 1e-4])

# Of a chi squared variable of three degrees of freedom.
MEDIAN_OF_SQUARES = 2.366

# So many beliefs have to speak against what all of them say of themselves.
CAUTION = 10.0


class Linearised(NamedTuple):
    """Factors around some poses: gradient (K, 3) of log p, diagonal blocks (K, 3, 3) of the
    precision, and of each move the Jacobians (M, 3, 3) of its error by either pose and its
    precision (M, 3, 3), less where it does not fit.

    Where errors are alike, the symmetric `roots` (K, 3, 3) of the beliefs' precision, how much
    each pair of neighbours counts (N,), and all scans moved and turned as one: `rigid` (3, K, 3).
    Else these are empty.
    """  # noqa: D205

    gradient: Float64Array
    blocks: Float64Array
    by_first: Float64Array
    by_second: Float64Array
    of_moves: Float64Array
    roots: Float64Array = np.zeros((0, 3, 3))
    of_pairs: Float64Array = np.zeros(0)
    rigid: Float64Array = np.zeros((0, 0, 3))


class PoseFactors(NamedTuple):
    """Beliefs, `mean` (K, 3) and `precision` (K, 3, 3), and moves between scans.

    `said` (K,): whether a belief came with a precision of its own.
    """

    mean: Float64Array
    precision: Float64Array
    moves: Moves
    said: BoolArray
    alike: Alike = Alike.none()

    @classmethod
    def of(
        cls,
        beliefs: Sequence[PoseBelief],
        spread: Sequence[float],
        moves: Moves | None = None,
    ) -> PoseFactors:
        """Return the factors of beliefs; particles count with their mean and covariance.

        A belief of neither covariance nor particles has the standard deviations `spread`
        (m, m, rad). So has one whose covariance is 0 all over: messages that know none say so.
        """
        mean = xyyaw([belief.mean for belief in beliefs])
        precision = np.empty((len(beliefs), 3, 3))
        said = np.ones(len(beliefs), np.bool_)
        for k, belief in enumerate(beliefs):
            covariance = belief.covariance
            if belief.particles is not None:
                mean[k] = xyyaw([belief.particles.mean()])[0]
                covariance = belief.particles.covariance()
            if covariance is None or not covariance.any():
                said[k] = False
                covariance = np.diag(np.square(np.asarray(spread, np.float64)))
            precision[k] = np.linalg.inv(covariance + np.diag(LEAST_SPREAD**2))
        return cls(mean, precision, Moves.none() if moves is None else moves, said)

    def of_odometry(self, order: AnyArray, spread: Sequence[float]) -> PoseFactors:
        """Return the factors of poses that are odometry, in the `order` (K,) they were passed.

        It says how the robot went, as wheels do, and nothing of where it is: whatever came with a
        pose, all K beliefs together hold the map as one pose of the deviations `spread` would.
        """
        k = len(self.mean)
        precision = np.tile(np.diag(1.0 / (k * np.square(spread))), (k, 1, 1))
        moves = Moves.of_wheels(self.mean, order).and_those(self.moves)
        return self._replace(precision=precision, moves=moves, said=np.zeros(k, np.bool_))

    def doubt(self, poses: Float64Array, blocks: Float64Array, now: PoseFactors) -> float:
        """Return s: how many times the covariances of beliefs are what poses (K, 3) show.

        blocks  (K, 3, 3) precision of each pose given all others, as far as scans tell
        now     the factors that the poses were found with: these, with the s of before

        A step of EM with a median for the mean, so that a few astray do not count: of the squared
        distances from the beliefs, in their metric, which is 2.366 of 3 degrees of freedom, and
        what of it the poses leave open; `CAUTION` beliefs are added that are as sure as they say.
        """
        if not self.said.any():
            return 1.0
        precision = self.precision[self.said]
        squares = -2.0 * self.of_beliefs(poses)[self.said]
        left = np.linalg.inv(blocks[self.said] + now.precision[self.said])
        open_ = float(np.einsum('kij,kji->k', precision, left).mean())
        shown = float(np.median(squares)) / MEDIAN_OF_SQUARES + open_ / 3.0
        count = float(np.count_nonzero(self.said))
        if self.alike.first.size:
            # All errors together are not seen, and are not small where errors are alike.
            count = float(effective_count(count, now.alike.correlation).mean())
            k = int(np.argmax(self.said))
            shown += float(self.precision[k, 0, 0] / now.precision[k, 0, 0]) / count
        return (count * shown + CAUTION) / (count + CAUTION)

    def doubted(self, factor: float) -> PoseFactors:
        """Return the factors with so many times the covariances of beliefs that say any."""
        scale = np.where(self.said, factor, 1.0)
        return self._replace(precision=self.precision / scale[:, None, None])

    def off(self, poses: Float64Array) -> Float64Array:
        """Return how far poses (K, 3) are from the means, yaw the short way round."""
        return wrapped(poses - self.mean)

    def log_density(self, poses: Float64Array) -> float:
        """Return log p(poses) up to a constant, nats."""
        return float(self.of_beliefs(poses).sum() + self.between(poses).sum())

    @property
    def neighbours(self) -> tuple[Int64Array, Int64Array]:
        """First and second scans (M + N,) of moves, then of errors that are alike."""
        moves, alike = self.moves, self.alike
        first = np.concatenate((moves.first, alike.first))
        return first, np.concatenate((moves.second, alike.second))

    def between(self, poses: Float64Array) -> Float64Array:
        """Return what `neighbours` (M + N,) say of poses (K, 3), nats, up to a constant."""
        return np.concatenate((self.of_moves(poses), self.of_pairs(poses)))

    def of_beliefs(self, poses: Float64Array) -> Float64Array:
        """Return what each belief (K,) says of poses (K, 3), nats, up to a constant."""
        off = self.off(poses)
        return np.asarray(-0.5 * np.einsum('ki,kij,kj->k', off, self.precision, off), np.float64)

    def errors(self, poses: Float64Array) -> Float64Array:
        """Return how far poses (K, 3) are from the means, in units of what beliefs say."""
        roots = symmetric_roots(self.precision)
        return np.asarray(np.einsum('kij,kj->ki', roots, self.off(poses)), np.float64)

    def of_pairs(self, poses: Float64Array) -> Float64Array:
        """Return what each pair of neighbours (N,) adds to what beliefs say, nats: log f."""
        if not self.alike.first.size:
            return np.zeros(0)
        return self.alike.log_densities(self.errors(poses))

    def correlated(self, poses: Float64Array, blocks: Float64Array) -> PoseFactors:
        """Return the factors with errors as alike as poses (K, 3) show them to be.

        blocks  (K, 3, 3) precision of each pose given all others, as far as scans tell
        """
        if not self.alike.first.size:
            return self
        roots = symmetric_roots(self.precision)
        left = np.linalg.inv(blocks + self.precision)
        open_ = np.einsum('kij,kjl,kil->ki', roots, left, roots)
        return self._replace(alike=self.alike.shown(self.errors(poses), open_))

    def of_moves(self, poses: Float64Array) -> Float64Array:
        """Return what each measured move (M,) says of poses (K, 3), nats, up to a constant."""
        return self.moves.log_densities(poses)

    def linearised(self, poses: Float64Array) -> Linearised:
        """Return the factors around poses (K, 3); moves are normal ones of that weight there."""
        gradient = -np.einsum('kij,kj->ki', self.precision, self.off(poses))
        blocks = self.precision.copy()
        moves = self.moves
        first, second, errors = moves.first, moves.second, moves.errors(poses)
        by_first, by_second = jacobians(poses[first], poses[second])
        precision = moves.weights(moves.squares(errors))[:, None, None] * moves.precision
        weighted = np.einsum('mij,mj->mi', precision, errors)
        np.add.at(gradient, first, -np.einsum('mji,mj->mi', by_first, weighted))
        np.add.at(gradient, second, -np.einsum('mji,mj->mi', by_second, weighted))
        np.add.at(blocks, first, np.einsum('mji,mjk,mkl->mil', by_first, precision, by_first))
        np.add.at(blocks, second, np.einsum('mji,mjk,mkl->mil', by_second, precision, by_second))
        found = Linearised(gradient, blocks, by_first, by_second, precision)
        return self._with_pairs(found, poses) if self.alike.first.size else found

    def _with_pairs(self, at: Linearised, poses: Float64Array) -> Linearised:
        roots, errors = symmetric_roots(self.precision), self.errors(poses)
        weights = self.alike.weights(errors)
        pull = -self.alike.times(errors, weights)
        stiffness = self.alike.stiffness(weights, len(poses))
        gradient = at.gradient + np.einsum('kij,kj->ki', roots, pull)
        blocks = at.blocks + np.einsum('kij,kj,kjl->kil', roots, stiffness, roots)
        rigid = np.zeros((3, *poses.shape))
        rigid[np.arange(3), :, np.arange(3)] = 1.0
        x, y = (poses[:, :2] - poses[:, :2].mean(axis=0)).T
        rigid[2, :, 0], rigid[2, :, 1] = -y, x
        return at._replace(
            gradient=gradient, blocks=blocks, roots=roots, of_pairs=weights, rigid=rigid
        )

    def times(self, at: Linearised, x: Float64Array) -> Float64Array:
        """Return the precision around some poses times x (K, 3)."""
        result: Float64Array = np.einsum('kij,kj->ki', self.precision, x)
        if at.of_pairs.size:
            pulled = self.alike.times(np.einsum('kij,kj->ki', at.roots, x), at.of_pairs)
            result += np.einsum('kij,kj->ki', at.roots, pulled)
        first, second, precision = self.moves.first, self.moves.second, at.of_moves
        error = np.einsum('mij,mj->mi', at.by_first, x[first])
        error += np.einsum('mij,mj->mi', at.by_second, x[second])
        weighted = np.einsum('mij,mj->mi', precision, error)
        np.add.at(result, first, np.einsum('mji,mj->mi', at.by_first, weighted))
        np.add.at(result, second, np.einsum('mji,mj->mi', at.by_second, weighted))
        return result

    def noise(self, at: Linearised, rng: np.random.Generator) -> Float64Array:
        """Draw (K, 3) with the precision as its covariance."""
        result: Float64Array
        if at.of_pairs.size:
            drawn = self.alike.noise(at.of_pairs, rng, len(self.mean))
            result = np.einsum('kij,kj->ki', at.roots, drawn)
        else:
            root = np.linalg.cholesky(self.precision)
            result = np.einsum('kij,kj->ki', root, rng.standard_normal(self.mean.shape))
        first, second = self.moves.first, self.moves.second
        if first.size:
            white = rng.standard_normal((first.size, 3))
            drawn = np.einsum('mij,mj->mi', np.linalg.cholesky(at.of_moves), white)
            np.add.at(result, first, np.einsum('mji,mj->mi', at.by_first, drawn))
            np.add.at(result, second, np.einsum('mji,mj->mi', at.by_second, drawn))
        return result
