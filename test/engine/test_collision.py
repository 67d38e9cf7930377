"""Ways and maps drawn from the posterior: exact small cases, a slow twin, the time it takes."""

import time

import numpy as np
import pytest
from support.naive_collision import risk_by_cells

from ogm_mcmc.engine.collision import BEHIND, LUMP_M2, chance_of_unknown, collision_risk
from ogm_mcmc.engine.collision_kernels import add_blocked
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.evaluation import reliability
from ogm_mcmc.geometry import GridSpec, SampleBits

SPEC = GridSpec(1.0, 7, 3)
KNOWN = np.ones((3, 7), bool)


def bits(*maps, known=KNOWN):
    cells = np.array([[list(map(int, row)) for row in reversed(rows)] for rows in maps], np.uint8)
    return SampleBits.of_maps(SPEC, cells, known)


CLEAR = ('0000000', '0000000', '0000000')
DOOR = ('0001000', '0001000', '0001000')
POST = ('0000000', '0000000', '0000010')


def test_share_of_maps_in_which_something_is_met():
    samples = bits(CLEAR, DOOR, POST, CLEAR)
    along = [(1.5, 1.5), (2.5, 1.5), (5.5, 1.5)]
    # Thin: the door is between the last two places, the post a row below.
    assert collision_risk(samples, along, 0.2, 0.5).tolist() == [0.0, 0.0, 0.0, 0.25]
    # Wide: at the second place it meets the door, at the third the post.
    assert collision_risk(samples, along, 0.7, 0.5).tolist() == [0.0, 0.25, 0.25, 0.5]
    # On the post's cell, with a disc of no width.
    assert collision_risk(samples, [(5.5, 0.5)], 0.0, 0.5).tolist() == [0.25, 0.25]


def test_a_wall_is_one_chance_and_the_product_of_its_cells_is_not():
    samples = bits(CLEAR, DOOR)
    way = [(3.5, 0.5), (3.5, 2.5)]
    assert collision_risk(samples, way, 0.3, 0.5)[-1] == 0.5
    cells = samples.words[:, 3, 0]
    assert 1.0 - np.prod(np.where(cells == 2, 0.5, 1.0)) == 0.875


def test_calibrated_on_simulated_truth_where_the_product_of_cells_is_not():
    """A wall right across a corridor, measured with an error of two cells.

    The posterior of its column is known exactly, so that the samples are the posterior's own.
    """
    rng = np.random.default_rng(3)
    spec, columns = GridSpec(1.0, 30, 5), np.arange(30)
    known, answers = np.ones((5, 30), bool), []
    for _ in range(3000):
        wall = rng.integers(30)
        reading = wall + rng.normal(0.0, 2.0)
        posterior = np.exp(-0.125 * (columns - reading) ** 2)
        posterior /= posterior.sum()
        drawn = rng.choice(30, 64, p=posterior)
        row = np.zeros(30, np.uint64)
        np.bitwise_or.at(row, drawn, np.uint64(1) << np.arange(64, dtype=np.uint64))
        samples = SampleBits(spec, np.tile(row, (5, 1))[:, :, None], known, 64)
        end = np.clip(reading + rng.uniform(-4.0, 4.0), 0.0, 30.0)
        risk = collision_risk(samples, [(0.0, 2.5), (end, 2.5)], 1.3, 0.0)[-1]
        # Rows 1 to 3 are met; in the middle one as far as the disc reaches, beside less far.
        there = np.zeros((5, 30), bool)
        for j, gap in ((1, 0.5), (2, 0.0), (3, 0.5)):
            there[j] = columns <= end + np.sqrt(1.3**2 - gap**2)
        product = 1.0 - np.prod((1.0 - np.tile(posterior, (5, 1)))[there])
        answers.append((risk, product, there[:, wall].any()))
    risk, product, blocked = np.array(answers).T
    error = {
        name: reliability(values, blocked > 0.5).expected_error()
        for name, values in (('samples', risk), ('product', product))
    }
    print(error)
    assert error['samples'] <= 0.03
    assert error['product'] > 0.1


