"""Saved maps side by side in one picture, cell beside cell, with a caption."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import yaml
from PIL import Image, ImageDraw, ImageFont

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.output_files import replacing

__all__ = ['save_side_by_side']

UNKNOWN = (190, 198, 208)  # as in the PNG of a map
PAPER, INK = (255, 255, 255), (0, 0, 0)
FONT_SIZE = 15
MARGIN = 12
LEAST_WIDTH = 480  # of a map on the sheet; smaller ones are enlarged


class _Panel(NamedTuple):
    """A map's picture, and the cells of the common lattice it covers: left, right, bottom, top."""

    title: str
    image: Image.Image
    left: int
    right: int
    bottom: int
    top: int


def save_side_by_side(
    maps: Sequence[tuple[str, Path]], path: Path, caption: str
) -> tuple[int, int]:
    """Write titled maps, named by their YAML files, into one PNG; return its size in pixels.

    All show the same part of the world. Raises MapFileError for what is not a saved map with
    its PNG.
    """
    panels = [_panel(title, file) for title, file in maps]
    left = min(panel.left for panel in panels)
    right = max(panel.right for panel in panels)
    bottom = min(panel.bottom for panel in panels)
    top = max(panel.top for panel in panels)
    scale = max(1, -(-LEAST_WIDTH // (right - left)))
    width, height = scale * (right - left), scale * (top - bottom)

    font = ImageFont.load_default(FONT_SIZE)
    line = 2 * FONT_SIZE
    whole = MARGIN + len(panels) * (width + MARGIN)
    letters = max(20, int((whole - 2 * MARGIN) / font.getlength('n')))
    lines = textwrap.wrap(caption, letters)
    size = (whole, line + height + MARGIN + line * len(lines))
    sheet = Image.new('RGB', size, PAPER)
    draw = ImageDraw.Draw(sheet)
    for i, panel in enumerate(panels):
        x = MARGIN + i * (width + MARGIN)
        sheet.paste(UNKNOWN, (x, line, x + width, line + height))
        enlarged = panel.image.resize(
            (scale * panel.image.width, scale * panel.image.height), Image.Resampling.NEAREST
        )
        sheet.paste(enlarged, (x + scale * (panel.left - left), line + scale * (top - panel.top)))
        draw.text((x, FONT_SIZE // 2), panel.title, INK, font)
    for i, text in enumerate(lines):
        draw.text((MARGIN, line + height + MARGIN + i * line), text, INK, font)
    with replacing(path) as temporary:
        sheet.save(temporary, format='PNG')
    return size


def _panel(title: str, path: Path) -> _Panel:
    try:
        fields = yaml.safe_load(path.read_text(encoding='utf-8'))
        resolution = float(fields['resolution'])
        left, bottom = (round(float(value) / resolution) for value in fields['origin'][:2])
        with Image.open(path.with_suffix('.png')) as opened:
            image = opened.convert('RGB')
    except (OSError, LookupError, TypeError, ValueError, ArithmeticError, yaml.YAMLError) as error:
        reason = ' '.join(str(error).split())
        raise MapFileError(f'{path}: expected a saved map and its PNG ({reason})') from error
    return _Panel(title, image, left, left + image.width, bottom, bottom + image.height)
