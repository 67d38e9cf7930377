"""What `patch-intel` found, as rows, curves and pictures: Fig. 7 and 9, Table IV of [patch]."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.experiments import intel
from ogm_mcmc.experiments.results import row
from ogm_mcmc.plotting import Series, curves_png

__all__ = ['METHODS', 'THRESHOLDS', 'page_of', 'part_name']

METHODS = ('traditional', 'cell', 'patch9', 'border9')
THRESHOLDS = np.linspace(0.0, 1.0, 101)

# Table IV, seconds per map sample with border; L = 9 without.
PUBLISHED_SECONDS = {
    'border9': {1: 1518.0, 2: 723.6, 3: 166.8},
    'patch9': {1: 6433.0, 2: 3023.0, 3: 306.1},
}

STYLES = {'traditional': 'k-o', 'cell': 'C0-o', 'patch9': 'C1-o', 'border9': 'C3-o'}

NOTES = [
    '[patch] shows F1 in Fig. 7 without numbers: traditional highest in experiment 1, with border '
    'highest in 2 and, by a significant margin, in 3.',
    'The benchmark is the traditional map of every beam, thresholded at 0.20: cells it never '
    'measured are at 0.234 and count as occupied. Cells count within 10 cells of a measured one.',
    'The sampler uses the mixture `beam` with sigma 0.05 m; [patch] a Gaussian with sigma 3 cells '
    '(rows "gaussian", at 5 cm). All held-out beams are judged by `beam`, sigma 0.05 m.',
    'The prior is learned at 0.05 m per cell and used as it is at 0.02 m.',
    'Log recorded by Dirk Haehnel at the Intel Research Lab (Radish, CC-BY).',
]


def part_name(kind: str, resolution: float, number: int, method: str) -> str:
    """Return what one map of one experiment is called."""
    return f'{kind}_{round(100 * resolution)}cm_exp{number}_{method}'


def page_of(
    folder: Path, found: Mapping[str, dict[str, Any]], judge: str, sweeps: Mapping[str, Any]
) -> dict[str, Any]:
    """Return everything the command shows and writes of what was found, by `part_name`."""
    rows: list[dict[str, Any]] = []
    tables: dict[str, Any] = {}
    for kind in ('beam', 'gaussian'):
        for resolution in (0.05, 0.02):
            for number in intel.POSE_STRIDES:
                for method in METHODS:
                    one = found.get(part_name(kind, resolution, number, method))
                    if one is None:
                        continue
                    place = tables.setdefault(kind, {}).setdefault(f'{resolution:.2f}', {})
                    place.setdefault(f'experiment_{number}', {})[method] = one
                    rows += _rows(kind, resolution, number, method, one)
    pictures: dict[str, str] = {}
    for resolution, by_number in tables['beam'].items():
        pictures.update(_draw(folder, resolution, by_number))
    any_of = next(iter(found.values()))
    sampled = next(one for name, one in found.items() if 'border9' in name)
    return {
        'rows': rows,
        'pictures': pictures,
        'settings': {
            **sampled['settings'],
            'sweeps': f'burn-in and counted: {sweeps}',
            'mapped_share_of_benchmark': any_of['benchmark_mapped_share'],
            'share_of_cells_that_count': any_of['near_share'],
            'judge': judge,
        },
        'notes': NOTES,
        'results': tables['beam'],
        'results_gaussian': tables.get('gaussian', {}),
    }


def _rows(
    kind: str, resolution: float, number: int, method: str, one: Mapping[str, Any]
) -> list[dict[str, Any]]:
    prefix = '' if kind == 'beam' else 'gaussian, '
    what = f'{prefix}{100 * resolution:g} cm, experiment {number}, {method}'
    lines = [
        row(
            f'{what}: max F1', one['max_f1'], None,
            f'at {one["threshold"]:.2f}: precision {one["precision"]:.3f}, recall '
            f'{one["recall"]:.3f}; at 0.5 F1 {one["f1_at_half"]:.3f}',
        ),
        row(
            f'{what}: nats per held-out beam', one['heldout_loglik_per_beam'], None,
            f'standard error {one["heldout_standard_error"]:.3f}',
        ),
    ]  # fmt: skip
    if one['seconds_per_sample'] is not None:
        published = PUBLISHED_SECONDS.get(method, {}).get(number) if resolution == 0.02 else None
        settings = one['settings']
        prior = settings.get('patch.prior_file') or 'no prior file'
        lines.append(
            row(
                f'{what}: s per map sample', one['seconds_per_sample'], published,
                f'burn-in {settings["chain.burn_in"]}, {settings["sweeps"]} sweeps, sigma '
                f'{settings["model.sigma"]:g} m, {prior}',
            )
        )  # fmt: skip
    return lines


def _draw(folder: Path, resolution: str, by_number: Mapping[str, Any]) -> dict[str, str]:
    """Draw Fig. 7 and F1 over thresholds; copy the maps of experiment 3 (Fig. 9)."""
    centimetres = round(100 * float(resolution))
    numbers = sorted(by_number)
    captions = {}
    for key, what in (('max_f1', 'max F1'), ('heldout_loglik_per_beam', 'nats per held-out beam')):
        name = f'{key}_{centimetres}cm.png'
        series = [
            Series(
                method,
                np.arange(1, len(numbers) + 1),
                np.array([by_number[number][method][key] for number in numbers]),
                STYLES[method],
            )
            for method in METHODS
        ]
        (folder / name).write_bytes(curves_png(series, 'experiment', what))
        captions[name] = f'{what}, cells of {centimetres} cm (as [patch] Fig. 7)'
    name = f'thresholds_{centimetres}cm.png'
    last = by_number[numbers[-1]]
    series = [
        Series(method, THRESHOLDS, np.array(last[method]['f1_curve']), STYLES[method][:-1])
        for method in METHODS
    ]
    (folder / name).write_bytes(curves_png(series, 'threshold', 'F1', x_limits=(0.0, 1.0)))
    captions[name] = f'F1 over the threshold in experiment 3, cells of {centimetres} cm'
    for method in METHODS:
        source = f'{part_name("beam", float(resolution), 3, method)}.png'
        captions[f'maps/{source}'] = (
            f'Experiment 3, {method}, cells of {centimetres} cm ([patch] Fig. 9)'
        )
    return captions
