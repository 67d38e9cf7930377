"""Divergence and entropy: two coins on paper, SciPy, and what happens at 0 and 1."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats
from support.strategies import REPEATABLE

from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.evaluation import divergence, entropy_nats, total_divergence
from ogm_mcmc.evaluation.divergence import total_entropy

probabilities = st.floats(0.0, 1.0)


def test_two_coins_on_paper():
    expected = 0.5 * math.log(0.5 / 0.25) + 0.5 * math.log(0.5 / 0.75)
    assert divergence([0.5], [0.25])[0] == pytest.approx(expected)
    assert divergence([0.25], [0.5])[0] != pytest.approx(expected)
    assert divergence([1.0, 0.0], [0.8, 0.8]) == pytest.approx([-math.log(0.8), -math.log(0.2)])


def test_certainty():
    assert divergence([0.0, 1.0, 0.3], [0.0, 1.0, 0.3]).tolist() == [0.0, 0.0, 0.0]
    assert np.isinf(divergence([1.0, 0.0, 0.3, 0.3], [0.0, 1.0, 0.0, 1.0])).all()
    moved = total_divergence([1.0, 0.0, 0.3], [0.0, 0.4, 0.3], floor=0.01)
    assert moved.nats == pytest.approx(-math.log(0.01) - math.log(0.6))
    assert (moved.cells, moved.clipped) == (3, 1)


def test_unknown_cells_are_left_out():
    total = total_divergence([np.nan, 0.5, 0.5, 1.0], [0.5, np.nan, 0.25, 0.5])
    assert total.cells == 2
    assert total.nats == pytest.approx(divergence([0.5], [0.25])[0] + math.log(2.0))
    masked = total_divergence([0.5, 1.0], [0.25, 0.5], np.array([False, True]))
    assert masked.nats == pytest.approx(math.log(2.0))


@REPEATABLE
@given(p=probabilities, q=probabilities)
def test_never_negative_and_as_scipy_has_it(p, q):
    nats = divergence([p], [q])[0]
    expected = special.rel_entr(p, q) + special.rel_entr(1.0 - p, 1.0 - q)
    assert nats >= 0.0
    assert nats == pytest.approx(expected, rel=1e-9, abs=1e-12)
    if abs(p - q) > 1e-3:
        assert nats > 0.0


@REPEATABLE
@given(p=probabilities)
def test_entropy_as_scipy_has_it(p):
    assert entropy_nats([p])[0] == pytest.approx(stats.bernoulli(p).entropy(), abs=1e-12)


def test_entropy_of_unknown_is_unknown():
    assert np.isnan(entropy_nats([np.nan, 0.5])).tolist() == [True, False]
    assert entropy_nats([0.5])[0] == pytest.approx(math.log(2.0))


def test_what_is_no_probability():
    with pytest.raises(GridError, match='estimate: expected probabilities'):
        divergence([0.5], [1.5])
    with pytest.raises(GridError, match='same cells'):
        divergence([0.5, 0.5], [0.5])
    with pytest.raises(ConfigError, match='floor'):
        divergence([0.5], [0.5], floor=0.5)


def test_the_sum_of_the_entropy_is_that_of_all_cells():
    p = np.random.default_rng(3).random((7, 11))
    assert total_entropy(p) == pytest.approx(entropy_nats(p).sum(), rel=1e-12)
