import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE, dyadics

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import CellBox, GridSpec

NOTHING = CellBox(0, 0, 0, 0)


@st.composite
def boxes(draw):
    """Boxes of at least one cell."""
    column, row = draw(st.integers(-50, 50)), draw(st.integers(-50, 50))
    return CellBox(column, row, column + draw(st.integers(1, 20)), row + draw(st.integers(1, 20)))


def cells(box):
    return {(i, j) for i in range(box.column0, box.column1) for j in range(box.row0, box.row1)}


def test_box_that_holds_nothing():
    assert NOTHING.empty
    assert CellBox(3, 3, 3, 9).empty
    assert CellBox(3, 9, 5, 2).empty
    assert not CellBox(3, 3, 4, 4).empty


def test_union_of_two_boxes():
    assert CellBox(0, 0, 2, 2).union(CellBox(5, -1, 6, 1)) == CellBox(0, -1, 6, 2)


@given(one=boxes(), other=boxes())
@REPEATABLE
def test_union_holds_both_and_covers_means_contains(one, other):
    union = one.union(other)
    assert cells(one) | cells(other) <= cells(union)
    assert union.column0 in (one.column0, other.column0)
    assert union.row1 in (one.row1, other.row1)
    assert one.covers(other) == (cells(other) <= cells(one))


@given(box=boxes())
@REPEATABLE
def test_an_empty_box_adds_nothing_and_is_covered_by_all(box):
    assert box.union(NOTHING) == NOTHING.union(box) == box
    assert box.covers(NOTHING)
    assert not NOTHING.covers(box)


def test_origin_follows_the_window():
    spec = GridSpec(0.25, 4, 3, column0=-8, row0=2, anchor_x_m=1.0, anchor_y_m=-1.0)
    assert (spec.origin_x_m, spec.origin_y_m) == (-1.0, -0.5)
    assert spec.box == CellBox(-8, 2, -4, 5)


def test_cell_on_a_border_is_the_upper_right_one():
    spec = GridSpec(0.5, 10, 10)
    assert spec.cell_of(0.0, 0.0) == (0, 0)
    assert spec.cell_of(0.5, 1.0) == (1, 2)
    assert spec.cell_of(math.nextafter(0.5, 0.0), 0.99) == (0, 1)
    assert spec.cell_of(-0.01, -0.5) == (-1, -1)


@given(
    resolution=st.sampled_from([0.05, 0.1, 0.25, 1.0]),
    window=boxes(),
    anchor=st.tuples(dyadics(-9, 9), dyadics(-9, 9)),
    cell=st.tuples(st.integers(-99, 99), st.integers(-99, 99)),
)
@REPEATABLE
def test_the_middle_of_a_cell_lies_in_it(resolution, window, anchor, cell):
    spec = GridSpec(resolution, 1, 1, 0, 0, *anchor).windowed(window)
    assert spec.cell_of(*spec.center_of(*cell)) == cell


@given(window=boxes(), inner=boxes())
@REPEATABLE
def test_slices_pick_the_cells_of_a_box(window, inner):
    spec = GridSpec(0.1, 1, 1).windowed(window.union(inner))
    rows, columns = spec.slices(inner)
    assert range(spec.height)[rows] == range(inner.row0 - spec.row0, inner.row1 - spec.row0)
    first, last = spec.column0 + columns.start, spec.column0 + columns.stop
    assert (first, last) == (inner.column0, inner.column1)


def test_windows_of_one_lattice_share_resolution_and_anchor():
    spec = GridSpec(0.1, 5, 5, 0, 0, 7.0, 8.0)
    moved = spec.windowed(CellBox(-3, -4, 5, 6))
    assert moved == GridSpec(0.1, 8, 10, -3, -4, 7.0, 8.0)
    assert moved.windowed(spec.box) == spec


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'resolution_m': 0.0}, 'resolution_m is 0.0: must be positive'),
        ({'resolution_m': -0.1}, 'resolution_m is -0.1: must be positive'),
        ({'resolution_m': math.inf}, 'resolution_m is inf: must be positive'),
        ({'resolution_m': math.nan}, 'resolution_m is nan: must be positive'),
        ({'width': 0}, 'width is 0: needs at least one column'),
        ({'height': -2}, 'height is -2: needs at least one row'),
        ({'anchor_x_m': math.nan}, r'origin is \(nan, 0.0\): must be finite'),
        ({'anchor_y_m': math.inf}, r'origin is \(0.0, inf\): must be finite'),
    ],
)
def test_refused(change, message):
    with pytest.raises(ConfigError, match=f'^{message}$'):
        GridSpec(**{'resolution_m': 0.1, 'width': 2, 'height': 2, **change})


def test_borders_of_a_grid():
    spec = GridSpec(0.5, 4, 6, column0=-2, row0=3, anchor_x_m=0.1)
    assert spec.extent_m == pytest.approx((-0.9, 1.1, 1.5, 4.5))


def test_poses_in_cells_keep_their_heading_and_places_need_none():
    spec = GridSpec(0.5, 10, 10, column0=-4, row0=2, anchor_x_m=0.25)
    poses = np.array([[-1.75, 1.0, 0.3], [0.25, 2.25, -3.0]])
    expected = np.array([[0.0, 0.0, 0.3], [4.0, 2.5, -3.0]])
    assert spec.in_cells(poses) == pytest.approx(expected)
    assert spec.in_cells([tuple(place) for place in poses[:, :2]]) == pytest.approx(
        expected[:, :2]
    )
    assert poses[0, 0] == -1.75
