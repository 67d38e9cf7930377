"""The nearest point in a cone: on paper, against shapes cut by the cone, and against beams."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.naive_cone import cell_echoes, nearest_in_cone
from support.strategies import REPEATABLE

from ogm_mcmc.geometry import GridSpec, Pose2D
from ogm_mcmc.simulation import GridWorld, true_ranges
from ogm_mcmc.simulation.cone_kernels import nearest_cell, nearest_wall

approx = pytest.approx


def cone(heading, half):
    return math.cos(heading), math.sin(heading), math.cos(half), math.sin(half)


def walls_at(walls, x, y, heading, half):
    return nearest_wall(np.asarray(walls, np.float64), float(x), float(y), *cone(heading, half))


def cells_at(occupied, x, y, heading, half, reach=99.0, depth=0.0):
    return nearest_cell(occupied, float(x), float(y), *cone(heading, half), float(reach), depth)


@pytest.mark.parametrize(
    ('wall', 'distance'),
    [
        ((2, -5, 2, 5), 2.0),  # at right angles
        ((2, 0.4, 2, 5), math.hypot(2, 0.4)),  # an end within the cone
        ((2, 1.5, 2, 5), math.inf),  # beside it
        ((-2, -5, -2, 5), math.inf),  # behind the sonar
        ((1, 2, 5, 2), math.hypot(4, 2)),  # along the way: met by the cone's border
        ((3, 0, 5, 0), 3.0),  # on the axis, seen end-on: too thin for any beam
        ((3, 1.5, 5, 2.5), math.hypot(3, 1.5)),  # exactly on the border, which belongs to it
        ((2, 0.5, 2, 0.5), math.hypot(2, 0.5)),  # a wall that is a point
    ],
)
def test_walls_on_paper(wall, distance):
    """A sonar in the origin, its cone up to y = x / 2 on both sides."""
    half = math.atan2(1, 2) + 1e-9
    assert walls_at([wall], 0, 0, 0.0, half) == approx(distance, rel=1e-6)
    # Turned and moved as a whole, and walked the other way.
    turn = np.array([[math.cos(2.0), -math.sin(2.0)], [math.sin(2.0), math.cos(2.0)]])
    ends = np.array(wall, float).reshape(2, 2) @ turn.T + (3.0, -4.0)
    assert walls_at([ends.ravel()], 3, -4, 2.0, half) == approx(distance, rel=1e-6)
    assert walls_at([ends[::-1].ravel()], 3, -4, 2.0, half) == approx(distance, rel=1e-6)


CONES = {
    'heading': st.floats(-math.pi, math.pi),
    'half': st.floats(0.01, 1.55),
    'x': st.floats(0.0, 12.0),
    'y': st.floats(0.0, 12.0),
    'seed': st.integers(0, 10_000),
}


@REPEATABLE
@given(**CONES)
def test_walls_are_those_that_the_cone_cuts(seed, x, y, heading, half):
    walls = np.random.default_rng(seed).uniform(0.0, 12.0, (6, 4))
    cut = [
        math.hypot(*nearest_in_cone([tuple(w[:2]), tuple(w[2:])], x, y, heading, half))
        for w in walls
    ]
    nearest = walls_at(walls, x, y, heading, half)
    assert nearest == approx(min(cut), rel=1e-9)
    beams = true_ranges(walls, Pose2D(x, y, heading), np.linspace(-half, half, 200))
    assert nearest <= beams.min() + 1e-9


@REPEATABLE
@given(**CONES, density=st.sampled_from([0.02, 0.1, 0.5]), depth=st.sampled_from([0.0, 0.5, 1.0]))
def test_cells_are_those_that_the_cone_cuts(seed, x, y, heading, half, density, depth):
    occupied = (np.random.default_rng(seed).random((12, 12)) < density).astype(np.uint8)
    if x < 12.0 and y < 12.0:
        occupied[int(y), int(x)] = 0
    found = cells_at(occupied, x, y, heading, half, depth=depth)
    echoes = cell_echoes(occupied, x, y, heading, half)
    nearest = min((echo.enters for echo in echoes), default=math.inf)
    if nearest < 1e-9 or found == 0.0:
        assert nearest < 1e-9 or min(x % 1.0, y % 1.0) == 0.0  # it touches a cell
        return
    # Cells that share the nearest point are equally good.
    possible = [
        echo.enters + depth * (echo.leaves - echo.enters)
        for echo in echoes
        if echo.enters <= nearest + 1e-9
    ]
    assert any(found == approx(echo, abs=1e-7) for echo in possible or [math.inf])


def test_many_beams_come_near_the_cone():
    """No beam inside of the cone ends earlier; the first of 3001 nearly always ends little later.

    Not always: of a cell that only reaches into the cone with a tip, no beam may know.
    """
    rng = np.random.default_rng(7)
    late = []
    for _ in range(200):
        occupied = rng.random((12, 12)) < 0.05
        x, y, heading, half = rng.uniform((0.0, 0.0, -math.pi, 0.05), (12.0, 12.0, math.pi, 1.5))
        occupied[int(y), int(x)] = False
        world = GridWorld.checked(GridSpec(1.0, 12, 12), occupied)
        found = cells_at(world.occupied, x, y, heading, half)
        bearings = np.linspace(-half, half, 3001)
        beams = world.ranges(Pose2D(x, y, heading), bearings, 99.0, 0.0).min()
        assert found <= beams + 1e-9
        if math.isfinite(found):
            late.append(beams - found)
    assert len(late) > 120
    assert np.mean(np.array(late) < 0.01) > 0.97


def test_nothing_beyond_reach_and_touching():
    occupied = np.zeros((5, 9), np.uint8)
    occupied[2, 6] = 1
    assert cells_at(occupied, 1.5, 2.5, 0.0, 0.1) == approx(4.5)
    assert cells_at(occupied, 1.5, 2.5, 0.0, 0.1, reach=4.5) == approx(4.5)
    assert math.isinf(cells_at(occupied, 1.5, 2.5, 0.0, 0.1, reach=4.4))
    assert math.isinf(cells_at(occupied, 1.5, 2.5, math.pi, 0.1))
    # To the last row and column that begin in reach, on all four sides.
    ring = np.zeros((9, 9), np.uint8)
    ring[[0, -1]] = 1
    ring[:, [0, -1]] = 1
    for heading in np.arange(4) * 0.5 * math.pi:
        assert cells_at(ring, 4.5, 4.5, heading, 0.1, reach=3.5 + 1e-9) == approx(3.5)
        assert math.isinf(cells_at(ring, 4.5, 4.5, heading, 0.1, reach=3.4))
    # From outside of the array, inside of the cell, and against its side.
    assert cells_at(occupied, -2.0, 2.5, 0.0, 0.1) == approx(8.0)
    assert cells_at(occupied, 6.5, 2.5, 1.0, 0.1) == 0.0
    assert cells_at(occupied, 7.0, 2.5, 0.0, 0.1) == 0.0


@pytest.mark.jit
def test_one_specialization_of_each_kernel():
    walls_at([(2, -5, 2, 5)], 0, 0, 0.0, 0.1)
    cells_at(np.zeros((3, 3), np.uint8), 1.5, 1.5, 0.0, 0.1)
    assert len(nearest_wall.signatures) == 1
    assert len(nearest_cell.signatures) == 1
