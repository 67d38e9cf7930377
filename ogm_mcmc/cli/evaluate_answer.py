"""What each judge of `evaluate` gives: figures for machines, rows and pictures for people."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.files.output_files import makeable_folder, refuse_folder, replacing_set
from ogm_mcmc.plotting import Page, Picture

__all__ = ['Answer', 'make_page', 'output_paths', 'write_answer']


class Answer(NamedTuple):
    """Figures for the JSON, rows (name, value) for the table, and sections of the page."""

    figures: dict[str, Any]
    rows: list[tuple[str, str]]
    sections: list[tuple[str, list[Picture]]]
    settings: dict[str, Any]


def make_page(title: str, answers: list[Answer], settings: dict[str, Any]) -> Page:
    """Return the page with all figures and pictures."""
    page = Page(title)
    page.table((), [row for answer in answers for row in answer.rows])
    for answer in answers:
        for heading, pictures in answer.sections:
            page.heading(heading)
            page.pictures(pictures)
    page.heading('Settings')
    page.table(('setting', 'value'), sorted(settings.items()))
    return page


def output_paths(options: argparse.Namespace) -> dict[str, Path]:
    """Return where the files go. Raises OutputError where they cannot."""
    makeable_folder(options.folder)
    paths = {kind: options.folder / f'{options.name}.{kind}' for kind in ('html', 'json')}
    for path in paths.values():
        refuse_folder(path)
    return paths


def write_answer(paths: dict[str, Path], result: dict[str, Any], page: Page) -> dict[str, Any]:
    """Write JSON and page; return the result as JSON can hold it."""
    held: dict[str, Any] = _finite(result)
    with replacing_set(paths['json'].parent, paths['json'].stem) as scratch:
        told = json.dumps(held, indent=2) + '\n'
        (scratch / paths['json'].name).write_text(told, encoding='utf-8')
        (scratch / paths['html'].name).write_text(page.html(), encoding='utf-8')
    return held


def _finite(value: Any) -> Any:
    """Replace what JSON has no number for (nan, inf) by None."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
