"""One HTML file with tables and pictures that opens without a network."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from typing import NamedTuple

from ogm_mcmc.plotting.images import pixels_are_cells

__all__ = ['Page', 'Picture']

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 1200px;
       padding: 0 1em; color: #222; background: #fff; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
table { border-collapse: collapse; margin: 0.5em 0; }
th, td { border-bottom: 1px solid #ddd; padding: 0.2em 0.9em 0.2em 0; text-align: left; }
td { font-variant-numeric: tabular-nums; }
.pictures { display: grid; gap: 1.2em;
            grid-template-columns: repeat(auto-fill, minmax(min(100%, 420px), 1fr)); }
figure { margin: 0; }
figure img { width: 100%; height: auto; border: 1px solid #ccc; }
figure img.cells { image-rendering: pixelated; }
figcaption { color: #555; font-size: 0.9em; }
"""

# Pixels a picture is wide at most on the page. Without smoothing, wider ones would lose cells.
COLUMN = 600


class Picture(NamedTuple):
    """A PNG with its caption."""

    png: bytes
    caption: str


class Page:
    """Sections of text, tables and pictures, in the order they are added."""

    def __init__(self, title: str) -> None:
        self.title = title
        self._parts: list[str] = []

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(f'<h2>{html.escape(text)}</h2>')

    def text(self, text: str) -> None:
        """Add a paragraph."""
        self._parts.append(f'<p>{html.escape(text)}</p>')

    def table(self, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Add a table; numbers are shown with five digits."""
        lines = ['<table>']
        if header:
            cells = ''.join(f'<th>{html.escape(name)}</th>' for name in header)
            lines.append(f'<tr>{cells}</tr>')
        for row in rows:
            cells = ''.join(f'<td>{html.escape(shown(value))}</td>' for value in row)
            lines.append(f'<tr>{cells}</tr>')
        self._parts.append('\n'.join([*lines, '</table>']))

    def pictures(self, pictures: Sequence[Picture]) -> None:
        """Add pictures beside each other; grids that the browser enlarges keep sharp cells."""
        figures = []
        for picture in pictures:
            data = base64.b64encode(picture.png).decode('ascii')
            kind = ' class="cells"' if pixels_are_cells(picture.png, COLUMN) else ''
            caption = html.escape(picture.caption)
            figures.append(
                f'<figure><img{kind} alt="{caption}" src="data:image/png;base64,{data}">'
                f'<figcaption>{caption}</figcaption></figure>'
            )
        self._parts.append('<div class="pictures">' + '\n'.join(figures) + '</div>')

    def html(self) -> str:
        """Return the whole page."""
        title = html.escape(self.title)
        body = '\n'.join(self._parts)
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<title>{title}</title><style>{STYLE}</style></head>\n'
            f'<body><h1>{title}</h1>\n{body}\n</body></html>\n'
        )


def shown(value: object) -> str:
    """Return a value as a table shows it."""
    if value is None:
        return ''
    return f'{value:.5g}' if isinstance(value, float) else str(value)
