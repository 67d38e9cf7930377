"""Moves between scans: how odometry, or the localizer itself, says the robot went.

p(x) ~ prod over moves of t(x_a^-1 x_b; move, s C): a Student distribution of few degrees of
freedom, for wheels slip and localizers jump. A move that does not fit counts little, and no more
the worse it fits. `s` is one factor for all moves of one source, estimated with the poses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array
from ogm_mcmc.trajectory.points import wrapped

__all__ = ['Moves', 'composed', 'jacobians', 'relative_poses']

# Degrees of freedom of moves that may be off by far.
HEAVY_TAILS = 3.0

# So many moves have to speak against what is taken of all.
CAUTION = 10.0

# No source is surer than it says, for points of few beams look as if they knew better (Intel, a
# twentieth of the beams: 0.23); none is worse than so many times that.
LEAST_SCALE, MOST_SCALE = 1.0, 1e4

# Standard deviations of a move as the localizer tells it by two poses of its own (m, m, rad), and
# the share of length and turn: its errors are alike from scan to scan.
OWN_LEAST, OWN_SHARE = (0.02, 0.02, 0.01), 0.02

# Of wheels.
ODOMETRY_LEAST, ODOMETRY_SHARE = (0.02, 0.02, 0.02), 0.1


class Moves(NamedTuple):
    """M moves: from scan `first` to scan `second` (M,) each, `move` (M, 3) in the frame of the
    first, with `precision` (M, 3, 3).

    `source` (M,) is a number for whoever told it; `freedom` are the degrees of freedom of the
    Student distribution of its error, inf for a normal one: one number, or (S,), one
    of each source.
    """  # noqa: D205

    first: Int64Array
    second: Int64Array
    move: Float64Array
    precision: Float64Array
    source: Int64Array
    freedom: float | Float64Array = math.inf

    @classmethod
    def none(cls) -> Moves:
        """Return no moves at all."""
        nobody = np.zeros(0, np.int64)
        return cls(nobody, nobody, np.zeros((0, 3)), np.zeros((0, 3, 3)), nobody)

    @classmethod
    def of_odometry(
        cls,
        odometry: Float64Array,
        order: AnyArray,
        *,
        share: float,
        least: Sequence[float],
        freedom: float = math.inf,
    ) -> Moves:
        """Make a chain of the odometry poses (K, 3), in the `order` (K,) they were passed.

        The standard deviation of a move is `least` (m, m, rad) and `share` of its length or turn.
        Of scans whose odometry is nan no move is made.
        """
        first, second = np.asarray(order[:-1], np.int64), np.asarray(order[1:], np.int64)
        move = relative_poses(odometry[first], odometry[second])
        known = np.isfinite(move).all(axis=1)
        first, second, move = first[known], second[known], move[known]
        far = np.hypot(move[:, 0], move[:, 1])
        turn = np.abs(move[:, 2])
        sigma = np.asarray(least) + share * np.stack((far, far, turn + 0.1 * far), axis=1)
        precision = np.zeros((len(move), 3, 3))
        precision[:, np.arange(3), np.arange(3)] = 1.0 / sigma**2
        return cls(first, second, move, precision, np.zeros(len(move), np.int64), freedom)

    @classmethod
    def of_localizer(cls, poses: Float64Array, order: AnyArray) -> Moves:
        """Make a chain of the poses (K, 3) that a localizer believed: what it says of moves."""
        return cls.of_odometry(poses, order, share=OWN_SHARE, least=OWN_LEAST, freedom=HEAVY_TAILS)

    @classmethod
    def of_wheels(cls, odometry: Float64Array, order: AnyArray) -> Moves:
        """Make a chain of odometry (K, 3), of whose quality nothing is known; wheels may slip."""
        return cls.of_odometry(
            odometry, order, share=ODOMETRY_SHARE, least=ODOMETRY_LEAST, freedom=HEAVY_TAILS
        )

    def and_those(self, others: Moves) -> Moves:
        """Return these moves and others, which are of further sources; each keeps its tails."""
        source = np.concatenate((self.source, others.source + self.n_sources))
        return Moves(
            np.concatenate((self.first, others.first)),
            np.concatenate((self.second, others.second)),
            np.concatenate((self.move, others.move)),
            np.concatenate((self.precision, others.precision)),
            source,
            np.concatenate((self._freedoms(), others._freedoms())),
        )

    def _freedoms(self) -> Float64Array:
        """Return the degrees of freedom of every source (S,)."""
        return np.broadcast_to(np.asarray(self.freedom, np.float64), (self.n_sources,))

    def _tails(self) -> tuple[BoolArray, Float64Array]:
        """Return whether moves (M,) are normal, and their degrees of freedom, 1 if so."""
        freedom = self._freedoms()[self.source]
        normal = np.isinf(freedom)
        return normal, np.where(normal, 1.0, freedom)

    @property
    def n_sources(self) -> int:
        """Number of sources."""
        return int(self.source.max(initial=-1)) + 1

    def errors(self, poses: Float64Array) -> Float64Array:
        """Return how far moves between poses (K, 3) are from these, (M, 3)."""
        return wrapped(relative_poses(poses[self.first], poses[self.second]) - self.move)

    def squares(self, errors: Float64Array) -> Float64Array:
        """Return squared errors (M,) in their metric."""
        return np.asarray(np.einsum('mi,mij,mj->m', errors, self.precision, errors), np.float64)

    def log_densities(self, poses: Float64Array) -> Float64Array:
        """Return what each move (M,) says of poses (K, 3), nats, up to a constant."""
        squares = self.squares(self.errors(poses))
        normal, freedom = self._tails()
        heavy = (freedom + 3.0) * np.log1p(squares / freedom)
        return np.asarray(-0.5 * np.where(normal, squares, heavy), np.float64)

    def weights(self, squares: Float64Array) -> Float64Array:
        """Return how much moves (M,) count for their squared errors: 1 for those normal."""
        normal, freedom = self._tails()
        heavy = (freedom + 3.0) / (freedom + squares)
        return np.asarray(np.where(normal, 1.0, heavy), np.float64)

    def scaled(self, scales: AnyArray) -> Moves:
        """Return moves with so many times (number of sources,) the covariances."""
        return self._replace(precision=self.precision / scales[self.source][:, None, None])

    def shown_scales(
        self, poses: Float64Array, blocks: Float64Array, scales: Float64Array
    ) -> Float64Array:
        """Return how many times the covariances of each source (S,) are what poses (K, 3) show.

        blocks  (K, 3, 3) precision of each pose given all others, moves left out
        scales  (S,) that the poses were found with

        A step of EM for the Student distribution (Liu and Rubin 1995, "ML estimation of the t
        distribution using EM"): squared errors and what of them poses leave open, by weight.
        `CAUTION` moves are added that fit the scales of the start.
        """
        squares = self.squares(self.errors(poses))
        now = self.scaled(scales)
        weight = self.weights(squares / scales[self.source])
        by_first, by_second = jacobians(poses[self.first], poses[self.second])
        covariances = np.linalg.inv(blocks)
        told = np.einsum('mij,mjk,mlk->mil', by_first, covariances[self.first], by_first)
        told += np.einsum('mij,mjk,mlk->mil', by_second, covariances[self.second], by_second)
        left = np.linalg.inv(np.linalg.inv(told) + weight[:, None, None] * now.precision)
        open_ = np.einsum('mij,mji->m', self.precision, left)
        sums = np.bincount(self.source, weight * (squares + open_), minlength=len(scales)) / 3.0
        count = np.bincount(self.source, minlength=len(scales))
        found = (sums + CAUTION) / (count + CAUTION)
        return np.asarray(np.clip(found, LEAST_SCALE, MOST_SCALE), np.float64)


def relative_poses(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return where the second poses (M, 3) lie in the frames of the first ones (M, 3)."""
    dx, dy = (second - first)[:, :2].T
    cosine, sine = np.cos(first[:, 2]), np.sin(first[:, 2])
    turn = second[:, 2] - first[:, 2]
    return wrapped(np.stack((cosine * dx + sine * dy, cosine * dy - sine * dx, turn), axis=1))


def composed(pose: Float64Array, move: Float64Array) -> Float64Array:
    """Return where a move (3,) leads from a pose (3,); the inverse of `relative_poses`."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    x, y = cosine * move[0] - sine * move[1], sine * move[0] + cosine * move[1]
    return wrapped(pose + np.array([x, y, move[2]]))


def jacobians(first: Float64Array, second: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the derivatives (M, 3, 3) of `relative_poses` by the first and the second poses."""
    cosine, sine = np.cos(first[:, 2]), np.sin(first[:, 2])
    move = relative_poses(first, second)
    by_second = np.zeros((len(first), 3, 3))
    by_second[:, 0, 0], by_second[:, 0, 1] = cosine, sine
    by_second[:, 1, 0], by_second[:, 1, 1] = -sine, cosine
    by_second[:, 2, 2] = 1.0
    by_first = -by_second
    by_first[:, 0, 2], by_first[:, 1, 2] = move[:, 1], -move[:, 0]
    return by_first, by_second
