"""Expected information of many views: by hand, and against the beam-by-beam answer."""

import math

import numpy as np
import pytest

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import (
    ReadingChannel,
    expected_information_gain,
    first_hits,
    hits_of_map,
    hits_of_samples,
)
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D, SampleBits
from ogm_mcmc.sensors.forward_model import ForwardModel

SPEC = GridSpec(0.5, 8, 3, anchor_x_m=1.0)
MIDDLE = np.array([[1.25, 0.75]])  # of the first cell of the middle row
MODEL = ForwardModel.from_config(ForwardModelConfig(sigma=0.02, clutter=1e-6, missing=1e-6))
CHANNEL = ReadingChannel.of_model(MODEL, 4.0, 0.5)


def corridor(*probabilities):
    values = np.zeros((3, 8), np.float32)
    values[1, : len(probabilities)] = probabilities
    return GridMap(SPEC, values)


def told(grid_map):
    return CHANNEL.information(hits_of_map(grid_map, MIDDLE, [0.0], CHANNEL, 0.0))[0]


def test_what_is_known_tells_nothing():
    assert told(corridor(0.0, 0.0, 0.0, 1.0, 0.5)) == pytest.approx(0.0, abs=1e-4)
    assert told(corridor()) == pytest.approx(0.0, abs=1e-4)


def test_a_cell_that_may_be_or_not_tells_its_entropy():
    """A cell of 0.5 tells ln 2, and behind a wall nothing; p and 1 - p are told apart as well."""
    assert told(corridor(0.0, 0.0, 0.5)) == pytest.approx(math.log(2.0), abs=1e-3)
    p = 0.2
    entropy = -p * math.log(p) - (1 - p) * math.log(1 - p)
    assert told(corridor(0.0, 0.0, p, 1.0)) == pytest.approx(entropy, abs=1e-3)


def test_noise_takes_away_what_it_blurs():
    blurred = ReadingChannel.of_model(MODEL._replace(sigma_m=1.0), 4.0, 0.5)
    hits = hits_of_map(corridor(0.0, 0.0, 0.5, 1.0), MIDDLE, [0.0], blurred, 0.0)
    sharp, soft = CHANNEL.information(hits)[0], blurred.information(hits)[0]
    assert 0.0 < soft < 0.1 * sharp


@pytest.fixture(scope='module')
def random_map():
    rng = np.random.default_rng(1)
    values = (rng.random((20, 30)) ** 4).astype(np.float32)
    values[rng.random((20, 30)) < 0.2] = np.nan
    return GridMap(GridSpec(0.2, 30, 20), values)


def test_hits_are_those_of_the_judge_of_beams(random_map):
    places, headings = np.array([[3.1, 2.3], [0.7, 3.9]]), np.array([0.1, 1.7, -2.5])
    channel = ReadingChannel.of_model(MODEL, 3.0, 0.2)
    hits = hits_of_map(random_map, places, headings, channel, 0.3)
    assert hits.sum(axis=1) == pytest.approx(1.0)
    for view, (x, y) in enumerate(places):
        slow = first_hits(random_map, Pose2D(x, y, 0.0), headings, 3.0, prior=0.3)
        for beam in range(3):
            part = slice(slow.starts[beam], slow.starts[beam + 1])
            bins = (slow.distances_m[part] / 0.2).astype(int)
            expected = np.bincount(bins, slow.masses[part], channel.noise_nats.size - 1)
            row = hits[3 * view + beam]
            assert row[:-1] == pytest.approx(expected, abs=1e-8)
            assert row[-1] == pytest.approx(slow.survival[beam], abs=1e-8)


def test_information_is_that_of_the_slow_way_where_beams_end_in_the_middle():
    """Along a row from the middle of a cell, with steps of a cell, both take the same bins."""
    grid_map = corridor(0.0, 0.2, 0.1, 0.6, 0.0, 0.3)
    model = ForwardModel.from_config(ForwardModelConfig(sigma=0.4, clutter=0.05, missing=0.1))
    # Cells are met at 0.25, 0.5, 1.0, ... from a middle: from where a cell begins, at middles.
    place = Pose2D(1.0, 0.75, 0.0)
    slow = expected_information_gain(grid_map, place, [0.0], 4.0, model, z_step_m=0.5, prior=0.0)
    channel = ReadingChannel.of_model(model, 4.0, 0.5)
    hits = hits_of_map(grid_map, np.array([[1.0, 0.75]]), [0.0], channel, 0.0)
    assert channel.information(hits) == pytest.approx(slow, rel=1e-9)


def test_samples_of_independent_cells_and_of_one_wall():
    """A wall of two cells that is there or not tells one bit; independent cells tell more."""
    maps = np.zeros((2, 3, 8), np.uint8)
    maps[1, 1, 3:5] = 1
    bits = SampleBits.of_maps(SPEC, maps, np.ones((3, 8), np.bool_))
    of_samples = hits_of_samples(bits, MIDDLE, [0.0], CHANNEL, 0.0)
    assert CHANNEL.information(of_samples)[0] == pytest.approx(math.log(2.0), abs=1e-3)
    of_mean = hits_of_map(corridor(0, 0, 0, 0.5, 0.5), MIDDLE, [0.0], CHANNEL, 0.0)
    assert CHANNEL.information(of_mean)[0] == pytest.approx(1.5 * math.log(2.0), abs=2e-3)


def test_samples_where_nothing_was_sampled_are_a_map_of_the_prior(random_map):
    known = np.zeros((20, 30), np.bool_)
    bits = SampleBits(random_map.spec, np.zeros((20, 30, 1), np.uint64), known, 5)
    nothing = GridMap(random_map.spec, np.full((20, 30), np.nan, np.float32))
    channel = ReadingChannel.of_model(MODEL, 3.0, 0.2)
    views = np.array([[3.1, 2.3]]), np.array([0.1, 1.7])
    assert hits_of_samples(bits, *views, channel, 0.1) == pytest.approx(
        hits_of_map(nothing, *views, channel, 0.1)
    )
    with pytest.raises(ConfigError, match='0 map samples'):
        hits_of_samples(bits._replace(draws=0), *views, channel, 0.1)
