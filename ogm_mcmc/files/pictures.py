"""Pictures of maps for people: a pixel per cell, a byte per pixel with a palette."""

from __future__ import annotations

import numpy as np
from PIL import Image

from ogm_mcmc.arrays import AnyArray, UInt8Array

__all__ = ['UNKNOWN_COLOUR', 'paletted', 'probability_image']

UNKNOWN_COLOUR = (190, 198, 208)


def paletted(pixels: UInt8Array, palette: list[int]) -> Image.Image:
    """Return the picture of cells (height, width), row 0 at the bottom; colours 3 by 3."""
    image = Image.fromarray(np.ascontiguousarray(pixels[::-1])).convert('P')
    image.putpalette(palette)
    return image


def probability_image(probability: AnyArray) -> Image.Image:
    """Return the picture of a map (height, width): black occupied, white free, bluish grey nan."""
    given = np.asarray(probability)
    shade = np.empty(given.shape, np.uint8)
    for row, p in zip(shade, given, strict=True):  # whole, it takes many times the map
        row[:] = np.rint(254.0 * (1.0 - np.nan_to_num(p)))
        row[~np.isfinite(p)] = 255
    greys = np.repeat(np.rint(np.linspace(0.0, 255.0, 255)).astype(np.uint8), 3)
    return paletted(shade, [*greys.tolist(), *UNKNOWN_COLOUR])
