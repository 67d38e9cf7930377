import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import mutual_info_score
from support.strategies import REPEATABLE

from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.sampling.estimates import (
    at_least,
    mutual_information_bits,
    with_neighbours,
    with_one_more_draw,
    with_share_of,
)

approx = pytest.approx


@given(rows=st.lists(st.tuples(*[st.integers(0, 1)] * 4), min_size=1, max_size=40))
@settings(REPEATABLE, max_examples=40)
def test_equals_scikit_learn(rows):
    samples = np.array(rows, np.uint8)
    found = mutual_information_bits(samples)
    for a in range(4):
        for b in range(4):
            expected = mutual_info_score(samples[:, a], samples[:, b]) / math.log(2.0)
            assert found[a, b] == approx(expected, abs=1e-9)


def test_by_hand():
    """Equal cells share all, independent ones nothing; a half and its half share 0.311 bits."""
    samples = np.array([[0, 0, 0, 0], [0, 0, 1, 0], [1, 1, 0, 0], [1, 1, 1, 1]], np.uint8)
    found = mutual_information_bits(samples)
    assert found[0, 1] == approx(1.0)
    assert found[0, 2] == approx(0.0)
    assert found[0, 3] == approx(0.75 * math.log2(4 / 3) + 0.25 * 2.0 - 0.5)
    assert found == approx(found.T)
    assert np.diag(found)[:3] == approx(np.ones(3))


def test_no_samples_are_refused():
    from ogm_mcmc.errors import ConfigError

    with pytest.raises(ConfigError, match='samples is 0: expected at least one'):
        mutual_information_bits(np.empty((0, 3), np.uint8))


def test_a_guess_orders_what_draws_tie_and_moves_nothing_further_than_one_draw_would():
    def row(*values):
        return GridMap(GridSpec(0.1, 7, 1), np.array([values], np.float32))

    mean = row(0.0, 0.0, 0.25, 1.0, 1.0, 0.0, math.nan)
    guess = row(0.4, 0.0, 0.65, 0.2, 1.0, math.nan, 0.3)
    found = with_one_more_draw(mean, guess, 4).probability[0]
    assert found[:6] == approx([0.08, 2e-31, 0.33, 0.84, 1.0, 0.0], rel=1e-5)
    # What no draw shows is told apart as finely as the guess does, sure as it is.
    sure = row(*[0.0] * 7)
    guess = row(1e-4, 1e-7, 1e-12, 1e-20, 1e-28, 1e-29, 1e-30)
    ordered = with_one_more_draw(sure, guess, 500).probability[0]
    assert (np.diff(ordered) < 0.0).all()
    assert ordered[-1] > 0.0
    assert found[4] < 1.0
    assert math.isnan(found[6])


def test_another_map_has_a_share_where_it_knows_anything():
    def row(*values):
        return GridMap(GridSpec(0.1, 5, 1), np.array([values], np.float32))

    mean = row(0.0, 1.0, 0.4, 1e-30, math.nan)
    other = row(0.5, 0.25, math.nan, 0.0, 0.5)
    found = with_share_of(mean, other, 0.1).probability[0]
    assert found[:4] == approx([0.05, 0.925, 0.4, 9e-31], rel=1e-5)
    assert math.isnan(found[4])
    half = with_share_of(mean, other, 0.1, lowering=0.05).probability[0]
    assert half[:4] == approx([0.05, 0.9625, 0.4, 9e-31], rel=1e-5)
    raised = with_share_of(mean, other, 0.1, lowering=0.0).probability[0]
    assert raised[:4] == approx([0.05, 1.0, 0.4, 9e-31], rel=1e-5)
    assert math.isnan(raised[4])


def test_what_the_mean_is_sure_of_is_moved_less():
    def row(*values):
        return GridMap(GridSpec(0.1, 5, 1), np.array([values], np.float32))

    mean, other = row(0.0, 1.0, 0.5, 0.1, 0.9), row(0.5, 0.0, 1.0, math.nan, 0.4)
    unmoved = with_share_of(mean, other, 0.2, of_sure=0.0).probability[0]
    assert unmoved == approx([0.0, 1.0, 0.6, 0.1, 0.9 - 0.12 * 0.5])  # 2 sqrt(.9 * .1) is .6
    some = with_share_of(mean, other, 0.2, lowering=0.0, of_sure=0.25).probability[0]
    assert some == approx([0.025, 0.95, 0.6, 0.1, 0.9])
    assert np.array_equal(
        with_share_of(mean, other, 0.2, of_sure=1.0).probability,
        with_share_of(mean, other, 0.2).probability,
    )


def test_sure_cells_have_a_share_of_their_neighbours():
    rng = np.random.default_rng(4)
    cells = rng.choice([0.0, 1.0, 0.5, 0.1, 0.9, math.nan], (7, 9)).astype(np.float32)
    found = with_neighbours(GridMap(GridSpec(0.1, 9, 7), cells), 0.25).probability
    for row, column in np.ndindex(7, 9):
        p, rise = float(cells[row, column]), 0.0
        for down, across in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            there = row + down, column + across
            if 0 <= there[0] < 7 and 0 <= there[1] < 9 and not math.isnan(cells[there]):
                rise += float(cells[there]) - p
        expected = p + 0.25 * (1.0 - 2.0 * p) ** 2 * rise
        assert found[row, column] == approx(expected, abs=1e-6, nan_ok=True)
        assert p != 0.5 or found[row, column] == 0.5
    assert np.nanmin(found) >= 0.0
    assert np.nanmax(found) <= 1.0


def test_a_map_is_raised_to_the_least_that_another_one_says():
    def row(*values):
        return GridMap(GridSpec(0.1, 5, 1), np.array([values], np.float32))

    mean, least = row(0.0, 1.0, 0.4, math.nan, 0.3), row(0.5, 0.25, math.nan, 0.9, 0.3)
    assert at_least(mean, least).probability[0] == approx(
        [0.5, 1.0, 0.4, math.nan, 0.3], nan_ok=True
    )
