"""Are the probabilities true? Of cells said to be occupied with 0.7, seven in ten should be."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array
from ogm_mcmc.errors import GridError, require

__all__ = ['Reliability', 'brier_score', 'reliability']

PART = 1 << 20


class Reliability(NamedTuple):
    """Per bin (B,) of predicted probability: cells, sum of the predictions, occupied cells.

    Bins are equally wide; the reliability curve is `observed` over `predicted`.
    """

    cells: Float64Array
    sum_predicted: Float64Array
    occupied: Float64Array

    def pooled(self, other: Self) -> Reliability:
        """Return the bins of both maps together."""
        return Reliability(*(mine + theirs for mine, theirs in zip(self, other, strict=True)))

    def predicted(self) -> Float64Array:
        """Mean prediction of every bin, nan in an empty one."""
        return self._mean(self.sum_predicted)

    def observed(self) -> Float64Array:
        """Share of occupied cells in every bin, nan in an empty one."""
        return self._mean(self.occupied)

    def expected_error(self) -> float:
        """Expected calibration error: mean over cells of |observed - predicted| of their bin."""
        total = float(self.cells.sum())
        gap = np.abs(self.occupied - self.sum_predicted)
        return float(gap.sum() / total) if total else float('nan')

    def _mean(self, sums: Float64Array) -> Float64Array:
        empty = np.full_like(sums, np.nan)
        return np.asarray(np.divide(sums, self.cells, out=empty, where=self.cells > 0))


def reliability(probability: AnyArray, occupied: BoolArray, bins: int = 10) -> Reliability:
    """Sort cells into bins by their probability; the upper end of a bin belongs to it."""
    require(bins > 0, 'bins', bins, 'expected at least one')
    predictions, truth = _flat(probability, occupied)
    edges = np.linspace(0.0, 1.0, bins + 1)[1:-1]
    totals = np.zeros((3, bins))
    for start in range(0, predictions.size, PART):  # little memory, however many the cells
        part = predictions[start : start + PART].astype(np.float64)
        index = np.searchsorted(edges, part)
        weights = (None, part, truth[start : start + PART])
        totals += [np.bincount(index, weights=of, minlength=bins) for of in weights]
    return Reliability(*totals)


def brier_score(probability: AnyArray, occupied: BoolArray) -> float:
    """Mean squared difference between probability and truth (0 or 1)."""
    predictions, truth = _flat(probability, occupied)
    if not predictions.size:
        return float('nan')
    total = 0.0
    for start in range(0, predictions.size, PART):
        part = slice(start, start + PART)
        total += float(((predictions[part].astype(np.float64) - truth[part]) ** 2).sum())
    return total / predictions.size


def _flat(probability: AnyArray, occupied: BoolArray) -> tuple[AnyArray, BoolArray]:
    predictions = np.asarray(probability).ravel()
    truth = np.asarray(occupied, np.bool_).ravel()
    if predictions.shape != truth.shape:
        raise GridError(
            f'{predictions.size} probabilities, {truth.size} true cells: expected as many'
        )
    if np.isnan(predictions).any():
        raise GridError('probability: expected no unknown cell among those that count')
    return predictions, truth
