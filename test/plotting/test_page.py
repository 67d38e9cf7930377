"""Pages and pictures: what is put in comes out, nothing leads outside."""

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
from PIL import Image

from ogm_mcmc.plotting import (
    Page,
    Picture,
    Series,
    agreement_png,
    curves_png,
    heat_png,
    probability_png,
)
from ogm_mcmc.plotting.images import UNKNOWN_COLOUR


def pixels(png):
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert('RGB'))


def test_probabilities_are_grey_and_the_top_row_is_the_highest():
    picture = pixels(probability_png(np.array([[0.0, 1.0], [0.5, np.nan]])))
    assert picture[1, 0].tolist() == [255, 255, 255]
    assert picture[1, 1].tolist() == [0, 0, 0]
    assert picture[0, 0].tolist() == [128, 128, 128]
    assert tuple(picture[0, 1]) == UNKNOWN_COLOUR


def test_heat_rises_to_the_top_and_stays_there():
    picture = pixels(heat_png(np.array([[0.0, 0.2, 1.0, 5.0, np.inf, np.nan]]), 1.0))[0]
    brightness = picture.sum(axis=1)
    assert brightness[0] == 3 * 255
    assert brightness[0] > brightness[1] > brightness[2]
    assert (picture[2] == picture[3]).all()
    assert (picture[3] == picture[4]).all()
    assert tuple(picture[5]) == UNKNOWN_COLOUR


def test_agreement_has_five_colours():
    called = np.array([[1, 0, 1, 0, 0]], bool)
    occupied = np.array([[1, 1, 0, 0, 0]], bool)
    counted = np.array([[1, 1, 1, 1, 0]], bool)
    colours = {tuple(pixel) for pixel in pixels(agreement_png(called, occupied, counted))[0]}
    assert len(colours) == 5


def test_curves_are_a_picture_that_changes_with_the_curve():
    x = np.linspace(0.0, 1.0, 100_000)
    one = curves_png([Series('a', x, x), Series('b', x, x**2)], 'x', 'y')
    other = curves_png([Series('a', x, x), Series('b', x, x**3)], 'x', 'y')
    assert pixels(one).shape == (480, 640, 3)
    assert one != other


def test_a_corner_is_drawn_however_crowded_the_rest_of_the_curve_is():
    """One threshold of 100 000 makes the way from the left to the right; all others are near."""
    crowd = np.linspace(0.95, 1.0, 100_000)
    corner = np.array([0.0, 0.1, 0.6]), np.array([0.0, 0.9, 0.1])
    curve = Series('', np.append(corner[0], crowd), np.append(corner[1], crowd))
    ends = Series('', np.append(corner[0], crowd[[0, -1]]), np.append(corner[1], crowd[[0, -1]]))
    limits = {'x_limits': (0.0, 1.0), 'y_limits': (0.0, 1.0)}
    drawn, expected = (
        pixels(curves_png([one], 'x', 'y', **limits)).astype(int) for one in (curve, ends)
    )
    assert np.abs(drawn - expected).max() < 64


def test_a_page_holds_everything_itself():
    png = probability_png(np.zeros((2, 2)))
    page = Page('a < b')
    page.heading('tables & more')
    page.table(('name', 'value'), [('x', 1.23456789), ('<script>', None), ('n', 12345678)])
    page.pictures([Picture(png, 'cells "1"')])
    text = page.html()
    HTMLParser().feed(text)
    assert '<title>a &lt; b</title>' in text
    assert '1.2346' in text
    assert '12345678' in text
    assert '<script' not in text
    (embedded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert base64.b64decode(embedded) == png
    assert 'http' not in text


def test_grids_that_are_enlarged_keep_sharp_cells():
    def sharp(png):
        page = Page('one')
        page.pictures([Picture(png, 'it')])
        return 'class="cells"' in page.html()

    assert sharp(probability_png(np.zeros((2, 600))))
    assert sharp(heat_png(np.zeros((900, 2)), 1.0))
    # A wider one is shrunk, and thin walls must not fall between the pixels.
    assert not sharp(probability_png(np.zeros((2, 601))))
    assert not sharp(curves_png([Series('a', np.arange(3), np.arange(3))], 'x', 'y'))


def test_integers_have_integer_ticks(monkeypatch):
    """Three experiments are 4, 5 and 6, and nothing is at 4.25."""
    drawn = []
    monkeypatch.setattr(
        'matplotlib.figure.Figure.savefig',
        lambda figure, *_, **__: drawn.append(figure.axes[0].get_xticks().tolist()),
    )
    for x in (np.array([4, 5, 6]), np.array([4.0, 5.0, 6.0])):
        curves_png([Series('a', x, x)], 'experiment', 'y')
    assert all(tick.is_integer() for tick in drawn[0])
    assert not all(tick.is_integer() for tick in drawn[1])
