"""What each judge of `evaluate` gives: figures for machines, rows and pictures for people."""

from __future__ import annotations

from typing import Any, NamedTuple

from ogm_mcmc.plotting import Page, Picture

__all__ = ['Answer', 'make_page']


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
