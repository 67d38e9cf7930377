import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.geometry import CellBox, GridMap, GridSpec
from ogm_mcmc.geometry.grid_map import entropy_bits, occupancy_values, trinary_values

approx = pytest.approx


def row(*values):
    return np.array([values], np.float32)


def test_whole_percents():
    """Nearest, and unknown only where nothing was measured."""
    shown = occupancy_values(row(0.0, 0.004, 0.006, 0.5, 0.749, 0.994, 0.996, 1.0, math.nan))
    assert shown.dtype == np.int8
    assert shown[0].tolist() == [0, 0, 1, 50, 75, 99, 100, 100, -1]


@given(p=st.floats(0.0, 1.0, width=32))
@REPEATABLE
def test_whole_percents_are_near(p):
    (shown,) = occupancy_values(row(p))[0].tolist()
    assert 0 <= shown <= 100
    assert abs(shown - 100.0 * p) <= 0.501


def test_three_values_thresholds_included():
    shown = trinary_values(row(0.0, 0.25, 0.26, 0.74, 0.75, 1.0, math.nan), 0.75, 0.25)
    assert shown.dtype == np.int8
    assert shown[0].tolist() == [0, 0, -1, -1, 100, 100, -1]


def test_entropy_of_a_coin():
    entropy = entropy_bits(row(0.0, 0.5, 1.0, 0.25, 0.75, math.nan))[0]
    quarter = 0.25 * 2.0 + 0.75 * math.log2(4.0 / 3.0)
    assert entropy.tolist() == approx([0.0, 1.0, 0.0, quarter, quarter, math.nan], nan_ok=True)


def test_cropped_to_the_measured_cells():
    values = np.full((6, 8), math.nan, np.float32)
    values[2, 3], values[4, 1] = 0.25, 0.75
    cropped = GridMap(GridSpec(0.5, 8, 6, column0=10, row0=-20), values).cropped()
    assert cropped.spec == GridSpec(0.5, 3, 3, column0=11, row0=-18)
    expected = np.full((3, 3), math.nan)
    expected[0, 2], expected[2, 0] = 0.25, 0.75
    assert np.array_equal(cropped.probability, expected, equal_nan=True)
    again = cropped.cropped()
    assert again.spec == cropped.spec


def test_cropping_an_unknown_map_leaves_one_cell():
    unknown = GridMap(GridSpec(0.5, 4, 4, 7, 8), np.full((4, 4), math.nan, np.float32))
    assert unknown.cropped().spec == GridSpec(0.5, 1, 1, 7, 8)
    assert np.isnan(unknown.cropped().probability).all()


def test_another_window_of_the_same_lattice():
    held = GridMap(GridSpec(1.0, 2, 2, 5, 7), np.array([[1, 2], [3, 4]], np.float32))
    window = held.windowed(CellBox(4, 8, 7, 10))
    assert window.spec == GridSpec(1.0, 3, 2, 4, 8)
    expected = [[math.nan, 3, 4], [math.nan, math.nan, math.nan]]
    assert np.array_equal(window.probability, expected, equal_nan=True)
    assert np.isnan(held.windowed(CellBox(0, 0, 3, 2)).probability).all()


def test_values_of_some_cells():
    found = GridMap.of_cells(GridSpec(1.0, 3, 2), np.array([0, 4]), np.array([0.25, 0.75]))
    nan = math.nan
    assert np.array_equal(found.probability, [[0.25, nan, nan], [nan, 0.75, nan]], equal_nan=True)
    (row,) = GridMap.of_cells(GridSpec(1.0, 2, 1), np.array([1]), np.array([1.0]), 0.5).probability
    assert row.tolist() == [0.5, 1.0]