def test_the_more_is_unknown_the_likelier_it_blocks():
    known = KNOWN.copy()
    known[:, 4:] = False
    samples = bits(CLEAR, DOOR, known=known)
    lump = LUMP_M2  # cells of 1 m2

    def blocked(cells):
        return pytest.approx(1.0 - 0.8 ** (cells / lump))

    risk = collision_risk(samples, [(1.5, 1.5), (5.5, 1.5), (50.5, 1.5)], 0.4, 0.2)
    # One cell under the disc; 47 on the way, known ones not counted.
    behind = 0.5 * (0.8 ** (1 / lump) - (1.0 - BEHIND) ** (1 / lump))
    assert risk[:3].tolist() == [0.0, *[pytest.approx(blocked(1).expected + behind)] * 2]
    # Whatever lies behind, a door that is there blocks the way.
    assert risk[3] == pytest.approx(0.5 + 0.5 * (1.0 - 0.8 ** (47 / lump)))
    assert collision_risk(samples, [(1.5, 0.3)], 0.4, 0.2)[0] == blocked(1)
    # Standing still adds nothing, and many places along a way count no cell twice.
    still = collision_risk(samples, [(5.5, 1.5)] * 3, 0.4, 0.2)
    assert still[-1] == blocked(1)
    steps = np.column_stack((np.linspace(1.5, 50.5, 491), np.full(491, 1.5)))
    assert collision_risk(samples, steps, 0.4, 0.2)[-1] == pytest.approx(risk[3])


def test_behind_what_blocks_the_way_unknown_space_is_more_often_solid():
    known = KNOWN.copy()
    known[:, 5:] = False
    samples = bits(CLEAR, DOOR, known=known)
    way, chances = [(1.5, 1.5), (5.5, 1.5)], 1 / LUMP_M2  # one cell of 1 m2 under the disc
    free, solid = 0.8**chances, (1.0 - BEHIND) ** chances
    risk = collision_risk(samples, way, 0.4, 0.2)
    # Half of the samples have a door on the way: it blocks the way, and tells of the place.
    assert risk[1] == pytest.approx(1.0 - 0.5 * (free + solid))
    assert risk[2] == pytest.approx(1.0 - 0.5 * free)
    # Without a way nothing lies before it, and a greater chance stays one.
    assert collision_risk(samples, way[1:], 0.4, 0.2)[0] == pytest.approx(1.0 - free)
    assert collision_risk(samples, way, 0.4, 0.9)[1] == pytest.approx(1.0 - 0.1**chances)


def test_known_space_tells_how_built_up_the_unknown_is():
    """Tiles of 2 x 2 cells: of four that are known two are empty, one is a wall in 1 of 4 maps."""
    spec, known = GridSpec(0.4, 6, 4), np.ones((4, 6), bool)
    known[:, 4:] = False
    known[2, 0] = False  # three of four cells are known: a tile; two would not do
    known[0, 4:] = True
    maps = np.zeros((4, 4, 6), np.uint8)
    maps[0, 0, 0], maps[:, 3, 3], maps[:, 2, 5] = 1, 1, 1
    samples = SampleBits.of_maps(spec, maps, known)
    share = (1 / 4 + 1 + 0.3) / (4 + 1)
    assert chance_of_unknown(samples, 0.3) == pytest.approx(np.sqrt(share * 0.3))
    nothing = SampleBits.of_maps(spec, maps, np.zeros_like(known))
    assert chance_of_unknown(nothing, 0.3) == pytest.approx(0.3)


