"""Reliability: by hand, and as scikit-learn has it."""

import numpy as np
import pytest
from sklearn import calibration, metrics

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import brier_score, reliability


def test_two_bins_by_hand():
    bins = reliability([0.1, 0.3, 0.9, 0.7], np.array([False, True, True, True]), bins=2)
    assert bins.cells.tolist() == [2, 2]
    assert bins.predicted() == pytest.approx([0.2, 0.8])
    assert bins.observed() == pytest.approx([0.5, 1.0])
    assert bins.expected_error() == pytest.approx((2 * 0.3 + 2 * 0.2) / 4)


@pytest.mark.parametrize('bins', [1, 7, 10, 50])
def test_curve_and_brier_score(bins):
    rng = np.random.default_rng(4)
    predictions = rng.random(3000).round(2)
    truth = rng.random(3000) < predictions**2
    got = reliability(predictions, truth, bins)
    observed, predicted = calibration.calibration_curve(truth, predictions, n_bins=bins)
    filled = got.cells > 0
    assert got.observed()[filled] == pytest.approx(observed)
    assert got.predicted()[filled] == pytest.approx(predicted)
    assert brier_score(predictions, truth) == pytest.approx(
        metrics.brier_score_loss(truth, predictions)
    )


def test_honest_probabilities_are_calibrated_and_others_not():
    rng = np.random.default_rng(5)
    predictions = rng.random(200_000)
    truth = rng.random(200_000) < predictions
    assert reliability(predictions, truth).expected_error() < 0.01
    assert reliability(predictions**3, truth).expected_error() > 0.2


def test_pooled_and_empty():
    one = reliability([0.1], np.array([True]))
    other = reliability([0.1, 0.95], np.array([False, True]))
    assert one.pooled(other).cells.tolist() == [2, 0, 0, 0, 0, 0, 0, 0, 0, 1]
    assert np.isnan(reliability([], np.zeros(0, bool)).expected_error())
    with pytest.raises(ConfigError, match='bins'):
        reliability([0.5], np.array([True]), bins=0)
