"""Grids as figures, read back pixel by pixel."""

import io

import numpy as np
from PIL import Image

from ogm_mcmc.plotting import Closeup, Grid, Scale, Series, grids_png
from ogm_mcmc.plotting.grids import BAR_GAP, BAR_WIDTH, BOTTOM, LEFT, LEGEND, RIGHT, TOP
from ogm_mcmc.plotting.images import UNKNOWN_COLOUR, pixels_are_cells

BLACK, WHITE, GREY = (0, 0, 0), (255, 255, 255), (127, 127, 127)
BLUE = (31, 119, 180)
# Three columns, two rows, 20 pixels a cell; the upper right one is not known.
VALUES = np.array([[0.0, 1.0, 0.5], [1.0, 0.0, np.nan]])
EXTENT = (0.0, 3.0, 0.0, 2.0)
SIZE = 20


def pixels(png):
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert('RGB'))


def colour_at(picture, x, y, *, top=TOP, left=LEFT):
    """Colour at a place of the grid, in cells from its lower left corner."""
    return tuple(picture[int(top + (2 - y) * SIZE), int(left + x * SIZE)].tolist())


def drawn(grid=None, **settings):
    return pixels(grids_png([grid or Grid(VALUES, EXTENT)], 'x, m', 'y, m', side=60, **settings))


def test_every_pixel_of_a_cell_has_its_colour():
    picture = drawn()
    assert picture.shape == (TOP + 40 + BOTTOM, LEFT + 60 + RIGHT, 3)
    expected = {(0, 0): WHITE, (1, 0): BLACK, (2, 0): GREY, (0, 1): BLACK, (1, 1): WHITE}
    for (column, row), colour in {**expected, (2, 1): UNKNOWN_COLOUR}.items():
        for part in (0.15, 0.5, 0.85):
            assert colour_at(picture, column + part, row + part) == colour


def test_the_bar_has_the_same_colours_and_says_what_they_are():
    bar = drawn()[TOP : TOP + 40, LEFT + 60 + BAR_GAP + BAR_WIDTH // 2].sum(axis=1)
    assert bar[2] < 60 < 700 < bar[-3]
    numbers = drawn()[:, LEFT + 60 + BAR_GAP + BAR_WIDTH + 4 :]
    other = drawn(Grid(VALUES, EXTENT, Scale('bits')))[:, LEFT + 60 + BAR_GAP + BAR_WIDTH + 4 :]
    assert (numbers != other).any()


def test_values_beyond_the_scale_have_the_colour_of_its_end():
    scale = Scale('log-odds', -20.0, 20.0, 'PuOr')
    values = np.array([[-20.0, -60.0, 0.0], [20.0, np.inf, np.nan]])
    picture = drawn(Grid(values, EXTENT, scale))
    low, high = colour_at(picture, 0.5, 0.5), colour_at(picture, 0.5, 1.5)
    assert colour_at(picture, 1.5, 0.5) == low
    assert low != high
    assert colour_at(picture, 1.5, 1.5) == high
    assert colour_at(picture, 2.5, 1.5) == UNKNOWN_COLOUR
    # The bar has a tip, and so nothing in its corners, at an end beyond which there are values.
    for ends, tips in (((-20, 20), (False, False)), ((-30, 20), (False, True)),
                       ((-20, 30), (True, False)), ((-30, 30), (True, True))):  # fmt: skip
        grid = Grid(np.clip(values, *ends), EXTENT, scale)
        column = pixels(grids_png([grid], '', '', side=600))[:, LEFT + 600 + BAR_GAP + 1]
        found = tuple(tuple(column[row]) == WHITE for row in (TOP + 2, TOP + 400 - 3))
        assert found == tips


def test_marks_lie_where_they_are_and_do_not_move_the_axes():
    mark = Series('robot', np.array([1.5]), np.array([1.5]), 'C0o')
    picture = drawn(Grid(VALUES, EXTENT, marks=(mark, Series('', [0.0, 9.0], [0.5, 0.5], 'C0-'))))
    top = TOP + LEGEND
    assert picture.shape[0] == top + 40 + BOTTOM
    assert colour_at(picture, 1.5, 1.5, top=top) == BLUE
    assert colour_at(picture, 1.1, 1.1, top=top) == WHITE
    assert colour_at(picture, 0.5, 1.5, top=top) == BLACK
    assert (picture[: top - 2] == BLUE).all(axis=2).any()  # the legend
    assert not (drawn()[: TOP - 2] == BLUE).all(axis=2).any()


def test_close_ups_are_round_and_enlarged():
    closeups = (Closeup(0.5, 0.5, 0.25), Closeup(1.5, 0.5, 1.0))
    picture = drawn(Grid(VALUES, EXTENT, closeups=closeups))
    side = (60 - 16) // 2
    assert picture.shape[0] == TOP + 40 + BOTTOM + side + 16
    middle = TOP + 40 + BOTTOM + side // 2
    first, second = LEFT + side // 2, LEFT + side + 16 + side // 2
    # The first shows one white cell, the second black in the middle and white to its left.
    assert tuple(picture[middle + 2, first + 3]) == WHITE
    assert tuple(picture[middle + 2, second + 2]) == BLACK
    assert tuple(picture[middle + 2, second - 8]) == WHITE
    corner = picture[middle - side // 2 + 1, second + side // 2 - 1]
    assert tuple(corner) == WHITE  # outside of the circle, where the grid is not known
    # Around the place itself there is a circle, too.
    assert (picture[TOP + 20 : TOP + 40, LEFT : LEFT + 20] == BLUE).all(axis=2).any()


def test_grids_stand_beside_and_below_each_other():
    other = Grid(1.0 - VALUES, EXTENT, title='inverse')
    picture = pixels(grids_png([Grid(VALUES, EXTENT), other, other], 'x', 'y', columns=2, side=60))
    across, upwards = LEFT + 60 + RIGHT, TOP + 40 + BOTTOM
    assert picture.shape == (2 * upwards, 2 * across, 3)
    assert colour_at(picture, 0.5, 0.5) == WHITE
    assert colour_at(picture, 0.5, 0.5, left=LEFT + across) == BLACK
    assert colour_at(picture, 0.5, 0.5, top=TOP + upwards) == BLACK
    assert (picture[: TOP - 4, across:] == BLACK).all(axis=2).any()  # the title
    assert tuple(picture[upwards + TOP + 10, across + LEFT + 10]) == WHITE  # nothing there


def test_a_figure_is_no_picture_of_cells():
    assert not pixels_are_cells(grids_png([Grid(VALUES, EXTENT)], 'x', 'y', side=60), 600)