def test_far_outside_of_the_map_is_answered_at_once():
    """At once: of 2e12 cells on the way no more than some thousand are looked at."""
    samples = bits(CLEAR)
    above, below = (0.5, 1e12 + 0.5), (0.5, -1e12 + 0.5)  # in the middle of a cell
    risk = collision_risk(samples, [above, below], 0.4, 0.2)
    assert risk[:2] == pytest.approx(1.0 - 0.8 ** (1 / LUMP_M2), abs=1e-12)
    assert risk[2] == pytest.approx(1.0)
    blocked = np.zeros(1, np.uint64)
    unknown, cells = add_blocked(samples.words, samples.known, *above, *below, 0.4, blocked)
    assert (unknown, blocked[0]) == (cells - 3, 0)  # all of column 0 of the map was seen
    assert 1000 < cells < 10_000
    assert collision_risk(samples, [(0.5, -9.5)], 0.4, 1.0).tolist() == [1.0, 1.0]
    assert collision_risk(samples, [(0.5, 0.5), (1e15, -1e15)], 0.4, 0.2)[2] == pytest.approx(1.0)


@pytest.mark.parametrize('seed', range(4))
def test_slow_twin(seed):
    """Random maps and ways, some off the map; 70 samples need two words."""
    rng = np.random.default_rng(seed)
    spec = GridSpec(0.25, 9, 7, column0=-5, row0=3)
    maps = (rng.random((70, 7, 9)) < 0.05).astype(np.uint8)
    known = rng.random((7, 9)) < 0.95
    places = rng.uniform((-2, -2), (11, 9), (4, 2))
    places[2, seed % 2] = places[1, seed % 2]  # a piece along an axis
    radius = (0.0, 0.3, 1.1, 2.4)[seed]
    points = places * 0.25 + (spec.origin_x_m, spec.origin_y_m)
    found = collision_risk(SampleBits.of_maps(spec, maps, known), points, radius * 0.25, 0.3)
    way = [tuple(place) for place in places]
    expected = risk_by_cells(maps, known, way, radius, 0.3, BEHIND, LUMP_M2 / 0.25**2)
    assert found == pytest.approx(expected, abs=1e-12)
    assert found[-1] >= found[:-1].max()


@pytest.mark.jit
def test_hundred_poses_and_64_samples_are_asked_in_time():
    """5 ms is the promise; the least of several is what the machine does when it is free."""
    rng = np.random.default_rng(1)
    spec = GridSpec(0.05, 800, 800)
    maps = (rng.random((64, 800, 800)) < 0.01).astype(np.uint8)
    samples = SampleBits.of_maps(spec, maps, np.ones((800, 800), bool))
    places = 20.0 + np.cumsum(rng.normal(0.0, 0.2, (100, 2)), axis=0)
    collision_risk(samples, places, 0.3, 0.5)
    seconds = []
    for _ in range(10):
        began = time.process_time()
        collision_risk(samples, places, 0.3, 0.5)
        seconds.append(time.process_time() - began)
    print(f'100 poses, 64 samples: {1e3 * min(seconds):.3f} ms')
    assert min(seconds) < 5e-3


@pytest.mark.parametrize(
    ('places', 'radius', 'error', 'text'),
    [
        ([], 0.2, PoseError, r'shape \(0,\): expected \(N, 2\)'),
        ([(1.0, np.nan)], 0.2, PoseError, 'not finite'),
        ([(1.0, 1.0), (1e19, 1.0)], 0.2, PoseError, r'place 2 of the way is \(1e\+19, 1\)'),
        ([(1.0, -1.1e15)], 0.2, PoseError, r'up to 1e\+15 from the map'),
        ([(1.0, 1.0)], -0.1, ConfigError, 'robot_radius is -0.1'),
        ([(1.0, 1.0)], 1e200, ConfigError, r'robot_radius is 1e\+200'),
    ],
)
def test_bad_questions_are_named(places, radius, error, text):
    with pytest.raises(error, match=text):
        collision_risk(bits(CLEAR), places, radius, 0.5)


def test_without_samples():
    with pytest.raises(ConfigError, match='no map sample'):
        SampleBits.of_maps(SPEC, np.zeros((0, 3, 7), np.uint8), KNOWN)
