"""Errors of beliefs that are alike from one scan to the next.

A localizer that is 10 cm too far north is so a moment later: a hundred of its beliefs do not make
its error a tenth. Errors in units of what beliefs say, u_k = W_k (x_k - mean_k), W_k the symmetric
root of the precision, are a first-order process in the order in which scans were taken:

    u_b = R u_a + sqrt(1 - R^2) e,  e ~ N(0, I),  with probability 1 - q;  u_b ~ N(0, I) else

R = diag(correlation of place, place, heading). Now and then, with probability q, a localizer jumps
and errs anew. Either way u_b is N(0, I) if u_a is: every pose by itself keeps the covariance
that was said of it. As a factor of neighbours beside the beliefs themselves

    f(u_a, u_b) = q + (1 - q) N(u_b; R u_a, I - R^2) / N(u_b; 0, I)

which is 1 where nothing is alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int64Array

__all__ = ['Alike', 'effective_count', 'symmetric_roots']

# How often the error is drawn anew.
ANEW = 0.02

# Poses so many times further off than the median say nothing of what is usual.
FAR_OFF = 4.0

# Before poses show anything, and so many pairs of beliefs have to speak against it.
USUAL = 0.9
CAUTION = 10.0

# No process is taken for slower than that.
MOST = 0.9999


class Alike(NamedTuple):
    """M pairs of scans, `second` (M,) next after `first` (M,), and the correlation (3,) of their
    errors in place, place and heading. No scan is second twice.
    """  # noqa: D205

    first: Int64Array
    second: Int64Array
    correlation: Float64Array
    anew: float = ANEW

    @classmethod
    def none(cls) -> Alike:
        """Return no pairs at all: all errors are independent."""
        nobody = np.zeros(0, np.int64)
        return cls(nobody, nobody, np.zeros(3))

    @classmethod
    def in_order(cls, order: AnyArray, correlation: float = 0.0) -> Alike:
        """Pair each scan with the next of the `order` (K,)."""
        chain = np.asarray(order, np.int64)
        return cls(chain[:-1], chain[1:], np.full(3, correlation))

    def log_densities(self, errors: Float64Array) -> Float64Array:
        """Return log f (M,), nats, of errors (K, 3) in units of what beliefs say."""
        return np.asarray(np.logaddexp(np.log(self.anew), self._continued(errors)), np.float64)

    def weights(self, errors: Float64Array) -> Float64Array:
        """Return how probably errors (K, 3) went on, not anew (M,)."""
        return np.asarray(np.exp(self._continued(errors) - self.log_densities(errors)), np.float64)

    def _continued(self, errors: Float64Array) -> Float64Array:
        before, after = errors[self.first], errors[self.second]
        left = 1.0 - self.correlation**2
        squares = (after - self.correlation * before) ** 2 / left - after**2
        log_ratio = -0.5 * (squares + np.log(left)).sum(axis=1)
        return np.asarray(np.log1p(-self.anew) + log_ratio, np.float64)

    def stiffness(self, weights: Float64Array, count: int) -> Float64Array:
        """Return the diagonal (K, 3) that pairs of these weights add to the precision."""
        found = np.zeros((count, 3))
        own = weights[:, None] * (self.correlation**2 / (1.0 - self.correlation**2))
        np.add.at(found, self.first, own)
        np.add.at(found, self.second, own)
        return found

    def times(self, x: Float64Array, weights: Float64Array) -> Float64Array:
        """Return what pairs add to the precision, times x (K, 3)."""
        r = self.correlation
        scale = weights[:, None] / (1.0 - r**2)
        before, after = x[self.first], x[self.second]
        found = np.zeros_like(x)
        np.add.at(found, self.first, scale * (r**2 * before - r * after))
        np.add.at(found, self.second, scale * (r**2 * after - r * before))
        return found

    def noise(self, weights: Float64Array, rng: np.random.Generator, count: int) -> Float64Array:
        """Draw (K, 3) with the precision of beliefs (1) and pairs together as its covariance.

        That precision is a sum of squares: (u_b - R u_a)^2 / (1 - R^2) by the weight of a pair,
        u_b^2 by what is left of it, and u^2 of scans that are second of none.
        """
        own = np.ones(count)
        own[self.second] -= weights
        found: Float64Array = np.sqrt(own)[:, None] * rng.standard_normal((count, 3))
        scale = np.sqrt(weights[:, None] / (1.0 - self.correlation**2))
        white = scale * rng.standard_normal((weights.size, 3))
        np.add.at(found, self.second, white)
        np.add.at(found, self.first, -self.correlation * white)
        return found

    def shown(self, errors: Float64Array, open_: Float64Array) -> Alike:
        """Return the pairs with the correlation that poses show.

        errors  (K, 3) in units of what beliefs say
        open_   (K, 3) their variances by what scans tell given all others, and their own beliefs

        A step of EM: 1 - R is half the mean square of steps over that of errors, of pairs that
        went on. All errors together may be more than they show, as the poses lie where they are
        least: one part in the number that count as independent, see `effective_count`.
        """
        if not self.first.size:
            return self
        a, b = errors[self.first], errors[self.second]
        squares = (errors**2).sum(axis=1)
        sane = squares <= FAR_OFF**2 * np.median(squares)
        weights = (self.weights(errors) * (sane[self.first] & sane[self.second]))[:, None]
        pairs = float(weights.sum())
        of_a, of_b, both = self._pairs_left(open_)
        steps = 0.5 * (weights * ((b - a) ** 2 + of_a + of_b - 2.0 * both)).sum(axis=0)
        sizes = 0.5 * (weights * (a**2 + b**2 + of_a + of_b)).sum(axis=0)
        count = effective_count(pairs + 1.0, self.correlation)
        size = (count * sizes / max(pairs, 1e-9) + 1.0 + CAUTION) / (count + CAUTION)
        step = (steps + CAUTION * (1.0 - USUAL) * size) / (pairs + CAUTION)
        return self._replace(correlation=np.clip(1.0 - step / size, 0.0, MOST))

    def _pairs_left(self, open_: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return variances of first and second errors (M, 3) and covariances, each pair by itself.

        Of two errors of variance 1 and correlation R, that scans tell of besides.
        """
        told = 1.0 / np.clip(open_, 1e-12, 1.0) - 1.0
        left = 1.0 / (1.0 - self.correlation**2)
        a, b = told[self.first] + left, told[self.second] + left
        off = self.correlation * left
        size = a * b - off**2
        return b / size, a / size, off / size


def effective_count(count: float, correlation: Float64Array) -> Float64Array:
    """Return as how many independent errors so many count that are alike, for their mean."""
    return 1.0 + (count - 1.0) * (1.0 - correlation) / (1.0 + correlation)


def symmetric_roots(matrices: Float64Array) -> Float64Array:
    """Return the symmetric roots (K, 3, 3) of symmetric positive matrices."""
    values, vectors = np.linalg.eigh(matrices)
    roots: Float64Array = np.einsum('kij,kj,klj->kil', vectors, np.sqrt(values), vectors)
    return roots
