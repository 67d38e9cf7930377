"""`evaluate` of several maps: which judges may be asked, one table, one JSON, one page."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from ogm_mcmc.cli.evaluate_answer import output_paths, write_answer
from ogm_mcmc.cli.evaluate_several import (
    MOST_IN_PAIRS,
    Compared,
    compared_by_beams,
    compared_by_truth,
    map_pictures,
)
from ogm_mcmc.cli.options import config_from, print_result
from ogm_mcmc.config import (
    EvaluationConfig,
    HeldOutConfig,
    HeldOutPointsConfig,
    PlacingConfig,
    build,
    flatten,
    given,
)
from ogm_mcmc.config.nodes import REFINE_CONFIGS, RefineSamplerConfig, judging
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.io.map_files import load_judged
from ogm_mcmc.plotting import Page

__all__ = ['run_several']

OF_ONE_MAP = ('pose', 'path', 'true_trajectory', 'relations', 'estimate', 'samples')


def run_several(
    options: argparse.Namespace, files: Mapping[str, Path], config: EvaluationConfig
) -> int:
    """Judge several maps by `--truth` and `--beams`."""
    for name in OF_ONE_MAP:
        if getattr(options, name) is not None:
            raise ConfigError(
                f'--{name.replace("_", "-")} with {len(files)} maps: expected one map, '
                'or --truth MAP and --beams BAG alone'
            )
    fills = 'unknown' not in given(options, EvaluationConfig)
    maps = {
        name: load_judged(path, options.max_cells, filled=fills) for name, path in files.items()
    }
    paths = output_paths(options)
    answers = _asked(options, maps, config)
    settings = flatten(config)
    for answer in answers.values():
        settings.update(answer.settings)
    result = {
        'maps': {
            name: {
                'map': str(path),
                **{judge: answer.figures[name] for judge, answer in answers.items()},
            }
            for name, path in files.items()
        },
        **{
            judge: {**answer.common, 'differences': answer.differences}
            for judge, answer in answers.items()
        },
        'settings': settings,
        'files': {kind: str(path) for kind, path in paths.items()},
    }
    header, rows = _table(list(files), answers)
    said = _lines(header, rows)
    page = Page(', '.join(files))
    page.table(header, rows)
    for answer in answers.values():
        remarks, pairs = _remarks(answer), _pairs(list(files), answer)
        for line in [*remarks, *([] if pairs else _differences(answer))]:
            page.text(line)
            said.append(line)
        if pairs:
            page.table(*pairs)
            said += ['', *_lines(*pairs)]
    page.heading('The maps')
    page.pictures(map_pictures(maps))
    for answer in answers.values():
        for heading, pictures in answer.sections:
            page.heading(heading)
            page.pictures(pictures)
    page.heading('Files')
    judges = [(f'--{name}', asked) for name, asked in _judges(options) if asked is not None]
    page.table((), [*files.items(), *judges])
    page.heading('Settings')
    page.table(('setting', 'value'), sorted(settings.items()))
    result = write_answer(paths, result, page)
    print_result(options, result, '\n'.join([*said, str(paths['html'])]))
    return 0


def _asked(
    options: argparse.Namespace, maps: Mapping[str, Any], config: EvaluationConfig
) -> dict[str, Compared]:
    read = partial(config_from, options, node='refine_server', node_configs=REFINE_CONFIGS)
    sampler, placing = judging(read(RefineSamplerConfig)), read(PlacingConfig)
    choice = build(HeldOutConfig, given(options, HeldOutConfig))
    points = build(HeldOutPointsConfig, given(options, HeldOutPointsConfig))
    answers: dict[str, Compared] = {}
    if options.truth is not None:
        answers['truth'] = compared_by_truth(maps, options.truth, config, options.max_cells)
    if options.bag is not None:
        answers['beams'] = compared_by_beams(
            options, maps, config, choice, points, placing, sampler
        )
    return answers


def _judges(options: argparse.Namespace) -> tuple[tuple[str, Path | None], ...]:
    return ('truth', options.truth), ('beams', options.bag)


def _table(names: list[str], answers: Mapping[str, Compared]) -> tuple[list[str], list[list[str]]]:
    """Return a header and a row for every map."""
    header = ['map']
    rows = [[name] for name in names]
    for answer in answers.values():
        header += answer.columns[names[0]]
        for row in rows:
            row += answer.columns[row[0]].values()
    return header, rows


def _lines(header: list[str], rows: list[list[str]]) -> list[str]:
    table = [header, *rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(header))]
    return [
        '  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    ]


def _remarks(answer: Compared) -> list[str]:
    """Return what +inf was taken to mean, and where maps lie."""
    why = answer.common.get('meaning_of_no_return', {}).get('why', '')
    lines = [why] if why else []
    return [*lines, *answer.common.get('alignments', []), *answer.common.get('hints', [])]


def _differences(answer: Compared) -> list[str]:
    """Return a line for each pair of maps."""
    lines = []
    for of in answer.differences:
        pair = f'{of["map"]} against {of["against"]}:'
        if 'nats_per_beam' in of:
            lines.append(
                f'{pair} {of["nats_per_beam"]:+.4f} +- {of["standard_error"]:.4f} nats a beam, '
                f'paired by scan; better in {of["scans_won"]} scans, '
                f'worse in {of["scans_lost"]}'
            )
        else:
            lines.append(
                f'{pair} {of["nearer"]:.6g} nats nearer to the truth; better in '
                f'{of["cells_won"]} cells, worse in {of["cells_lost"]}'
            )
    return lines


def _pairs(names: list[str], answer: Compared) -> tuple[list[str], list[list[str]]] | None:
    """Return a table of what each map, a row, is better by than the others; None for few maps."""
    if len(names) <= MOST_IN_PAIRS:
        return None
    title, gained = 'nats nearer to the truth than', {}
    for of in answer.differences:
        for sign, pair in ((1, ('map', 'against')), (-1, ('against', 'map'))):
            if 'nats_per_beam' in of:
                title = 'nats a beam more, paired by scan, than'
                gain = f'{sign * of["nats_per_beam"]:+.4f} +- {of["standard_error"]:.4f}'
            else:
                gain = f'{sign * of["nearer"]:+.6g}'
            gained[of[pair[0]], of[pair[1]]] = gain
    rows = [[name, *(gained.get((name, other), '') for other in names)] for name in names]
    return [title, *names], rows
