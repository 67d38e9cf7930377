"""Pictures of maps, pixel by pixel."""

import numpy as np

from ogm_mcmc.files.pictures import UNKNOWN_COLOUR, probability_image


def test_what_each_cell_looks_like():
    """The top line is the highest row; greys are even from white (free) to black (occupied)."""
    cells = np.array([[0.0, 0.5, 1.0], [np.nan, 0.25, 1.0]], np.float32)
    pixels = np.asarray(probability_image(cells).convert('RGB'))
    assert pixels.shape == (2, 3, 3)
    assert pixels[0, 0].tolist() == list(UNKNOWN_COLOUR)
    assert pixels[1].tolist() == [[255] * 3, [128] * 3, [0] * 3]
    assert pixels[0, 1].tolist() == [191] * 3
