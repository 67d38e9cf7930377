"""p(z | f) against its definition, scipy, and what any density has to be."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats
from support.cuts import cut_error
from support.naive_posterior import log_likelihood_of_range, log_likelihood_unseen
from support.strategies import REPEATABLE
from support.tiny_problems import forward_models

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.sensors.forward_model import ForwardModel
from ogm_mcmc.sensors.forward_model_kernels import level_log_likelihood, range_log_likelihood

approx = pytest.approx
REACH = 8.0

BEAMS = {
    'default': {},
    'wide': {'sigma': 2.0, 'clutter': 0.2},
    'short returns': {'sigma': 0.3, 'short': 0.2, 'short_decay': 0.7},
    'short returns that fall off fast': {'sigma': 0.3, 'short': 0.2, 'short_decay': 9.0},
    'many missing': {'sigma': 1.0, 'missing': 0.4, 'clutter': 1e-6},
    'hardly any hit': {'sigma': 0.3, 'missing': 0.4, 'clutter': 0.4, 'short': 0.19},
}
DISTANCES = [0.0, 1e-9, 0.05, 0.7, 4.0, REACH - 0.1, REACH, REACH + 0.3, 40.0, math.inf]


def model(**settings):
    return ForwardModel.from_config(ForwardModelConfig(**settings))


@pytest.mark.parametrize('name', BEAMS)
@pytest.mark.parametrize('distance', DISTANCES)
def test_all_outcomes_of_a_beam_sum_to_one(name, distance):
    beam = model(**BEAMS[name])

    def density(reading):
        return math.exp(beam.log_likelihood(reading, REACH, distance))

    # Where the density jumps or peaks.
    near = min(distance, REACH)
    points = {near + k * beam.sigma_m for k in (-8, -3, 0, 3, 8)} | {near}
    inside = sorted({0.0, REACH, *(p for p in points if 0.0 < p < REACH)})
    total = sum(
        integrate.quad(density, a, b, epsabs=1e-11, limit=200)[0] for a, b in pairwise(inside)
    )
    no_return = math.exp(beam.log_likelihood(math.inf, REACH, distance))
    # Something at distance 0 leaves no range to what is in front of it.
    expected = 1.0 - (beam.short if distance == 0.0 else 0.0)
    assert total + no_return == approx(expected, abs=1e-7)


@given(
    reading=st.floats(0.0, 20.0),
    distance=st.one_of(st.floats(0.0, 20.0), st.just(math.inf)),
    sigma=st.floats(1e-4, 10.0),
)
@REPEATABLE
def test_gaussian_equals_scipy(reading, distance, sigma):
    """Readings and cells beyond the reach count as at the reach."""
    found = model(kind='gaussian', sigma=sigma).log_likelihood(reading, REACH, distance)
    expected = stats.norm.logpdf(min(reading, REACH), min(distance, REACH), sigma)
    assert found == approx(float(expected), rel=1e-9, abs=1e-9)


anything = st.one_of(st.floats(0.0, 1e4), st.sampled_from([0.0, 5e-324, 1e-300, math.inf]))
any_model = st.one_of(
    st.builds(
        ForwardModelConfig,
        sigma=st.floats(1e-4, 10.0),
        clutter=st.floats(1e-6, 0.3),
        missing=st.floats(1e-6, 0.3),
        short=st.floats(0.0, 0.3),
        short_decay=st.floats(1e-3, 100.0),
    ),
    st.builds(ForwardModelConfig, kind=st.just('gaussian'), sigma=st.floats(1e-4, 10.0)),
)


@given(config=any_model, reading=anything, distance=anything, reach=st.floats(1e-3, 1e4))
@settings(REPEATABLE, max_examples=400)
def test_every_outcome_is_possible(config, reading, distance, reach):
    found = ForwardModel.from_config(config).log_likelihood(reading, reach, distance)
    assert math.isfinite(found)
    assert math.isfinite(np.float32(found))


@given(
    config=forward_models,
    reading=st.one_of(st.floats(0.01, 9.0), st.just(math.inf)),
    distance=st.one_of(st.floats(0.0, 9.0), st.just(math.inf)),
)
@settings(REPEATABLE, max_examples=300)
def test_equals_the_definition(config, reading, distance):
    found = ForwardModel.from_config(config).log_likelihood(reading, REACH, distance)
    expected = log_likelihood_of_range(config, reading, REACH, distance)
    assert found == approx(expected, rel=1e-9, abs=1e-9)


def test_by_hand():
    beam = model(sigma=0.5, clutter=0.1, missing=0.2, short=0.0)
    peak = 0.7 / (0.5 * math.sqrt(2.0 * math.pi))
    assert beam.log_likelihood(4.0, 8.0, 4.0) == approx(math.log(peak + 0.1 / 8.0))
    assert beam.log_likelihood(4.0, 8.0, math.inf) == approx(math.log(0.1 / 8.0))
    assert beam.log_likelihood(math.inf, 8.0, math.inf) == approx(math.log(0.9))
    assert beam.log_likelihood(math.inf, 8.0, 2.0) == approx(math.log(0.2))
    # A cell at the very reach is missed by every other beam, one beyond it by nearly all.
    assert beam.log_likelihood(math.inf, 8.0, 8.0) == approx(math.log(0.2 + 0.7 / 2.0))
    assert beam.log_likelihood(math.inf, 8.0, 12.0) == approx(math.log(0.9))
    gaussian = model(kind='gaussian', sigma=0.5)
    top = -math.log(0.5 * math.sqrt(2.0 * math.pi))
    assert gaussian.log_likelihood(math.inf, 8.0, math.inf) == approx(top)
    assert gaussian.log_likelihood(math.inf, 8.0, 7.0) == approx(top - 2.0)
    assert gaussian.log_likelihood(7.0, 8.0, math.inf) == approx(top - 2.0)


@given(
    config=any_model,
    reading=st.one_of(st.floats(0.01, 30.0), st.just(math.inf)),
    distance=st.floats(0.0, 31.0),
)
@settings(REPEATABLE, max_examples=400)
def test_level_agrees_with_the_whole_formula(config, reading, distance):
    """Everything that is `near` or further from the reading, or the reach, has the level."""
    forward, reach = ForwardModel.from_config(config), 30.0
    level, near = level_log_likelihood(forward, reading, reach)
    in_front = distance < reach or reading <= reach
    if in_front and abs(distance - min(reading, reach)) >= near:
        full = range_log_likelihood(forward, reading, reach, distance)
        assert level == approx(full, abs=1e-6)


@pytest.mark.parametrize('config', [ForwardModelConfig(), ForwardModelConfig(short=0.1)])
def test_there_is_a_level_where_it_saves_work(config):
    forward = ForwardModel.from_config(config)
    level, near = level_log_likelihood(forward, math.inf, 30.0)
    assert near < 1.0
    assert level == approx(math.log(config.missing))


@given(config=forward_models, reading=st.floats(0.1, 7.9), cut=st.sampled_from([0.5, 2.0, 6.0]))
@REPEATABLE
def test_cut_error_bounds_every_outcome_behind_the_cut(config, reading, cut):
    forward = ForwardModel.from_config(config)
    bound = cut_error(forward, cut, reading, REACH)
    at = reading + cut * config.sigma
    if at >= REACH:
        assert bound == 0.0
        return
    given_to_all = log_likelihood_unseen(config, reading, REACH, at)
    for distance in [*np.linspace(at, REACH + 1.0, 40), math.inf]:
        actual = log_likelihood_of_range(config, reading, REACH, float(distance))
        assert abs(actual - given_to_all) <= bound + 1e-9


def test_cut_error_is_nothing_where_rays_are_cut_by_default():
    """beam, 6 sigma: 1e-6 nats a ray and less with the clutter of a real sensor."""
    beam = model()
    assert 0.0 < cut_error(beam, 6.0, 4.0, 30.0) < 1e-4
    assert cut_error(beam, 6.0, math.inf, 30.0) == 0.0
    assert cut_error(beam, 6.0, 29.9, 30.0) == 0.0
    # Here a cut is another model.
    assert cut_error(model(kind='gaussian', sigma=0.5), 2.0, 4.0, 30.0) > 100.0
