"""What localizers came to, as tables of Markdown: the errors, and paired what maps gain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ogm_mcmc.lab.experiments.localization_logs import RECORDED
from ogm_mcmc.lab.experiments.localization_maps import (
    MEAN,
    MEAN_FIELD,
    PRODUCT,
    READERS,
    SAMPLES,
    THREE,
)
from ogm_mcmc.lab.experiments.results import markdown_table

__all__ = ['tables_of']

PAIRED = ((MEAN, THREE), (SAMPLES, THREE), (MEAN, PRODUCT), (MEAN_FIELD, PRODUCT))

# What readers came to, of each run.
Runs = Sequence[Mapping[str, Any]]


def tables_of(found: Mapping[str, Mapping[float, Runs]]) -> str:
    """Return a table for each recorded log and one for all buildings, then paired differences.

    found  of each log, by share of the beams: readers of each run
    Standard errors of a log are over its runs, of buildings over these, each the mean of its runs.
    """
    groups = {log: [log] for log in found if log in RECORDED}
    if buildings := [log for log in found if log not in RECORDED]:
        groups['buildings'] = buildings
    parts = []
    differences = []
    for group, logs in groups.items():
        of = {share: [found[log][share] for log in logs] for share in found[logs[0]]}
        head = [f'{group}: the filter reads', *(_head(share, runs) for share, runs in of.items())]
        lines = [[reader, *(_cell(reader, runs) for runs in of.values())] for reader in READERS]
        parts.append(markdown_table([head, *lines]))
        for one, other in PAIRED:
            gaps = (_gap(one, other, runs) for runs in of.values())
            differences.append([f'{group}: {one} less {other}', *gaps])
    shares = next(iter(found.values()))
    head = ['paired, m', *(f'{100 * share:g} %' for share in shares)]
    return '\n'.join([*parts, markdown_table([head, *differences])])


def _head(share: float, runs: Sequence[Runs]) -> str:
    return f'{100 * share:g} % ({len(runs[0])} runs)'


def _cell(reader: str, logs: Sequence[Runs]) -> str:
    """Return the error, m, and in brackets times lost a run and the share of starts found."""
    error = _over(logs, [[run[reader]['error_m'] for run in runs] for runs in logs])
    lost, back = (
        float(np.mean([run[reader][what] for runs in logs for run in runs]))
        for what in ('lost', 'found')
    )
    return f'{_said(error)} ({lost:.3g}, {back:.2f})'


def _gap(reader: str, other: str, logs: Sequence[Runs]) -> str:
    gaps = [
        [
            run[reader]['error_m'] - run[other]['error_m']
            for run in runs
            if run[reader]['error_m'] is not None and run[other]['error_m'] is not None
        ]
        for runs in logs
    ]
    return _said(_over(logs, gaps), sign='+')


def _over(logs: Sequence[Runs], values: Sequence[Sequence[float | None]]) -> tuple[float, float]:
    """Return mean and standard error: over runs of one log, over the means of several."""
    known = [[value for value in of if value is not None] for of in values]
    independent = known[0] if len(logs) == 1 else [float(np.mean(of)) for of in known if of]
    if not independent:
        return math.nan, math.nan
    spread = float(np.std(independent, ddof=1)) if len(independent) > 1 else math.nan
    return float(np.mean(independent)), spread / math.sqrt(len(independent))


def _said(figure: tuple[float, float], sign: str = '') -> str:
    value, error = figure
    if math.isnan(value):
        return '-'
    return f'{value:{sign}.3f}' + ('' if math.isnan(error) else f' +- {error:.3f}')
