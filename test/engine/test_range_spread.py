"""Sigma from the share of others that passed the cell of a reading."""

import math

import numpy as np
import pytest
from support.refinements import lattice_map
from support.strategies import fan

from ogm_mcmc.config import ChainConfig, ForwardModelConfig, SamplerConfig, WindowConfig
from ogm_mcmc.config.nodes import NodeModelConfig
from ogm_mcmc.engine.live_map import DOUBTED, DOUBTED_SHARP, Reflections
from ogm_mcmc.engine.range_spread import (
    LEAST_CELLS,
    MOST_CELLS,
    SEEN_BEFORE,
    Spread,
    _cells,
    _share,
    blur_of,
    spread_of,
)
from ogm_mcmc.engine.sensor_fit import fit_sensor
from ogm_mcmc.geometry import PlacedScan, Pose2D

DEFAULT = ForwardModelConfig().sigma
CELL = 0.05


def test_shares_on_paper():
    """Two cells: of four readings one is passed by three; three meet one other each, and pass."""
    hits, misses, beside = np.array([[4, 1, 0]]), np.array([[0, 4, 9]]), np.array([[5, 5, 5]])
    found = spread_of(hits, misses, beside, CELL)
    assert found.beams == 5
    share = (4 * 0.0 + 1 * 1.0 + SEEN_BEFORE * _share(1.0)) / (5 + SEEN_BEFORE)
    assert found.mean == pytest.approx(CELL * 1.8 * share)
    assert found.low_95 < found.mean < found.high_95
    assert found.deviation == pytest.approx((found.high_95 - found.low_95) / 3.92)


def test_readings_that_none_met_and_that_are_contradicted_say_nothing():
    hits, misses = np.array([[1, 1]]), np.array([[0, 40]])
    found = spread_of(hits, misses, beside=np.array([[1, 1]]), resolution_m=CELL)
    assert found == (DEFAULT, None, 0, None, None)
    assert str(found) == '0.0500 m (not told)'
    # The same reading beside others of its wall is one that fell short.
    near = spread_of(hits, misses, beside=np.array([[1, 9]]), resolution_m=CELL)
    assert near.beams == 1
    assert near.mean > DEFAULT


def test_more_readings_make_it_surer_and_limits_hold():
    hits, misses = np.full((1, 50), 3), np.tile([0, 2], (1, 25))
    few, many = (spread_of(n * hits, n * misses, 9 * n * hits, CELL) for n in (1, 40))
    assert many.deviation < few.deviation
    sharp = spread_of(900 * hits, 0 * misses, hits, CELL)
    assert sharp.mean == sharp.low_95 == pytest.approx(LEAST_CELLS * CELL)
    wide = spread_of(np.ones((9, 99), int), np.full((9, 99), 99), np.full((9, 99), 999), CELL)
    assert wide.mean == pytest.approx(MOST_CELLS * CELL)


def test_two_readings_that_say_what_was_expected_leave_sigma_in_doubt():
    """Where the default is 0.9 cells half of the others pass: here one of two."""
    cell = DEFAULT / 0.9
    two, many = (
        spread_of(np.full((1, n), 2), np.full((1, n), 1), np.full((1, n), 9), cell)
        for n in (1, 100)
    )
    assert two.beams == 2
    assert two.mean == pytest.approx(DEFAULT)
    assert two.low_95 < 0.5 * DEFAULT < 1.5 * DEFAULT < two.high_95
    assert many.high_95 - many.low_95 < 0.1 * (two.high_95 - two.low_95)


@pytest.mark.parametrize('cell', [0.01, 0.001])
def test_few_readings_are_held_at_the_default_on_fine_grids_too(cell):
    """It is more cells there than sigma may be elsewhere."""
    found = spread_of(np.array([[2]]), np.array([[40]]), np.array([[99]]), cell)
    assert 0.8 * DEFAULT < found.mean <= DEFAULT


