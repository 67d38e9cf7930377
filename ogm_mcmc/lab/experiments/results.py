"""How results are shown: our value beside the published one."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ogm_mcmc.files.output_files import replacing, writable_folder
from ogm_mcmc.plotting import Page, Picture

__all__ = [
    'make_page',
    'markdown_table',
    'picture_text',
    'row',
    'save_part_pictures',
    'save_picture',
    'table_text',
]

HEADER = ('what', 'ours', 'published', 'remark')


def row(what: str, ours: Any, published: Any = None, remark: str = '') -> dict[str, Any]:
    """Return one line of a result table; `published` is None where a paper gives no number."""
    return {'what': what, 'ours': ours, 'published': published, 'remark': remark}


def markdown_table(lines: Iterable[Sequence[str]]) -> str:
    """Return lines of cells, the header first, as a table of Markdown."""
    header, *others = lines
    rows = (header, ('---',) * len(header), *others)
    return ''.join(f'| {" | ".join(cells)} |\n' for cells in rows)


def save_picture(path: Path, png: bytes) -> None:
    """Write a picture, whole or not at all; raises OutputError."""
    with replacing(path) as temporary:
        temporary.write_bytes(png)


def picture_text(png: bytes) -> str:
    """Return a picture as part of a result that is fit for JSON: its `picture`."""
    return base64.b64encode(png).decode('ascii')


def save_part_pictures(
    folder: Path, parts: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Write the `picture` of each part as NAME.png; return the parts without.

    Whoever computes a part may have another disk, and what an earlier run left in `folder` may
    be of other settings, so pictures travel and are kept with their part.
    """
    writable_folder(folder)
    for name, part in parts.items():
        save_picture(folder / f'{name}.png', base64.b64decode(part['picture']))
    return {
        name: {key: value for key, value in part.items() if key != 'picture'}
        for name, part in parts.items()
    }


def make_page(folder: Path, result: dict[str, Any]) -> Page:
    """Return the page of a result; its pictures are read from the folder and embedded."""
    page = Page(f'Experiment {result["name"]}')
    mode = 'quick' if result['quick'] else 'full size'
    page.text(f'{mode}, seed {result["seed"]}, {result["seconds"]:.0f} s')
    if result.get('rows'):
        page.table(HEADER, [[line[key] for key in HEADER] for line in result['rows']])
    for note in result.get('notes', ()):
        page.text(note)
    pictures = [
        Picture((folder / name).read_bytes(), caption)
        for name, caption in result.get('pictures', {}).items()
    ]
    if pictures:
        page.pictures(pictures)
    page.heading('Settings')
    page.table(('setting', 'value'), list(result.get('settings', {}).items()))
    return page


def table_text(result: dict[str, Any]) -> str:
    """Return the rows of a result as text with aligned columns."""
    lines = [HEADER, *([_shown(line[key]) for key in HEADER] for line in result.get('rows', ()))]
    widths = [max(len(line[k]) for line in lines) for k in range(len(HEADER))]
    return '\n'.join(
        '  '.join(f'{cell:<{width}}' for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _shown(value: Any) -> str:
    if value is None:
        return '-'
    return f'{value:.4f}' if isinstance(value, float) else str(value)
