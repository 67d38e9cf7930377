"""Grids as PNG pictures, a pixel per cell, top row the highest y."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image

from ogm_mcmc.arrays import AnyArray, BoolArray, UInt8Array
from ogm_mcmc.files.pictures import UNKNOWN_COLOUR, paletted, probability_image

__all__ = ['agreement_png', 'heat_png', 'kinds_png', 'pixels_are_cells', 'probability_png']

WHITE = (255, 255, 255)

# Right wall, missing wall, wall where none is, right free cell, cell that does not count.
AGREEMENT_COLOURS = ((20, 20, 20), (31, 119, 180), (214, 39, 40), WHITE, UNKNOWN_COLOUR)

# From nothing to a lot: white, yellow, orange, red, black.
HEAT = ((255, 255, 255), (255, 237, 160), (254, 178, 76), (227, 26, 28), (60, 0, 20))


def _png(image: Image.Image) -> bytes:
    stream = io.BytesIO()
    image.save(stream, format='PNG', optimize=True)
    return stream.getvalue()


def pixels_are_cells(png: bytes, width: int) -> bool:
    """Whether a picture is one of this module, at most `width` cells wide.

    These have a palette; figures with axes have not.
    """
    with Image.open(io.BytesIO(png)) as image:
        return image.mode == 'P' and image.width <= width


def probability_png(probability: AnyArray) -> bytes:
    """Black occupied, white free, bluish grey unknown (nan)."""
    return _png(probability_image(probability))


def heat_png(values: AnyArray, top: float) -> bytes:
    """White at 0, yellow, red, black from `top` on; bluish grey where nan."""
    given = np.asarray(values)
    shade = np.empty(given.shape, np.uint8)
    for row, here in zip(shade, given, strict=True):  # whole, it takes many times the map
        heat = here.astype(np.float64)
        share = np.clip(np.nan_to_num(heat, nan=0.0, posinf=top) / top, 0.0, 1.0)
        row[:] = np.rint(254.0 * share)
        row[np.isnan(heat)] = 255
    stops = np.array(HEAT, np.float64)
    at = np.linspace(0.0, len(HEAT) - 1.0, 255)
    colours = np.stack(
        [np.interp(at, np.arange(len(HEAT)), stops[:, channel]) for channel in range(3)], axis=1
    )
    palette = [*np.rint(colours).astype(int).ravel().tolist(), *UNKNOWN_COLOUR]
    return _png(paletted(shade, palette))


def agreement_png(called: BoolArray, occupied: BoolArray, counted: BoolArray) -> bytes:
    """Black: walls found; blue: missed; red: drawn where none is; grey: does not count."""
    kinds = np.full(called.shape, 3, np.uint8)
    kinds[called & occupied] = 0
    kinds[~called & occupied] = 1
    kinds[called & ~occupied] = 2
    kinds[~counted] = 4
    return kinds_png(kinds, AGREEMENT_COLOURS)


def kinds_png(kinds: UInt8Array, colours: Sequence[tuple[int, int, int]]) -> bytes:
    """Every cell in the colour (red, green, blue) of its kind."""
    return _png(paletted(kinds, [value for colour in colours for value in colour]))
