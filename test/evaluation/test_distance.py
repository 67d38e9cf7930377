"""Distances between walls: by hand, by brute force, and as SciPy has them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from support.pictures import read
from support.strategies import REPEATABLE

from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation import distance_to, occupied_distance_error


@REPEATABLE
@given(
    height=st.integers(1, 12),
    width=st.integers(1, 12),
    share=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
    seed=st.integers(0, 1000),
)
def test_distance_by_brute_force(height, width, share, seed):
    cells = np.random.default_rng(seed).random((height, width)) < share
    marked = np.argwhere(cells)
    for row in range(height):
        for column in range(width):
            steps = np.hypot(*(marked - (row, column)).T) if marked.size else np.array([np.inf])
            assert distance_to(cells)[row, column] == pytest.approx(steps.min())


def test_distance_as_scipy_has_it():
    cells = np.random.default_rng(8).random((90, 140)) < 0.004
    assert distance_to(cells) == pytest.approx(ndimage.distance_transform_edt(~cells))


def test_a_wall_drawn_too_far_and_one_not_drawn():
    truth = read("""
        #....#
        #....#
    """)
    drawn = read("""
        ..#...
        ..#...
    """)
    error = occupied_distance_error(drawn == 1, truth == 1, resolution_m=0.1)
    assert error == pytest.approx((0.2, 0.2, 0.2, 0.2, 2))
    missed = occupied_distance_error(truth == 1, drawn == 1, resolution_m=0.1)
    assert missed.mean == pytest.approx(0.25)
    assert missed.rms == pytest.approx(0.1 * np.sqrt((4 + 9) / 2))
    assert missed.largest == pytest.approx(0.3)


def test_nothing_drawn():
    error = occupied_distance_error(np.zeros((2, 2), bool), np.ones((2, 2), bool))
    assert np.isnan(error.mean)
    assert error.cells == 0
    with pytest.raises(GridError, match='same cells'):
        occupied_distance_error(np.zeros((2, 2), bool), np.zeros((2, 3), bool))