@pytest.mark.parametrize('cell', [3.0, 10.0])
def test_sigma_is_never_more_than_the_setting_may_be(cell):
    found = spread_of(np.ones((9, 99), int), np.full((9, 99), 99), np.full((9, 99), 999), cell)
    assert found.mean == found.high_95 == 10.0
    assert ForwardModelConfig(sigma=found.mean).sigma == 10.0


@pytest.mark.parametrize('cells', [0.25, 0.9, 1.05, 1.5, 3.9])
def test_share_and_sigma_are_inverse(cells):
    assert float(_cells(np.array(_share(cells)))) == pytest.approx(cells)


@pytest.mark.parametrize('cells', [0.3, 0.6, 1.0, 2.0])
def test_sigma_of_a_wall_that_the_sampler_itself_would_draw(cells):
    """Beams across rows of cells, a wall of whole cells, readings off its first cell's middle.

    One dimension has lower shares than all angles together, and sigma comes out smaller.
    """
    rng = np.random.default_rng(3)
    index = np.floor(20.5 + rng.normal(0.0, cells, (200, 40))).astype(int)
    hits = np.stack([np.bincount(row, minlength=60) for row in index])
    misses = 40 - np.cumsum(hits, axis=1)
    found = spread_of(hits, misses, np.full(hits.shape, 40), CELL)
    assert 0.6 * cells < found.mean / CELL < 1.25 * cells


def scans_of(noise_m, count=300):
    """Scans of three beams at a wall 2 m away, from places that differ."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        x, y = rng.uniform(0.0, 0.05), rng.uniform(0.0, 2.0)
        ranges = (2.02 - x + rng.normal(0.0, noise_m, 1)).tolist()
        yield PlacedScan.at(fan(*ranges, range_max_m=5.0), Pose2D(x, y))


@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
def test_a_sigma_of_zero_is_found_and_a_number_holds(kind):
    config = SamplerConfig(NodeModelConfig(kind), WindowConfig(CELL), ChainConfig())
    (sharp, found), (blurred, _) = (
        fit_sensor(list(scans_of(noise_m)), config) for noise_m in (0.005, 0.08)
    )
    assert (found.clutter, found.missing) == (None, None)
    assert isinstance(found.sigma, Spread)
    assert sharp.sigma == found.sigma.mean < 0.02 < 0.05 < blurred.sigma
    assert sharp.clutter == config.model.clutter
    assert found.as_dict()['sigma']['mean'] == sharp.sigma
    fixed = SamplerConfig(
        NodeModelConfig(kind, 0.03), WindowConfig(CELL), ChainConfig(sensor='fitted')
    )
    model, found = fit_sensor(list(scans_of(0.005)), fixed)
    assert model.sigma == 0.03
    assert found is None or found.sigma is None


def test_a_wide_sigma_makes_readings_further_off_confirm_each_other():
    scans, chain = list(scans_of(0.16)), ChainConfig(sensor='fitted')
    fitted, default = (
        fit_sensor(scans, SamplerConfig(model, WindowConfig(CELL), chain))
        for model in (NodeModelConfig(), ForwardModelConfig())
    )
    assert fitted[0].sigma > 1.5 * DEFAULT == 1.5 * default[0].sigma
    assert fitted[1].clutter.mean < default[1].clutter.mean


def test_readings_are_of_their_own_cell_up_to_half_a_cell():
    found = [blur_of(cells * 0.1, 0.1) for cells in (0.1, 0.5, 0.6, 0.7, 3.0)]
    assert found == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])
    share, beams = (lattice_map([[value, math.nan]]) for value in (0.5, 15.0))
    some = Reflections(share, beams)
    assert some.least(0.0).probability[0, 0] == pytest.approx(0.5 * 15 / (15 + DOUBTED_SHARP))
    assert some.least(1.0).probability[0, 0] == pytest.approx(0.5 * 15 / (15 + DOUBTED))
    assert math.isnan(some.least(0.5).probability[0, 1])
