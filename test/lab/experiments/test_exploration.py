"""Exploring by expected information: what is worth going for, and how robots are compared."""

import numpy as np
import pytest

from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.lab.experiments import exploration
from ogm_mcmc.lab.experiments.exploration_views import (
    LIVE,
    MEAN,
    POLICIES,
    SAMPLES,
    Explorer,
)
from ogm_mcmc.simulation import GridWorld, Lidar

LIDAR = Lidar(180, range_min_m=0.0, range_max_m=7.5, noise_m=0.01, dropout=0.0)


@pytest.fixture(scope='module')
def rooms():
    """Two rooms of 3 m x 3 m beside each other without a door."""
    occupied = np.zeros((32, 63), np.uint8)
    occupied[[0, -1]] = occupied[:, [0, 31, -1]] = 1
    return GridWorld(GridSpec(0.1, 63, 32), occupied)


def in_the_first_room(world, policy):
    """Return a robot that has measured the room on the left well."""
    explorer = Explorer(policy, world.spec, exploration.MODEL, 7.5, np.random.default_rng(1), 1)
    rng = np.random.default_rng(2)
    for x, y in ((1.0, 1.0), (2.0, 2.0), (1.0, 2.0), (2.0, 1.0)) * 2:
        pose = Pose2D(x, y, 0.0)
        exact = world.ranges(pose, LIDAR.bearings(), 7.5)
        explorer.take(PlacedScan.at(LIDAR.scan(LIDAR.observe(exact, rng), 0), pose))
    return explorer


@pytest.mark.parametrize('policy', [LIVE, SAMPLES])
def test_a_room_that_is_known_tells_little(rooms, policy):
    explorer = in_the_first_room(rooms, policy)
    known, unknown = explorer.information(np.array([[1.5, 1.5], [4.7, 1.5]]))
    assert 0.0 <= known < 0.2 * unknown


def test_behind_walls_nothing_is_known_to_any_map(rooms):
    """What chains draw there is the prior, and would hide all that may be seen from there."""
    behind = np.array([[3.4, 1.5], [4.7, 1.5]])
    found = {
        policy: in_the_first_room(rooms, policy).information(behind)
        for policy in (LIVE, MEAN, SAMPLES)
    }
    assert found[MEAN] == pytest.approx(found[LIVE], rel=0.1)
    assert found[SAMPLES] == pytest.approx(found[LIVE], rel=0.1)


def test_it_goes_where_most_is_told_for_the_way(rooms):
    explorer = in_the_first_room(rooms, LIVE)
    distances = np.full((32, 63), -1, np.int32)
    assert explorer.choose(distances) is None
    distances[15, 10], distances[15, 50] = 5, 40
    assert explorer.choose(distances) == (50, 15)
    distances[15, 50] = 100_000
    assert explorer.choose(distances) == (10, 15)


def test_differences_are_paired():
    runs = {
        policy: [
            {
                'area_m2': [base + k] * 4,
                'seen_m2': [base] * 4,
                'f1': [0.5] * 4,
                'border_f1': 0.5,
                'stops': 3,
            }
            for base in (10.0, 10.0, 30.0, 30.0)
        ]
        for k, policy in enumerate(POLICIES)
    }
    rows = {line['what']: line for line in exploration.rows_of(runs, [1, 1, 2, 2])}
    line = rows['area covered, m2 after 10 m: mean of maps']
    assert line['ours'] == pytest.approx(22.0)
    # Buildings are 20 apart: a standard error of 10, however many runs in each, and none of the
    # difference.
    assert line['remark'] == '+- 10; +1 +- 0 to traditional map'
    table = exploration.table_of(runs, [1, 1, 2, 2]).splitlines()
    assert len(table) == 2 + len(POLICIES) + 6
    level = '20 +- 10 | 20 +- 10 | 20 +- 10 | 20 +- 10 | 22 +- 10 | 0.500 +- 0.000 | 3 +- 0 |'
    assert f'| mean of maps | {level}' in table
    paired = '+0 +- 0 | +0 +- 0 | +0 +- 0 | +0 +- 0 | +1 +- 0 | +0.000 +- 0.000 | +0 +- 0 |'
    assert f'| mean of maps less traditional map, paired | {paired}' in table


@pytest.mark.slow
def test_a_robot_that_covers_more_the_further_it_goes(monkeypatch):
    monkeypatch.setattr(exploration, 'METRES', (4.0, 8.0))
    found = exploration.score(10, 1, SAMPLES, 1)
    assert found == exploration.score(10, 1, SAMPLES, 1)
    assert 0.0 < found['area_m2'][0] <= found['area_m2'][1]
    assert 0.0 < found['seen_m2'][0] <= found['seen_m2'][1]
    assert found['driven_m'] <= 8.0
    assert found['stops'] >= 2


def test_space_seen_grows_with_rooms_not_with_scans(rooms):
    """Whoever stands in the first room sees its 30 x 30 free cells, however often."""
    empty = LIDAR.scan(LIDAR.observe(np.full(180, 7.5), np.random.default_rng(1)), 0)
    once = [PlacedScan.at(empty, Pose2D(1.5, 1.5, 0.0))]
    assert exploration._seen_m2(once, rooms) == pytest.approx(9.0)
    assert exploration._seen_m2(once * 3, rooms) == pytest.approx(9.0)
    there = PlacedScan.at(empty, Pose2D(4.7, 1.5, 0.0))
    assert exploration._seen_m2([*once, there], rooms) == pytest.approx(18.0)


def test_f1_takes_what_was_never_measured_as_free(rooms):
    """Half of the walls of all: recall one half, precision one, F1 two thirds."""
    walls = np.argwhere((rooms.occupied == 1) & rooms.observable())
    probability = np.full(rooms.occupied.shape, np.nan, np.float32)
    probability[tuple(walls[::2].T)] = 0.9
    found = exploration._f1(GridMap(rooms.spec, probability), rooms)
    share = len(walls[::2]) / len(walls)
    assert found == pytest.approx(2.0 * share / (1.0 + share))
