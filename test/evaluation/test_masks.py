"""Masks, against a square drawn around every cell and against SciPy."""

import numpy as np
import pytest
from scipy import ndimage
from support.pictures import read

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import cells_that_count, near


def test_near_on_paper():
    cells = read("""
        .....
        .....
        ..#..
        .....
        .....
    """)
    expected = read("""
        .....
        .###.
        .###.
        .###.
        .....
    """)
    assert np.array_equal(near(cells == 1, 1), expected == 1)
    assert np.array_equal(near(cells == 1, 0), cells == 1)
    assert near(cells == 1, 2).all()
    assert not near(np.zeros((2, 3), bool), 5).any()


@pytest.mark.parametrize('distance', [1, 3, 10])
def test_near_is_a_dilation(distance):
    cells = np.random.default_rng(3).random((37, 53)) < 0.01
    side = 2 * distance + 1
    expected = ndimage.binary_dilation(cells, np.ones((side, side)))
    assert np.array_equal(near(cells, distance), expected)


def test_masks_of_a_map():
    probability = np.full((3, 30), np.nan, np.float32)
    probability[1, 5] = 0.2
    assert cells_that_count(probability, 'all').all()
    assert np.argwhere(cells_that_count(probability, 'measured')).tolist() == [[1, 5]]
    assert cells_that_count(probability, 'near', 10).sum() == 3 * 16
    with pytest.raises(ConfigError, match='mask is'):
        cells_that_count(probability, 'some')
