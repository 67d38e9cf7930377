"""How results are shown: our value beside the published one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ogm_mcmc.errors import OutputError
from ogm_mcmc.io.map_files import replacing
from ogm_mcmc.plotting import Page, Picture

__all__ = ['make_page', 'row', 'save_picture', 'table_text']

HEADER = ('what', 'ours', 'published', 'remark')


def row(what: str, ours: Any, published: Any = None, remark: str = '') -> dict[str, Any]:
    """Return one line of a result table; `published` is None where a paper gives no number."""
    return {'what': what, 'ours': ours, 'published': published, 'remark': remark}


def save_picture(path: Path, png: bytes) -> None:
    """Write a picture, whole or not at all; raises OutputError."""
    with replacing(path) as temporary:
        temporary.write_bytes(png)


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
        Picture(_content(folder / name), caption)
        for name, caption in result.get('pictures', {}).items()
    ]
    if pictures:
        page.pictures(pictures)
    page.heading('Settings')
    page.table(('setting', 'value'), list(result.get('settings', {}).items()))
    return page


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        # Finished parts are not computed again, and their pictures not drawn again.
        raise OutputError(
            f'{path}: {error.strerror}; expected the picture of an earlier run: remove '
            f'{path.parent} and what else the experiment left, to do all of it again'
        ) from error


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
