"""The exploring robot: covers everything, touches nothing, goes the same way for one seed."""

import itertools

import numpy as np
import pytest
from scipy import ndimage
from support.pictures import read

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.simulation import (
    Exploration,
    GridWorld,
    Lidar,
    explore,
    generate_floor,
    record_exploration,
)
from ogm_mcmc.simulation.raster_kernels import keep_clear, look_around, walk_distances

TWO_ROOMS = """
    ####################
    #........#.........#
    #........#.........#
    #..................#
    #..................#
    #..................#
    #........#.........#
    #........#.........#
    ####################
"""


def world_of(picture):
    cells = read(picture) == 1
    return GridWorld.checked(GridSpec(0.5, cells.shape[1], cells.shape[0]), cells)


def seen_from(world, stops, reach):
    known = np.zeros(world.occupied.shape, np.uint8)
    angles = np.linspace(0.0, 2.0 * np.pi, 1000)
    directions = np.stack((np.cos(angles), np.sin(angles)))
    for stop in stops:
        x, y = world.cell_position(stop.pose)
        look_around(world.occupied, x, y, directions, reach, known)
    return known


def test_two_rooms_are_both_seen():
    world = world_of(TWO_ROOMS)
    settings = Exploration(reach=6.0, radius=1.0, smallest=1)
    stops = list(explore(world, settings, np.random.default_rng(0), start=(2, 4)))
    known = seen_from(world, stops, 6.0)
    assert (known[world.occupied == 0] == 1).mean() > 0.95
    assert len(stops) < 20


@pytest.mark.jit
@pytest.mark.parametrize('number', [2, 5, 10])
def test_a_building_is_covered(number):
    world, settings = generate_floor(number), Exploration()
    stops = list(explore(world, settings, np.random.default_rng(number)))
    known = seen_from(world, stops, settings.reach)
    assert (known[world.occupied == 0] == 1).mean() > 0.98
    assert len(stops) < 400
    gap = ndimage.distance_transform_edt(world.occupied == 0)
    for before, stop in itertools.pairwise(stops):
        # The way leads from one stop to the next, step by step, with room for the robot.
        assert tuple(stop.way[0]) == tuple(before.way[-1])
        assert (abs(np.diff(stop.way, axis=0)).sum(axis=1) == 1).all()
        assert gap[stop.way[:, 1], stop.way[:, 0]].min() > settings.radius
        x, y = world.cell_position(stop.pose)
        assert (int(x), int(y)) == tuple(stop.way[-1])


def test_limits_and_going_on():
    world = world_of(TWO_ROOMS)
    few = Exploration(reach=6.0, radius=1.0, smallest=1, max_stops=2)
    assert len(list(explore(world, few, np.random.default_rng(0)))) == 2
    many = Exploration(reach=6.0, radius=1.0, min_stops=40, max_stops=60)
    assert len(list(explore(world, many, np.random.default_rng(0)))) == 40


def test_what_cannot_be_explored():
    rng = np.random.default_rng(0)
    narrow = world_of('#####\n#...#\n#####')
    with pytest.raises(ConfigError, match='room for the robot'):
        next(explore(narrow, Exploration(radius=3.0), rng))
    with pytest.raises(ConfigError, match='expected a free cell'):
        next(explore(narrow, Exploration(), rng, start=(0, 0)))
    with pytest.raises(ConfigError, match='expected a cell of the world'):
        next(explore(narrow, Exploration(), rng, start=(9, 0)))
    for wrong in ({'reach': 0.0}, {'patience': 0.0}, {'min_stops': 5, 'max_stops': 4}):
        with pytest.raises(ConfigError):
            Exploration(**wrong)


@pytest.mark.jit
def test_recordings_are_seeded_and_the_noise_does_not_change_the_way():
    world = generate_floor(10)
    settings = Exploration(max_stops=12)

    def record(seed, noise_m):
        lidar = Lidar(beams=40, range_max_m=7.5, noise_m=noise_m, dropout=0.0)
        return list(record_exploration(world, lidar, settings, np.random.default_rng(seed)))

    one, same, other, exact = record(1, 0.3), record(1, 0.3), record(2, 0.3), record(1, 0.0)
    assert all(
        np.array_equal(a.scan.ranges_m, b.scan.ranges_m) for a, b in zip(one, same, strict=True)
    )
    assert [s.pose for s in one] == [s.pose for s in exact]
    assert [s.pose for s in one] != [s.pose for s in other]
    stamps = [s.scan.stamp_ns for s in one]
    assert all(later - earlier >= 1e9 for earlier, later in itertools.pairwise(stamps))
    noisy = np.concatenate([s.scan.ranges_m for s in one])
    true = np.concatenate([s.scan.ranges_m for s in exact])
    both = np.isfinite(noisy) & np.isfinite(true)
    assert (noisy[both] - true[both]).std() == pytest.approx(0.3, rel=0.15)


def test_clear_cells_and_distances_against_scipy():
    rng = np.random.default_rng(6)
    occupied = (rng.random((40, 60)) < 0.03).astype(np.uint8)
    blocked = np.empty_like(occupied)
    keep_clear(occupied, 2.5, blocked)
    gap = ndimage.distance_transform_edt(occupied == 0)
    assert np.array_equal(blocked == 1, gap <= 2.5)
    distances = np.empty(occupied.shape, np.int32)
    row, column = np.argwhere(blocked == 0)[0]
    reached = walk_distances(
        blocked == 0, int(column), int(row), distances, np.empty(occupied.size, np.int32)
    )
    labels, _ = ndimage.label(blocked == 0)
    assert np.array_equal(distances >= 0, labels == labels[row, column])
    assert reached == (distances >= 0).sum()
    # A distance is one more than that of the nearest neighbour.
    padded = np.pad(np.where(distances < 0, 10**6, distances), 1, constant_values=10**6)
    around = np.minimum.reduce(
        [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
    )
    away = distances > 0
    assert np.array_equal(distances[away], around[away] + 1)
