"""The recursive field: by hand, against the linear system, in any order, and growing."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.config import RandomFieldConfig
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.mapping.gaussian_field import (
    GaussianField,
    covariance,
    dropped_mass,
    solve_field,
    stencil_radius,
)
from ogm_mcmc.mapping.gaussian_field_kernels import take_in

approx = pytest.approx
NAN = math.nan

# Exact in float32, so that both sides see the same observations.
values = st.integers(-1600, 1600).map(lambda k: k / 16)


@st.composite
def observations(draw, side=6):
    """A small field observed in part; nan elsewhere."""
    shape = draw(st.tuples(st.integers(1, side), st.integers(1, side)))
    cells = [draw(st.one_of(st.just(NAN), values)) for _ in range(shape[0] * shape[1])]
    return np.array(cells).reshape(shape)


configs = st.builds(
    RandomFieldConfig,
    length_scale=st.sampled_from([0.5, 1.0, 2.0, 5.0]),
    variance=st.sampled_from([0.03, 0.1, 0.3, 2.0]),
    mean=st.sampled_from([0.0, -1.5]),
)


def whole(observed, config):
    """A field in which nothing is dropped."""
    return GaussianField(*observed.shape, config, radius=max(observed.shape))


def one_by_one(field, observed, order):
    """Take in one cell after the other."""
    columns = observed.shape[1]
    for cell in order:
        row, column = divmod(int(cell), columns)
        field.observe(observed[row : row + 1, column : column + 1], row, column)


def is_solution(field, observed, config, tolerance=1e-9):
    expected = solve_field(observed, config)
    assert field.mean == approx(expected.mean, abs=tolerance)
    assert field.variance() == approx(expected.variance, abs=tolerance)


# -- by hand ------------------------------------------------------------------------------------


def test_covariance_divides_by_twice_the_length_scale_itself():
    """[field] Eq. 11: 2 l and not 2 l^2."""
    assert covariance(9.0, 2.0) == approx(math.exp(-9.0 / 4.0))
    assert stencil_radius(RandomFieldConfig(length_scale=2.0, drop=1e-4)) == 6
    assert covariance(6.0**2, 2.0) >= 1e-4 > covariance(7.0**2, 2.0)


def test_one_observation_on_paper():
    """[field] Eq. 24: D_i = K_i - K_ij / (sigma^2 + K_jj) K_j."""
    config = RandomFieldConfig(length_scale=1.0, variance=0.25)
    field = GaussianField(1, 3, config, radius=2)
    field.observe(np.array([[NAN, 5.0, NAN]]))
    k = math.exp(-0.5)
    assert field.mean == approx(np.array([[4.0 * k, 4.0, 4.0 * k]]))
    assert field.variance() == approx(np.array([[1 - 0.8 * k * k, 0.2, 1 - 0.8 * k * k]]))


def test_two_observations_on_paper():
    """The second step uses the D of the first, not K (the general form of Eq. 24).

    Cells 0 and 1, k = exp(-1/2): l = K (K + sigma^2 I)^-1 O, a system of two equations.
    """
    config = RandomFieldConfig(length_scale=1.0, variance=0.25)
    field = GaussianField(1, 2, config, radius=1)
    field.observe(np.array([[5.0, NAN]]))
    field.observe(np.array([[5.0, -2.0]]))
    k = math.exp(-0.5)
    determinant = 1.25**2 - k * k
    a, b = (1.25 * 5.0 + k * 2.0) / determinant, (-1.25 * 2.0 - k * 5.0) / determinant
    assert field.mean == approx(np.array([[a + k * b, k * a + b]]))
    with_k_alone = 1.0 - 1.0 / 1.25 - k * k / 1.25
    assert field.variance()[0, 0] > with_k_alone + 0.1


def test_the_linear_system_is_equation_21():
    """As printed, with the inverse of K, which is well-behaved for a short length scale."""
    config = RandomFieldConfig(length_scale=0.5, variance=0.1, mean=0.7)
    observed = np.array([[1.0, NAN, -3.0], [NAN, 9.0, NAN]])
    places = [(r, c) for r in range(2) for c in range(3)]
    prior = np.array([[math.exp(-(math.dist(a, b) ** 2)) for a in places] for b in places])
    precision = np.diag(np.where(np.isnan(observed), 0.0, 1.0 / 0.1).ravel())
    posterior = np.linalg.inv(np.linalg.inv(prior) + precision)
    difference = np.nan_to_num(observed - 0.7).ravel()
    solved = solve_field(observed, config)
    assert solved.mean.ravel() == approx(0.7 + posterior @ precision @ difference)
    assert solved.variance.ravel() == approx(np.diag(posterior))


# -- nothing dropped ----------------------------------------------------------------------------


@given(observed=observations(), config=configs)
@settings(REPEATABLE, max_examples=80)
def test_recursive_equals_batch(observed, config):
    field = whole(observed, config)
    field.observe(observed)
    is_solution(field, observed, config)


@given(observed=observations(5), config=configs, seed=st.integers(0, 1000))
@settings(REPEATABLE, max_examples=60)
def test_any_order_gives_the_same(observed, config, seed):
    field = whole(observed, config)
    one_by_one(field, observed, np.random.default_rng(seed).permutation(observed.size))
    is_solution(field, observed, config)


@given(observed=observations(5), config=configs, seed=st.integers(0, 1000))
@settings(REPEATABLE, max_examples=60)
def test_an_observation_may_be_revised(observed, config, seed):
    """Only the last value counts, and the variance stays ([field] section IV)."""
    rng = np.random.default_rng(seed)
    field = whole(observed, config)
    first = np.where(np.isnan(observed), NAN, rng.integers(-99, 99, observed.shape))
    field.observe(first)
    variance = field.variance()
    field.observe(observed)
    assert np.array_equal(field.variance(), variance)
    is_solution(field, observed, config)


# -- any point ----------------------------------------------------------------------------------


def solve_points(observed, points, config):
    """[field] Eq. 21 with the points in it, as one linear system; nothing dropped."""
    known = ~np.isnan(observed)
    cells = np.argwhere(known) + 0.5

    def between(a, b):
        return covariance(((a[:, None] - b) ** 2).sum(axis=-1), config.length_scale)

    system = between(cells, cells) + config.variance * np.eye(len(cells))
    gain = np.linalg.solve(system, between(cells, points)).T
    mean = config.mean + gain @ (observed[known] - config.mean)
    return mean, 1.0 - (gain * between(points, cells)).sum(axis=1)


@given(observed=observations(), config=configs, seed=st.integers(0, 1000))
@settings(REPEATABLE, max_examples=60)
def test_any_point_as_in_the_linear_system(observed, config, seed):
    """Points beside, between and upon the centres of cells, and outside of the field."""
    field = whole(observed, config)
    field.observe(observed)
    points = np.random.default_rng(seed).uniform(-4.0, 10.0, (12, 2))
    points[0] = 0.5, 0.5
    mean, variance = solve_points(observed, points, config)
    found = field.at(points)
    assert found.mean == approx(mean, abs=1e-9)
    assert found.variance == approx(np.clip(variance, 0.0, 1.0), abs=1e-9)
    assert found.mean[0] == approx(field.mean[0, 0], abs=1e-9)


def test_points_four_times_as_dense_as_cells():
    """The figures of [field]: length scales 0.5 to 2, variances 0.03 and 0.3."""
    observed = room()[20:32, 12:24]
    axis = np.arange(0.125, 12.0, 0.25)
    points = np.stack(np.meshgrid(axis, axis, indexing='ij'), axis=-1).reshape(-1, 2)
    for length_scale in (0.5, 1.0, 2.0):
        for noise in (0.03, 0.3):
            config = RandomFieldConfig(length_scale=length_scale, variance=noise)
            field = GaussianField(12, 12, config, radius=12)
            field.observe(observed)
            mean, variance = solve_points(observed, points, config)
            found = field.at(points)
            assert found.mean == approx(mean, abs=1e-9)
            assert found.variance == approx(variance, abs=1e-9)


# -- elements dropped ---------------------------------------------------------------------------


def test_dropped_mass_by_plain_summation():
    config = RandomFieldConfig(length_scale=2.0, drop=1e-3)
    cells = [(r, c) for r in range(-30, 31) for c in range(-30, 31)]
    outside = [cell for cell in cells if max(map(abs, cell)) > 5]
    assert dropped_mass(config) == approx(
        sum(math.exp(-(r * r + c * c) / 4.0) for r, c in outside), rel=1e-9
    )


def test_dropping_too_much_is_refused():
    config = RandomFieldConfig(length_scale=2.0, variance=0.1, drop=0.1)
    with pytest.raises(ConfigError, match=r'^random_field.drop is 0.1: leaves out .* of 0\.\d+ '):
        GaussianField(3, 3, config)
    GaussianField(3, 3, replace(config, drop=0.01))


@given(
    observed=observations(9),
    config=configs,
    drop=st.sampled_from([1e-5, 1e-3, 1e-2]),
    seed=st.integers(0, 99),
)
@settings(REPEATABLE, max_examples=60)
def test_variance_never_grows(observed, config, drop, seed):
    config = replace(config, drop=drop)
    assume(dropped_mass(config) < config.variance)
    field = GaussianField(*observed.shape, config)
    radius = field.radius
    before = field.variance()
    columns = observed.shape[1]
    for cell in np.random.default_rng(seed).permutation(observed.size):
        one_by_one(field, observed, [cell])
        after = field.variance()
        assert (after <= before).all()
        assert (after > 0.0).all()
        # What lies beyond the stencil is not touched at all.
        row, column = divmod(int(cell), columns)
        rows, around = np.mgrid[: observed.shape[0], :columns]
        far = np.maximum(abs(rows - row), abs(around - column)) > radius
        assert np.array_equal(after[far], before[far])
        before = after


def room():
    """Free space with a wall across and a strip never seen."""
    observed = np.full((36, 36), -20.0)
    observed[:, 17] = 15.0
    observed[25:28] = NAN
    return observed


@pytest.mark.parametrize('length_scale', [0.5, 1.0, 2.0])
def test_what_is_dropped_hardly_matters(length_scale):
    """Of observations of 20, errors of a few tenths, less the less is dropped."""
    errors = []
    for drop in (1e-2, 1e-4, 1e-6):
        config = RandomFieldConfig(length_scale=length_scale, drop=drop)
        field = GaussianField(36, 36, config)
        field.observe(room())
        solved = solve_field(room(), config)
        errors.append(np.sqrt(np.mean((field.mean - solved.mean) ** 2)))
        assert field.variance() == approx(solved.variance, abs=0.02)
    assert errors[0] > errors[1] >= errors[2]
    assert errors[1] < 0.15
    assert errors[2] < 0.05


def test_radius_zero_is_independent_cells():
    config = RandomFieldConfig(variance=0.25)
    field = GaussianField(2, 2, config, radius=0)
    field.observe(np.array([[5.0, NAN], [-5.0, 2.5]]))
    assert field.mean == approx(np.array([[4.0, 0.0], [-4.0, 2.0]]))
    assert field.variance() == approx(np.array([[0.2, 1.0], [0.2, 0.2]]))


# -- growing ------------------------------------------------------------------------------------


@given(observed=observations(6), seed=st.integers(0, 99))
@settings(REPEATABLE, max_examples=40)
def test_a_field_that_grew_is_one_that_was_large(observed, seed):
    config = RandomFieldConfig(length_scale=0.5, drop=1e-2)
    radius = stencil_radius(config)
    height, width = observed.shape
    small = GaussianField(height + 2 * radius, width + 2 * radius, config)
    large = GaussianField(height + 11, width + 9, config)
    inner, outer = np.full(small.mean.shape, NAN), np.full(large.mean.shape, NAN)
    inner[radius : radius + height, radius : radius + width] = observed
    outer[5 : 5 + height, 4 : 4 + width] = observed
    small.observe(inner)
    small.grow(*large.mean.shape, 5 - radius, 4 - radius)
    large.observe(outer)
    more = np.random.default_rng(seed).integers(-9, 9, outer.shape)
    outer[np.isnan(outer)] = more[np.isnan(outer)]
    for field in (small, large):
        field.observe(outer)
    assert small.mean == approx(large.mean, abs=1e-9)
    assert small.variance() == approx(large.variance(), abs=1e-9)


def test_a_forgotten_field_is_a_new_one():
    observed = room()
    field, fresh = (GaussianField(36, 36, RandomFieldConfig()) for _ in range(2))
    field.observe(-observed)
    field.forget()
    assert not field.mean.any()
    assert (field.variance() == 1.0).all()
    for one in (field, fresh):
        one.observe(observed)
    assert np.array_equal(field.mean, fresh.mean)
    assert field.n_bytes == fresh.n_bytes


@pytest.mark.parametrize('corner', [(0, 1), (2, 0), (-1, 0), (0, -1)])
def test_observations_outside_of_the_field_are_refused(corner):
    message = r'observations \(2, 2\) from .*: expected a part of \(3, 2\)'
    with pytest.raises(GridError, match=message):
        GaussianField(3, 2, RandomFieldConfig()).observe(np.zeros((2, 2)), *corner)


@pytest.mark.jit
def test_one_specialization_of_the_kernel():
    for config in (RandomFieldConfig(), RandomFieldConfig(length_scale=2, variance=1, mean=1)):
        field = GaussianField(5, 4, config)
        field.observe(np.zeros((5, 4)))
        field.observe(np.zeros((8, 8), np.int8)[::2, ::4], 1, 1)
        field.grow(10, 10, 2, 3)
        field.observe(np.ones((2, 2), np.float32), 4, 4)
    assert len(take_in.signatures) == 1, take_in.signatures
