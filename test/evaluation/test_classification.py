"""Confusion counts by hand; curves and areas as scikit-learn has them."""

import numpy as np
import pytest
from sklearn import metrics

from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation import confusion_counts


def example(size=5000, seed=1):
    """Scores with many ties and some sense in them, more free cells than occupied ones."""
    rng = np.random.default_rng(seed)
    truth = rng.random(size) < 0.2
    scores = np.clip(rng.normal(0.3 + 0.3 * truth, 0.25), 0.0, 1.0).round(2)
    return scores, truth


def test_counts_by_hand():
    scores = np.array([0.9, 0.8, 0.8, 0.3, 0.1])
    truth = np.array([True, False, True, True, False])
    counts = confusion_counts(scores, truth)
    assert counts.thresholds.tolist() == [0.9, 0.8, 0.3, 0.1]
    assert counts.true_positives.tolist() == [1, 2, 3, 3]
    assert counts.false_positives.tolist() == [0, 1, 1, 2]
    assert (counts.positives, counts.negatives) == (3, 2)
    assert counts.precision() == pytest.approx([1, 2 / 3, 3 / 4, 3 / 5])
    assert counts.recall() == pytest.approx([1 / 3, 2 / 3, 1, 1])
    assert counts.f1() == pytest.approx([1 / 2, 2 / 3, 6 / 7, 3 / 4])
    assert counts.best() == pytest.approx((0.3, 3 / 4, 1, 6 / 7))


def test_curves_and_areas():
    scores, truth = example()
    counts = confusion_counts(scores, truth)
    precision, recall, thresholds = metrics.precision_recall_curve(truth, scores)
    assert np.array_equal(counts.thresholds, thresholds[::-1])
    assert counts.precision() == pytest.approx(precision[:-1][::-1])
    assert counts.recall() == pytest.approx(recall[:-1][::-1])
    false_rate, true_rate, _ = metrics.roc_curve(truth, scores, drop_intermediate=False)
    assert counts.false_positive_rate() == pytest.approx(false_rate[1:])
    assert counts.recall() == pytest.approx(true_rate[1:])
    assert counts.roc_area() == pytest.approx(metrics.roc_auc_score(truth, scores))
    expected = metrics.average_precision_score(truth, scores)
    assert counts.average_precision() == pytest.approx(expected)


@pytest.mark.parametrize('threshold', [0.0, 0.2, 0.5, 0.77, 1.0])
def test_one_threshold(threshold):
    scores, truth = example()
    got = confusion_counts(scores, truth, [threshold]).scores(0)
    called = scores >= threshold
    expected = metrics.precision_recall_fscore_support(
        truth, called, average='binary', zero_division=1.0
    )
    assert got[1:] == pytest.approx(expected[:3])


def test_thresholds_are_as_exact_as_the_probabilities():
    scores = np.array([0.7, 0.1, 0.2], np.float32)
    counts = confusion_counts(scores, np.ones(3, bool), [0.7, 0.2, 0.1])
    assert counts.true_positives.tolist() == [1, 2, 3]


def test_pooled_counts_are_those_of_all_cells_together():
    thresholds = np.linspace(0.0, 1.0, 101)
    one, other = example(seed=1), example(seed=2)
    pooled = confusion_counts(*one, thresholds).pooled(confusion_counts(*other, thresholds))
    together = confusion_counts(
        *(np.concatenate(pair) for pair in zip(one, other, strict=True)), thresholds
    )
    for mine, expected in zip(pooled, together, strict=True):
        assert np.array_equal(mine, expected)
    with pytest.raises(GridError, match='same thresholds'):
        pooled.pooled(confusion_counts(*one))


def test_truth_of_one_kind():
    counts = confusion_counts(np.array([0.2, 0.8]), np.zeros(2, bool))
    assert np.isnan(counts.recall()).all()
    assert np.isnan(counts.roc_area())
    assert counts.f1().tolist() == [0.0, 0.0]


def test_what_cannot_be_counted():
    with pytest.raises(GridError, match='no unknown cell'):
        confusion_counts(np.array([np.nan]), np.array([True]))
    with pytest.raises(GridError, match='2 probabilities, 1 true cells'):
        confusion_counts(np.zeros(2), np.array([True]))
