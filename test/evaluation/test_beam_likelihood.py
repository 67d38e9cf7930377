"""Held-out beams and information gain, against sums over every map there can be."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from support.naive import crossed_cells
from support.strategies import REPEATABLE, fan

from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.evaluation import (
    beam_log_likelihood,
    expected_information_gain,
    first_hits,
    log_likelihood_of_samples,
)
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D

SIGMA, REACH = 0.4, 3.0


def gaussian(z, f):
    """A Gaussian with 5 % that do not return; nothing hit: no return, or anywhere at all."""
    hit = np.log(0.95) + stats.norm.logpdf(z, np.where(np.isinf(f), 0.0, f), SIGMA)
    nothing = np.full(z.shape, math.log(0.2 / REACH))
    finite = np.where(np.isinf(f), nothing, hit)
    none = np.where(np.isinf(f), math.log(0.8), math.log(0.05))
    return np.where(np.isinf(z), none, finite)


def corridor(*probability, resolution=1.0):
    spec = GridSpec(resolution, len(probability), 1)
    return GridMap(spec, np.array([probability], np.float32))


def test_first_hits_on_paper():
    hits = first_hits(
        corridor(0.0, 0.5, 0.25, np.nan), Pose2D(0.5, 0.5), [0.0], 3.4, prior=0.8, depth=0.0
    )
    # The last cell is unknown; the one after it, entered at 3.5 m, is out of reach.
    assert hits.distances_m == pytest.approx([0.5, 1.5, 2.5])
    assert hits.masses == pytest.approx([0.5, 0.125, 0.375 * 0.8])
    assert hits.survival == pytest.approx([0.375 * 0.2])
    middle = first_hits(corridor(0.0, 0.5), Pose2D(0.5, 0.5), [0.0], 0.9)
    assert middle.distances_m == pytest.approx([1.0])


@REPEATABLE
@given(
    seed=st.integers(0, 10_000),
    yaw=st.floats(-math.pi, math.pi),
    x=st.floats(-1.0, 5.0),
    y=st.floats(-1.0, 5.0),
)
def test_first_hits_go_through_the_cells_that_the_ray_crosses(seed, yaw, x, y):
    """Masses are a product over the cells of the exact traversal; distances rise within it."""
    rng = np.random.default_rng(seed)
    probability = rng.random((4, 4)).astype(np.float32)
    grid_map = GridMap(GridSpec(1.0, 4, 4), probability)
    hits = first_hits(grid_map, Pose2D(x, y, yaw), [0.0], REACH, prior=0.3)
    dx, dy = math.cos(yaw), math.sin(yaw)
    cells = crossed_cells(x, y, x + REACH * dx, y + REACH * dy)
    left, expected = 1.0, []
    for column, row in cells:
        inside = 0 <= column < 4 and 0 <= row < 4
        p = float(probability[row, column]) if inside else 0.3
        expected.append(left * p)
        left *= 1.0 - p
    # Ends of rays and corners are a matter of rounding; these segments are not.
    if len(expected) == hits.masses.size and min(abs(dx), abs(dy)) > 1e-6:
        assert hits.masses == pytest.approx(expected)
        assert hits.survival[0] == pytest.approx(left)
        assert (np.diff(hits.distances_m) >= 0.0).all()
        for (column, row), distance in zip(cells, hits.distances_m, strict=True):
            assert column - 1e-9 <= x + distance * dx <= column + 1 + 1e-9
            assert row - 1e-9 <= y + distance * dy <= row + 1 + 1e-9
    else:
        assert abs(len(expected) - hits.masses.size) <= 1


def test_likelihood_is_the_sum_over_every_map():
    probability = [0.1, 0.6, 0.3, 0.8]
    z = np.array([0.7, 1.6, 2.9, np.inf])
    got = beam_log_likelihood(
        corridor(*probability),
        [PlacedScan.at(fan(*z, range_max_m=REACH), Pose2D(0.5, 0.5))],
        gaussian,
        depth=0.0,
    )
    expected = np.zeros(4)
    for cells in itertools.product((0, 1), repeat=4):
        weight = math.prod(
            p if cell else 1 - p for p, cell in zip(probability, cells, strict=True)
        )
        entries = [0.0, 0.5, 1.5, 2.5]
        f = next((at for at, cell in zip(entries, cells, strict=True) if cell), math.inf)
        expected += weight * np.exp(gaussian(z, np.full(4, f)))
    assert got == pytest.approx(np.log(expected), rel=1e-6)


def test_a_far_reading_does_not_underflow():
    """A Gaussian alone, a hundred sigma away: the answer is finite and right."""

    def narrow(z, f):
        return np.where(np.isinf(f), -np.inf, stats.norm.logpdf(z, f, 0.01))

    scan = fan(3.0, range_max_m=5.0)
    got = beam_log_likelihood(
        corridor(0.0, 1.0), [PlacedScan.at(scan, Pose2D(0.5, 0.5))], narrow, depth=0.0
    )
    assert got[0] == pytest.approx(stats.norm.logpdf(3.0, 0.5, 0.01))


def test_samples_know_what_their_mean_does_not():
    """A wall at 1.5 m or at 2.5 m: the mean of both also allows for none or for two."""
    one, other = corridor(0.0, 0.0, 1.0, 0.0), corridor(0.0, 0.0, 0.0, 1.0)
    mean = corridor(0.0, 0.0, 0.5, 0.5)
    placed = [PlacedScan.at(fan(1.6, 2.6, range_max_m=REACH), Pose2D(0.5, 0.5))]
    of_samples = log_likelihood_of_samples([one, other], placed, gaussian, depth=0.0)
    z = np.array([1.6, 2.6])
    expected = np.log(
        0.5 * np.exp(gaussian(z, np.full(2, 1.5))) + 0.5 * np.exp(gaussian(z, np.full(2, 2.5)))
    )
    assert of_samples == pytest.approx(expected)
    assert of_samples.mean() > beam_log_likelihood(mean, placed, gaussian, depth=0.0).mean()
    with pytest.raises(GridError, match='at least one'):
        log_likelihood_of_samples([], placed, gaussian)


def test_only_informative_beams_count():
    scan = fan(1.0, np.inf, np.nan, -np.inf, 0.0, 9.0, range_max_m=5.0)
    assert scan.informative().tolist() == [True, True, False, False, False, False]
    assert scan.informative(no_return_clears=False).sum() == 1
    here = [PlacedScan.at(scan, Pose2D(0.5, 0.5))]
    assert beam_log_likelihood(corridor(0.5), here, gaussian).size == 2
    assert beam_log_likelihood(corridor(0.5), [], gaussian).size == 0


def test_information_without_noise_is_the_entropy_of_the_first_hit():
    p = [0.2, 0.7]
    masses = [0.2, 0.8 * 0.7, 0.8 * 0.3]
    gain = expected_information_gain(corridor(*p), Pose2D(0.5, 0.5), [0.0], 1.4, prior=0.0)
    assert gain[0] == pytest.approx(stats.entropy(masses))


def test_information_is_the_expected_fall_of_entropy_over_every_map():
    """I(map; z) by enumeration of all maps of three cells; noise takes some of it away."""
    p, step = [0.2, 0.5, 0.7], 0.02
    grid_map = corridor(*p)
    here, reach = Pose2D(0.5, 0.5), 2.4
    gain = expected_information_gain(
        grid_map, here, [0.0], reach, gaussian, z_step_m=step, depth=0.0
    )
    readings = np.append(np.arange(0.5 * step, reach, step), np.inf)
    maps = list(itertools.product((0, 1), repeat=3))
    prior = np.array(
        [math.prod(q if c else 1 - q for q, c in zip(p, cells, strict=True)) for cells in maps]
    )
    given_map = []
    for cells in maps:
        f = next((at for at, c in zip((0.0, 0.5, 1.5), cells, strict=True) if c), math.inf)
        density = np.exp(gaussian(readings, np.full(readings.size, f)))
        density[:-1] *= step
        given_map.append(density / density.sum())
    joint = prior[:, None] * np.array(given_map)
    posterior = joint / joint.sum(axis=0)
    expected = stats.entropy(prior) - joint.sum(axis=0) @ stats.entropy(posterior)
    assert gain[0] == pytest.approx(expected, rel=1e-6)
    exact = expected_information_gain(grid_map, here, [0.0], reach)
    assert 0.0 < gain[0] < exact[0]
    known = expected_information_gain(corridor(0.0, 1.0), here, [0.0], reach, gaussian)
    assert known[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('x_m', [1e18, -1e18, 1e300])
def test_a_map_absurdly_far_away_is_refused(x_m):
    """Where a cell is less than the rounding of its place, no beam can meet it."""
    far = corridor(0.5, 0.5)._replace(spec=GridSpec(1.0, 2, 1, anchor_x_m=x_m))
    with pytest.raises(GridError, match='too far from the map'):
        beam_log_likelihood(far, [PlacedScan.at(fan(2.0), Pose2D(0.5, 0.5))], gaussian)


def test_what_makes_no_sense():
    for arguments in ({'prior': 2.0}, {'depth': -1.0}):
        with pytest.raises(ConfigError):
            first_hits(corridor(0.5), Pose2D(), [0.0], 1.0, **arguments)
    with pytest.raises(ConfigError, match='reach'):
        first_hits(corridor(0.5), Pose2D(), [0.0], math.inf)
