"""The closed form for a line of cells."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.lab.exact import line_posterior

approx = pytest.approx


def enumerated(log_likelihood, prior):
    """Every map of the line, its first occupied cell looked for."""
    n_cells = log_likelihood.shape[1] - 1
    weight, occupied = [], []
    for cells in itertools.product((0, 1), repeat=n_cells):
        first = cells.index(1) if 1 in cells else n_cells
        log_prior = sum(np.log(prior if cell else 1.0 - prior) for cell in cells)
        weight.append(np.exp(log_likelihood[:, first].sum() + log_prior))
        occupied.append(cells)
    return np.array(weight) @ np.array(occupied).reshape(len(weight), -1) / np.sum(weight)


@given(
    values=st.lists(st.floats(-8.0, 3.0), min_size=18, max_size=18),
    n_cells=st.integers(1, 8),
    n_rays=st.integers(1, 2),
    prior=st.sampled_from([0.5, 0.03, 0.9]),
)
@REPEATABLE
def test_equals_every_map_by_itself(values, n_cells, n_rays, prior):
    log_likelihood = np.resize(values, (n_rays, n_cells + 1))
    expected = enumerated(log_likelihood, prior)
    assert line_posterior(log_likelihood, prior) == approx(expected, abs=1e-10)


def test_two_cells_on_paper():
    """p(z | first) 4, p(z | second) 2, p(z | none) 1, prior 1/2: of 4 + 4 + 2 + 1 parts."""
    posterior = line_posterior(np.log([[4.0, 2.0, 1.0]]), 0.5)
    assert posterior == approx([8 / 11, 6 / 11])


def test_two_hundred_cells():
    """A tail no reading tells apart from nothing keeps its prior and leaves the rest alone."""
    rng = np.random.default_rng(4)
    seen = rng.normal(0.0, 3.0, (5, 10))
    nothing = rng.normal(0.0, 3.0, (5, 1))
    long = np.column_stack((seen, np.repeat(nothing, 191, axis=1)))
    posterior = line_posterior(long, 0.2)
    assert posterior.shape == (200,)
    assert posterior[:10] == approx(enumerated(np.column_stack((seen, nothing)), 0.2), abs=1e-12)
    assert posterior[10:] == approx(np.full(190, 0.2), abs=1e-12)


def test_two_hundred_cells_and_many_readings():
    """Likelihoods far beyond the range of a float, where only their ratio matters."""
    n_cells, sigma = 200, 2.0
    readings = np.random.default_rng(1).normal(150.0, sigma, 400)
    d = np.arange(n_cells + 1.0)
    log_likelihood = -0.5 * ((readings[:, None] - d) / sigma) ** 2
    posterior = line_posterior(log_likelihood, 0.5)
    assert np.isfinite(posterior).all()
    wall = int(np.argmax(posterior))
    assert wall == round(readings.mean())
    assert posterior[wall] > 0.99
    assert posterior[: wall - 2].max() < 1e-9
    assert posterior[wall + 2 :] == approx(np.full(n_cells - wall - 2, 0.5), abs=1e-6)


@pytest.mark.parametrize('prior', [0.0, 1.0, -0.1, float('nan')])
def test_an_impossible_prior_is_refused(prior):
    with pytest.raises(ConfigError, match='prior is'):
        line_posterior(np.zeros((1, 3)), prior)
