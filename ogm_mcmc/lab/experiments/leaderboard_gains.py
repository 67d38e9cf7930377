"""What the border prior is worth on the leaderboard: paired differences, as tables of Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ogm_mcmc.lab.experiments.results import markdown_table

__all__ = ['BORDER', 'gains']

BORDER = 'sampled, border prior'

TEXT = """\
## What the border prior is worth

What `sampled, border prior` has more than others, paired. Logs: nats a beam at the poses as given,
beam by beam; standard errors take scans as independent.
"""
BUILDINGS_TEXT = """\
Buildings: means of differences in each building, with their standard errors. Last, what joint
poses have more than those of the filter, for this map.
"""

OF_LOGS = (
    'sampled, patch prior',
    'sampled, single cells',
    'counting',
    'two_assumption',
)
OF_BUILDINGS = {
    'sampled, patch prior': ('nats', 'best_f1', 'f1', 'roc_area'),
    'two_assumption': ('nats', 'best_f1'),
}
BY_JOINT_POSES = ('nats', 'best_f1', 'roc_area')
CALLED = {'nats': 'nats', 'best_f1': 'best F1', 'f1': 'F1 at 0.5', 'roc_area': 'ROC area'}

Entry = Mapping[str, Any]
# What a line of a table says, by percent of the beams.
Line = Mapping[int, str]


def gains(entries: Sequence[Entry]) -> list[str]:
    """Return the parts of the page: none without a map of the border prior."""
    fixed = [one for one in entries if one['poses'] == 'fixed' and BORDER in one['mappers']]
    logs = [one for one in fixed if not one['data'].startswith('building-')]
    buildings = [one for one in fixed if one['data'].startswith('building-')]
    parts = []
    if logs:
        parts.append(f'{TEXT}\n{_table("nats a beam", _of_logs(logs))}')
    if buildings:
        joint = [one for one in entries if one['poses'] == 'joint' and BORDER in one['mappers']]
        parts.append(
            f'{BUILDINGS_TEXT}\n{_table("building by building", _of_all(buildings, joint))}'
        )
    return parts


def _of_logs(entries: Iterable[Entry]) -> Mapping[str, Line]:
    lines: dict[str, dict[int, str]] = {}
    for entry in entries:
        for name in OF_LOGS:
            if name in entry['mappers']:
                of = entry['mappers'][name]
                gain = entry['mappers'][BORDER]['nats'] - of['nats']
                line = lines.setdefault(f'{entry["data"]}: {name}', {})
                line[entry['percent']] = _said(gain, of.get('border_gain_error'))
    return lines


def _of_all(fixed: Sequence[Entry], joint: Sequence[Entry]) -> Mapping[str, Line]:
    lines: dict[str, Line] = {}
    for name, figures in OF_BUILDINGS.items():
        pairs = [
            (one['percent'], one['mappers'][BORDER], one['mappers'][name])
            for one in fixed
            if name in one['mappers']
        ]
        lines |= {f'{name}: {CALLED[figure]}': _means(pairs, figure) for figure in figures}
    given = {(one['data'], one['percent']): one['mappers'][BORDER] for one in fixed}
    pairs = [
        (one['percent'], one['mappers'][BORDER], given[one['data'], one['percent']])
        for one in joint
        if (one['data'], one['percent']) in given
    ]
    of_joint = {
        f'joint poses: {CALLED[figure]}': _means(pairs, figure) for figure in BY_JOINT_POSES
    }
    return {name: line for name, line in (lines | of_joint).items() if line}


def _means(pairs: Sequence[tuple[int, Entry, Entry]], figure: str) -> Line:
    """Return what the first of each pair has more, mean and error by percent of the beams."""
    line = {}
    for percent in dict.fromkeys(percent for percent, _, _ in pairs):
        gained = [one[figure] - other[figure] for of, one, other in pairs if of == percent]
        error = float(np.std(gained, ddof=1)) / math.sqrt(len(gained)) if len(gained) > 1 else None
        line[percent] = _said(float(np.mean(gained)), error)
    return line


def _said(gain: float, error: float | None) -> str:
    return f'{gain:+.3f}' if error is None else f'{gain:+.3f} +- {error:.3f}'


def _table(title: str, lines: Mapping[str, Line]) -> str:
    percents = sorted({percent for line in lines.values() for percent in line}, reverse=True)
    rows = [(title, *(f'{percent} %' for percent in percents))]
    for name, line in lines.items():
        rows.append((name, *(line.get(percent, '-') for percent in percents)))
    return markdown_table(rows)
