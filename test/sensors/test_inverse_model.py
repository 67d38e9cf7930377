"""Inverse models against their definitions: convolution by numbers, values on paper."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.config import (
    GaussianModelConfig,
    MapperConfig,
    SonarModelConfig,
)
from ogm_mcmc.sensors import (
    GaussianInverseModel,
    SonarInverseModel,
    beam_model,
)
from ogm_mcmc.sensors.inverse_model_kernels import gaussian_log_odds, phi, sonar_log_odds

approx = pytest.approx


def convolved(distance, reading, width, sigma):
    """The ideal model of [pose] Fig. 1 times a normal density, summed by brute force."""
    noise = np.linspace(-9.0 * sigma, 9.0 * sigma, 200_001)
    density = np.exp(-0.5 * (noise / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))
    offset = distance - noise - reading
    ideal = np.where(offset < -width / 2, 0.0, np.where(offset < width / 2, 1.0, 0.5))
    return float(np.sum(ideal * density) * (noise[1] - noise[0]))


@pytest.mark.parametrize('distance', [0.5, 1.5, 1.9, 2.0, 2.2, 3.0, 5.0])
@pytest.mark.parametrize(('width', 'sigma'), [(0.3, 0.3), (0.07, 0.03), (1.0, 0.1)])
def test_gaussian_is_the_convolution_of_the_step(distance, width, sigma):
    model = GaussianInverseModel(GaussianModelConfig(sigma=sigma, width=width), 0.05)
    expected = convolved(distance, 2.0, width, sigma)
    assert float(model.probability(np.array(distance), 2.0)) == approx(expected, abs=1e-4)


def test_the_printed_equation_is_this_one_shifted_by_the_reading():
    """[pose] Eq. 4 with A, B and C as printed, z = 2, sigma = 0.3: its r = 4 is our r = 2."""
    sigma, z, width, r = 0.3, 2.0, 0.3, 4.0
    a = math.erf(-z / (math.sqrt(2.0) * sigma))
    b = math.erf((r - 2.0 * z + width / 2.0) / (math.sqrt(2.0) * sigma))
    c = math.erf((r - 2.0 * z - width / 2.0) / (math.sqrt(2.0) * sigma))
    printed = -0.25 * a + 0.5 * b - 0.25 * c
    ours = GaussianInverseModel(GaussianModelConfig(sigma=sigma, width=width), 0.05)
    assert float(ours.probability(np.array(2.0), z)) == approx(0.537, abs=5e-4)
    assert printed == approx(0.537, abs=5e-4)


def test_floor_and_ceiling():
    model = GaussianInverseModel(GaussianModelConfig(sigma=0.01, l_min=-3.0, l_max=2.0), 0.05)
    values = model.log_odds(np.array([0.0, 1.0, 2.0, 9.0]), 2.0)
    assert values.tolist() == approx([-3.0, -3.0, 2.0, 0.0])


def test_sigma_grows_with_the_square_of_the_range():
    """A stereo camera of 0.12 m baseline and 500 px focal length: z^2 / (b f)."""
    model = GaussianInverseModel(
        GaussianModelConfig(sigma=0.02, sigma_growth=1.0 / (0.12 * 500)), 0.05
    )
    assert model.sigma_m(3.0) == approx(0.02 + 9.0 / 60.0)


def test_width_is_the_diagonal_of_a_cell_unless_told():
    assert GaussianInverseModel(GaussianModelConfig(), 0.1).width_m == approx(0.1 * math.sqrt(2.0))
    assert GaussianInverseModel(GaussianModelConfig(width=0.4), 0.1).width_m == 0.4


@given(
    distance=st.floats(0.0, 20.0),
    reading=st.floats(0.1, 20.0),
    sigma=st.floats(0.01, 2.0),
    width=st.floats(0.01, 2.0),
    low=st.sampled_from([-1.3863, -6.0, -20.0]),
)
@REPEATABLE
def test_gaussian_kernel_equals_the_function(distance, reading, sigma, width, low):
    config = GaussianModelConfig(sigma=sigma, width=width, l_min=low, l_max=5.0)
    expected = float(GaussianInverseModel(config, 0.05).log_odds(np.array(distance), reading))
    found = gaussian_log_odds(
        distance, reading, sigma, width / 2.0, np.float32(low), np.float32(5.0)
    )
    # Of the greatest log-odds the table gives 3 parts in 1000 of the smaller probability.
    assert float(found) == approx(expected, abs=3e-4 if abs(expected) < 7.0 else 5e-3)


@given(st.floats(-9.0, 9.0))
@REPEATABLE
def test_table_of_the_normal_distribution(x):
    assert phi(x) == approx(0.5 * math.erfc(-x / math.sqrt(2.0)), abs=8e-6)


@pytest.mark.parametrize('low', [-0.01, -1.3863, -5.0, -20.0])
def test_in_front_of_what_is_evaluated_the_model_is_flat(low):
    config = MapperConfig(
        inverse_model='gaussian', gaussian=GaussianModelConfig(sigma=0.2, width=0.3, l_min=low)
    )
    model = beam_model(config)
    first = 4.0 - 0.15 - model.sigmas_before * 0.2
    whole = GaussianInverseModel(config.gaussian, 0.05)
    assert whole.log_odds(np.array([first - 1e-6]), 4.0)[0] == approx(low)
    assert whole.log_odds(np.array([first + 0.1]), 4.0)[0] > low


def test_behind_what_is_evaluated_next_to_nothing_is_said():
    model = GaussianInverseModel(GaussianModelConfig(sigma=0.2, width=0.3), 0.05)
    assert abs(model.log_odds(np.array([4.0 + 0.15 + 0.6]), 4.0)[0]) < 0.003


def test_lengths_of_the_kernel_model_are_cells():
    gaussian = GaussianModelConfig(sigma=0.2, sigma_growth=0.01, width=0.3)
    model = beam_model(MapperConfig(inverse_model='gaussian', resolution=0.1, gaussian=gaussian))
    assert (model.sigma, model.half_width) == approx((2.0, 1.5))
    # 5 m are 50 cells: sigma there is 0.2 + 0.25 m, that is 4.5 cells.
    assert model.sigma + model.growth * 50.0**2 == approx(4.5)


# -- sonar --------------------------------------------------------------------------------------

SONAR = SonarInverseModel(
    SonarModelConfig(strength=0.4, strength_far=0.2, thickness=0.2, sigma_share=0.5)
)


def on_axis(distance, reading):
    return float(SONAR.log_odds(np.array(distance), np.array(0.0), reading, 4.0, 0.6))


def test_sonar_along_the_axis_on_paper():
    """Half of the greatest range: strength 0.3, so 0.2 in front and 0.8 at the echo."""
    assert on_axis(1.0, 2.0) == approx(math.log(0.2 / 0.8))
    assert on_axis(2.0, 2.0) == approx(math.log(0.8 / 0.2))
    assert on_axis(1.85, 2.0) == approx(0.0)
    assert on_axis(2.15, 2.0) == approx(math.log(0.65 / 0.35))
    assert on_axis(2.3, 2.0) == 0.0


@pytest.mark.parametrize(('reading', 'strength'), [(0.0, 0.4), (1.0, 0.35), (4.0, 0.2)])
def test_sonar_is_linear_in_the_range(reading, strength):
    assert SONAR.strength(reading, 4.0) == approx(strength)


def test_sonar_is_gaussian_across_the_angle():
    """At one sigma, half of the half angle 0.3, the strength is exp(-1/2) of that on the axis."""
    moved = 0.3 * math.exp(-0.5)
    for sign in (-1.0, 1.0):
        value = SONAR.log_odds(np.array(2.0), np.array(sign * 0.15), 2.0, 4.0, 0.6)
        assert float(value) == approx(math.log((0.5 + moved) / (0.5 - moved)))
    assert float(SONAR.log_odds(np.array(2.0), np.array(0.31), 2.0, 4.0, 0.6)) == 0.0


@given(distance=st.floats(0.0, 5.0), angle=st.floats(-0.3, 0.3), reading=st.floats(0.05, 4.0))
@REPEATABLE
def test_sonar_kernel_equals_the_function(distance, angle, reading):
    expected = SONAR.log_odds(np.array(distance), np.array(angle), reading, 4.0, 0.6)
    strength, sigma = SONAR.strength(reading, 4.0), SONAR.sigma_rad(0.6)
    found = sonar_log_odds(distance, angle, reading, True, strength, sigma, 0.2)
    assert found == approx(float(expected), abs=1e-9)
