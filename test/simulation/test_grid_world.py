"""Beams in a grid: on paper, and against the exact traversal in fractions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.naive import corner_margin, crossed_cells
from support.pictures import read
from support.strategies import REPEATABLE

from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.simulation import GridWorld
from ogm_mcmc.simulation.raster_kernels import first_occupied


def world(picture, resolution=1.0):
    cells = read(picture) == 1
    return GridWorld.checked(GridSpec(resolution, cells.shape[1], cells.shape[0]), cells)


ROOM = world("""
    #####
    #...#
    #..##
    #...#
    #####
""")


@pytest.mark.parametrize(
    ('bearing', 'entry', 'middle'),
    [
        (0.0, 2.5, 3.0),
        (math.pi / 2, 2.5, 3.0),
        (math.pi, 0.5, 1.0),
        # Meets x = 3 at y = 2.25: the pillar is entered there and left at its right side.
        (math.atan2(1, 2), 1.5 * math.hypot(1, 0.5), 2.0 * math.hypot(1, 0.5)),
    ],
)
def test_ranges_on_paper(bearing, entry, middle):
    here = Pose2D(1.5, 1.5)
    assert ROOM.ranges(here, np.array([bearing]), 9.0, 0.0)[0] == pytest.approx(entry)
    assert ROOM.ranges(here, np.array([bearing]), 9.0)[0] == pytest.approx(middle)
    # Turning the robot is the same as turning the beam; a finer world is a smaller one.
    turned = ROOM.ranges(Pose2D(1.5, 1.5, bearing), np.zeros(1), 9.0, 0.0)
    assert turned[0] == pytest.approx(entry)
    fine = GridWorld(GridSpec(0.1, 5, 5, column0=3, row0=-2), ROOM.occupied)
    ranges = fine.ranges(Pose2D(0.45, -0.05), np.array([bearing]), 9.0, 0.0)
    assert ranges[0] == pytest.approx(0.1 * entry)


@pytest.mark.parametrize(
    ('towards', 'hit'),
    [((1, 1), (2, 2)), ((-1, 1), (1, 2)), ((-1, -1), (0, 0)), ((1, -1), (2, 1))],
)
def test_corners_belong_to_the_cell_up_and_right_of_them(towards, hit):
    """From the middle of 3 x 3 exactly through a corner: only the given cell is in the way."""
    direction = np.array([[float(towards[0])], [float(towards[1])]]) / math.sqrt(2)
    for column, row in [(c, r) for c in range(3) for r in range(3) if (c, r) != (1, 1)]:
        occupied = np.zeros((3, 3), np.uint8)
        occupied[row, column] = 1
        entered, left = np.empty(1), np.empty(1)
        first_occupied(occupied, 1.5, 1.5, direction, 9.0, entered, left)
        beyond = (1 + towards[0], 1 + towards[1])
        met = (column, row) in (hit, beyond)
        assert np.isfinite(entered[0]) == met
        if met:
            assert entered[0] == pytest.approx(math.sqrt(0.5))


def test_nothing_within_reach_or_outside():
    east = np.zeros(1)
    assert np.isinf(ROOM.ranges(Pose2D(1.5, 1.5), east, 2.4, 0.0))
    assert ROOM.ranges(Pose2D(1.5, 1.5), east, 2.5, 0.0)[0] == 2.5
    open_field = world('...')
    assert np.isinf(open_field.ranges(Pose2D(0.5, 0.5), np.arange(6.0), 99.0)).all()
    with pytest.raises(ConfigError, match='inside of the world'):
        ROOM.ranges(Pose2D(-0.1, 1.0), east, 5.0)
    with pytest.raises(ConfigError, match='depth'):
        ROOM.ranges(Pose2D(1.5, 1.5), east, 5.0, 1.5)


@REPEATABLE
@given(
    seed=st.integers(0, 10_000),
    x=st.floats(0.0, 11.99),
    y=st.floats(0.0, 11.99),
    yaw=st.floats(-math.pi, math.pi),
    density=st.sampled_from([0.02, 0.1, 0.5]),
)
def test_the_first_occupied_cell_is_the_first_on_the_exact_way(seed, x, y, yaw, density):
    occupied = np.random.default_rng(seed).random((12, 12)) < density
    grid = GridWorld.checked(GridSpec(1.0, 12, 12), occupied)
    here = Pose2D(x, y, yaw)
    reach = 30.0
    entry = grid.ranges(here, np.zeros(1), reach, 0.0)[0]
    end = (x + reach * math.cos(yaw), y + reach * math.sin(yaw))
    if corner_margin(x, y, *end) < 1e-9:
        return
    inside = [c for c in crossed_cells(x, y, *end) if 0 <= c[0] < 12 and 0 <= c[1] < 12]
    first = next((cell for cell in inside if occupied[cell[1], cell[0]]), None)
    if first is None:
        assert np.isinf(entry)
        return
    middle = grid.ranges(here, np.zeros(1), reach)[0]
    # Halfway through a cell the point is inside of it; where it is entered, on its border.
    at = (x + middle * math.cos(yaw), y + middle * math.sin(yaw))
    assert first[0] - 1e-9 <= at[0] <= first[0] + 1 + 1e-9
    assert first[1] - 1e-9 <= at[1] <= first[1] + 1 + 1e-9
    assert entry <= middle
    on = (x + entry * math.cos(yaw), y + entry * math.sin(yaw))
    gaps = [abs(on[k] - first[k] - side) for k in (0, 1) for side in (0, 1)]
    assert entry == 0.0 or min(gaps) < 1e-9


@pytest.mark.data
def test_recorded_scene(data_folder):
    """18 000 exact ranges that others computed, to where a beam enters the first cell."""
    with np.load(data_folder / 'bench' / 'scene.npz') as data:
        grid = GridWorld.checked(GridSpec(1.0, 500, 500), data['m'])
        poses, angles, true, limit = data['poses'], data['ang'], data['true'], float(data['F'])
    got = np.array([grid.ranges(Pose2D(*pose), angles, limit, 0.0) for pose in poses])
    assert np.minimum(got, limit) == pytest.approx(np.minimum(true, limit), abs=1e-9)


def test_made_of_a_map():
    grid_map = GridMap(GridSpec(0.5, 3, 1), np.array([[0.0, 0.7, np.nan]], np.float32))
    assert GridWorld.from_map(grid_map).occupied.tolist() == [[0, 1, 1]]
    free = GridWorld.from_map(grid_map, unknown_occupied=False)
    assert free.occupied.tolist() == [[0, 1, 0]]
    assert free.truth().probability.tolist() == [[0.0, 1.0, 0.0]]
    with pytest.raises(GridError, match='expected'):
        GridWorld.checked(GridSpec(1.0, 2, 2), np.zeros((3, 2)))


def test_what_can_be_observed():
    thick = world("""
        #####
        #####
        ##.##
        #####
        #####
    """)
    expected = read("""
        .....
        .###.
        .###.
        .###.
        .....
    """)
    assert np.array_equal(thick.observable(), expected == 1)
