"""Shares of clutter and missing returns: beams judge beams."""

import math

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ChainConfig, ForwardModelConfig, SamplerConfig, WindowConfig
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.sensor_fit import (
    LEAST_SHARE,
    SensorNumbers,
    Share,
    _meets,
    _sum_around,
    fit_sensor,
)
from ogm_mcmc.geometry import HeldRays, PlacedScan, Pose2D

FITTED = ChainConfig(sensor='fitted')


def config(**window):
    return SamplerConfig(window=WindowConfig(0.1, **window), chain=FITTED)


def scans_of(*ranges_m):
    """Scans of one beam each along x from the same place, the wall 2 m away."""
    return [PlacedScan.at(fan(one, range_max_m=5.0), Pose2D(0.05, 0.05)) for one in ranges_m]


def test_beams_confirm_and_contradict_each_other():
    """19 at the wall and one in front of it, which 19 passed."""
    model, found = fit_sensor(scans_of(*[2.0] * 19, 1.0), config())
    assert found.clutter.beams == 20
    assert model.clutter == found.clutter.mean == pytest.approx(2.0 / 120.0)
    assert model.sigma == ForwardModelConfig().sigma


def test_beams_that_meet_nothing_say_nothing_of_clutter():
    _, found = fit_sensor(scans_of(math.inf, math.inf), config())
    assert (found.clutter.beams, found.missing.beams) == (0, 0)


def test_a_lone_reading_says_nothing_of_clutter():
    model, found = fit_sensor(scans_of(2.0), config())
    assert found.clutter.beams == 0
    assert found.clutter.mean == pytest.approx(0.01)
    assert model.clutter == 0.01


def test_a_beam_through_a_wall_without_a_return_is_missing():
    lost = fit_sensor(scans_of(*[2.0] * 19, math.inf), config())[1].missing
    assert lost.beams == 20
    assert lost.mean == pytest.approx(2.0 / 120.0)
    model, found = fit_sensor(scans_of(*[2.0] * 19, math.inf), config(no_return='ignore'))
    assert found.missing is None
    assert found.as_dict()['missing'] is None
    assert found.as_dict()['clutter']['beams'] == 19
    assert model.missing == ForwardModelConfig().missing


def test_shares_have_a_floor_and_deviations_of_a_beta():
    model, found = fit_sensor(scans_of(*[2.0] * 2000), config())
    assert found.clutter.mean < LEAST_SHARE == model.clutter == model.missing
    draws = np.random.default_rng(1).beta(1.0 + 3.0, 99.0 + 197.0, 100_000)
    share = Share.of(3.0, 200.0)
    assert share.mean == pytest.approx(draws.mean(), rel=0.01)
    assert share.deviation == pytest.approx(draws.std(), rel=0.02)
    ends = (share.low_95, share.high_95)
    assert ends == pytest.approx(tuple(np.quantile(draws, (0.025, 0.975))), rel=0.05)
    assert str(SensorNumbers(share, None)).startswith('clutter 0.0133 (0.00')


def test_rays_that_are_cast_again_say_the_same(monkeypatch):
    """Of long recordings rays are held up to a limit only."""
    scans = scans_of(*[2.0] * 19, 1.0, math.inf, 9.0)
    model, found = fit_sensor(scans, config())
    monkeypatch.setattr(HeldRays.__init__, '__defaults__', (3,))
    assert fit_sensor(scans, config()) == (model, found)


def test_given_numbers_stay():
    given = SamplerConfig(window=WindowConfig(0.1))
    assert fit_sensor(scans_of(2.0), given) == (given.model, None)
    gaussian = SamplerConfig(model=ForwardModelConfig(kind='gaussian'), chain=FITTED)
    assert fit_sensor(scans_of(2.0), gaussian) == (gaussian.model, None)


def test_rays_are_sampled_with_what_was_fitted_until_they_are_taken_anew():
    refinement = Refinement(config())
    scans = scans_of(*[2.0] * 19, 1.0)
    refinement.take(scans)
    fitted = refinement.window.model.clutter
    assert fitted == refinement.beams.sensor.clutter.mean == pytest.approx(2.0 / 120.0)
    more = [*scans, *scans_of(1.0, 1.5)]
    refinement.take(more)  # the rays go on
    assert refinement.window.model.clutter == fitted
    refinement.take([*more, *scans_of(*[2.0] * 18)])  # twice as many as told of it
    assert refinement.window.model.clutter == refinement.beams.sensor.clutter.mean != fitted
    assert refinement.size.n_rays == 40
    refinement.take(scans_of(2.0, 2.0))
    assert refinement.window.model.clutter != fitted


def test_sums_around_cells_and_ways_of_rays_on_paper():
    counts = np.zeros((4, 5), np.int64)
    counts[1, 1], counts[3, 4] = 2, 5
    around = _sum_around(counts, 1)
    expected = np.zeros((4, 5), np.int64)
    expected[0:3, 0:3] += 2
    expected[2:4, 3:5] += 5
    assert np.array_equal(around, expected)
    solid = np.zeros((5, 9), bool)
    solid[2, 4] = True
    ends = np.array([(7.5, 0.5), (4.5, 0.5), (99.0, 0.5), (0.5, -9.0)]).T
    # The second one ends two cells behind; others leave the cells that are looked at.
    assert _meets(solid, (1, 2), (0.5, 0.5), ends).tolist() == [True, False, True, False]
    assert not _meets(solid, (1, 1), (0.5, 0.5), ends).any()
    assert _meets(solid, (1, 1), (0.5, 0.5), ends[:, :0]).shape == (0,)
