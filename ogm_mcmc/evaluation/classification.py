"""A map as a classifier of cells: confusion counts over thresholds and what follows from them.

A cell is called occupied where its probability is at least the threshold. Occupied is the
positive class, as in [patch] section IV. Counts of several maps at the same thresholds add up,
which pools a hundred data sets without keeping their cells.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array
from ogm_mcmc.errors import GridError

__all__ = ['Scores', 'ThresholdCounts', 'confusion_counts']


class Scores(NamedTuple):
    """Precision, recall and F1 at one threshold ([patch] section IV and Eq. 2)."""

    threshold: float
    precision: float
    recall: float
    f1: float


class ThresholdCounts(NamedTuple):
    """Confusion counts: thresholds (T,) falling; true and false positives (T,) at each.

    `positives` and `negatives` are the occupied and free cells of the truth.
    """

    thresholds: Float64Array
    true_positives: Float64Array
    false_positives: Float64Array
    positives: int
    negatives: int

    def pooled(self, other: Self) -> ThresholdCounts:
        """Return the counts of both maps together; raises GridError for other thresholds."""
        if not np.array_equal(self.thresholds, other.thresholds):
            raise GridError('counts to pool: expected the same thresholds')
        return ThresholdCounts(
            self.thresholds,
            self.true_positives + other.true_positives,
            self.false_positives + other.false_positives,
            self.positives + other.positives,
            self.negatives + other.negatives,
        )

    def precision(self) -> Float64Array:
        """TP / (TP + FP) (T,); 1 where no cell is called occupied."""
        called = self.true_positives + self.false_positives
        return np.asarray(
            np.divide(self.true_positives, called, out=np.ones_like(called), where=called > 0)
        )

    def recall(self) -> Float64Array:
        """TP / (TP + FN) (T,), also the true positive rate; nan if nothing is occupied."""
        return self._share(self.true_positives, self.positives)

    def false_positive_rate(self) -> Float64Array:
        """FP / (FP + TN) (T,); nan if nothing is free."""
        return self._share(self.false_positives, self.negatives)

    def f1(self) -> Float64Array:
        """2 TP / (2 TP + FP + FN) (T,), Eq. 2 of [patch]; 0 where there is no true positive."""
        total = self.true_positives + self.false_positives + self.positives
        return np.asarray(
            np.divide(2.0 * self.true_positives, total, out=np.zeros_like(total), where=total > 0)
        )

    def best(self) -> Scores:
        """Return the scores at the threshold of the highest F1; of equals the highest one."""
        return self.scores(int(np.argmax(self.f1())))

    def scores(self, index: int) -> Scores:
        """Return the scores at one of the thresholds."""
        columns = (self.thresholds, self.precision(), self.recall(), self.f1())
        return Scores(*(float(column[index]) for column in columns))

    def roc_area(self) -> float:
        """Area under the ROC curve by trapezoids; nan if one class has no cell."""
        rates = np.concatenate(([0.0], self.false_positive_rate(), [1.0]))
        hits = np.concatenate(([0.0], self.recall(), [1.0]))
        return float(np.sum(np.diff(rates) * 0.5 * (hits[1:] + hits[:-1])))

    def average_precision(self) -> float:
        """Area under the precision-recall curve as a sum of steps, sum (R_n - R_n-1) P_n.

        Trapezoids would be too kind: precision is not linear in recall between two thresholds.
        """
        return float(np.sum(np.diff(self.recall(), prepend=0.0) * self.precision()))

    @staticmethod
    def _share(counts: Float64Array, total: int) -> Float64Array:
        return counts / total if total else np.full_like(counts, np.nan)


def confusion_counts(
    probability: AnyArray, occupied: BoolArray, thresholds: AnyArray | None = None
) -> ThresholdCounts:
    """Count at the given thresholds, or at every distinct probability.

    `probability` and `occupied` have the same shape; cells that do not count are left out
    before. Raises GridError for unknown probabilities (nan).
    """
    given = np.asarray(probability)
    # Values of 32 bits stay so: a map has many cells, and sorting them is exact.
    scores = given.ravel() if given.dtype == np.float32 else given.astype(np.float64).ravel()
    truth = np.asarray(occupied, np.bool_).ravel()
    if scores.shape != truth.shape:
        raise GridError(f'{scores.size} probabilities, {truth.size} true cells: expected as many')
    if np.isnan(scores).any():
        raise GridError('probability: expected no unknown cell among those that count')
    hits, others = np.sort(scores[truth]), np.sort(scores[~truth])
    if thresholds is None:
        falling = np.unique(scores)[::-1]
    else:
        # As exact as the probabilities: 0.7 in float32 is a little less than 0.7.
        kind = given.dtype if given.dtype.kind == 'f' else 'd'
        falling = np.sort(np.asarray(thresholds, kind).astype(scores.dtype).ravel())[::-1]
    return ThresholdCounts(
        np.ascontiguousarray(falling, np.float64),
        (hits.size - np.searchsorted(hits, falling, side='left')).astype(np.float64),
        (others.size - np.searchsorted(others, falling, side='left')).astype(np.float64),
        int(hits.size),
        int(others.size),
    )
