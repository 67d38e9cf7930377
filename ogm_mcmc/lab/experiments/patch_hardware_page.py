"""What a recorded building gave, as rows, curves and pictures.

Fig. 7, 8 and 9 and Tables III and IV of [patch].
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.lab.experiments.hardware_sets import HardwareSet
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.plotting import Series, curves_png

__all__ = ['METHODS', 'THRESHOLDS', 'benchmark_name', 'page_of', 'part_name']

METHODS = ('traditional', 'cell', 'patch9', 'border9', 'fitted9')
THRESHOLDS = np.linspace(0.0, 1.0, 101)

STYLES = {
    'traditional': 'k-o', 'cell': 'C0-o', 'patch9': 'C1-o', 'border9': 'C3-o', 'fitted9': 'C4-o',
}  # fmt: skip

NOTES = [
    '[patch] shows F1 in Fig. 7 and 8 without numbers: traditional highest in the first '
    'experiment, with border highest in the second and, by a significant margin, in the third.',
    'The benchmark is the traditional map of every beam, thresholded at 0.20: cells it never '
    'measured are at 0.234 and count as occupied. Cells count within 10 cells of a measured one.',
    'The sampler uses the mixture `beam` with sigma 0.05 m; [patch] a Gaussian with sigma 3 cells '
    '(rows "gaussian"). `fitted9` is `border9` with clutter as the beams used have it, in place '
    'of 0.05. All held-out beams are judged by `beam`, sigma 0.05 m, clutter 0.05.',
    'The prior is learned at 0.05 m per cell and used as it is for cells of other sizes.',
]

# Results by resolution, experiment and method.
Tables = dict[float, dict[int, dict[str, dict[str, Any]]]]


def part_name(kind: str, resolution_m: float, number: int, method: str) -> str:
    """Return what one map of one experiment is called."""
    return f'{kind}_{_cells(resolution_m)}cm_exp{number}_{method}'


def benchmark_name(resolution_m: float) -> str:
    """Return the name of the picture of a benchmark."""
    return f'benchmark_{_cells(resolution_m)}cm.png'


def page_of(
    of: HardwareSet,
    folder: Path,
    found: Mapping[str, dict[str, Any]],
    judge: str,
    sweeps: Mapping[str, Any],
) -> dict[str, Any]:
    """Return everything the command shows and writes of what was found, by `part_name`."""
    beam, gaussian = _tables(of, found, 'beam'), _tables(of, found, 'gaussian')
    rows: list[dict[str, Any]] = []
    pictures: dict[str, str] = {}
    for resolution, by_number in beam.items():
        rows += _portions(of, resolution, by_number)
        pictures.update(_draw(of, folder, resolution, by_number))
    for kind, tables in (('', beam), ('gaussian, ', gaussian)):
        for resolution, by_number in tables.items():
            for number, by_method in by_number.items():
                for method, one in by_method.items():
                    what = f'{kind}{_cells(resolution)} cm, experiment {number}, {method}'
                    rows += _rows(of, resolution, number, method, one, what)
    sampled = next(one for name, one in found.items() if 'border9' in name)
    return {
        'rows': rows,
        'pictures': pictures,
        'settings': {
            **sampled['settings'],
            'sweeps': f'burn-in and counted: {sweeps}',
            'window_corner_m': sampled['window_corner_m'],
            'judge': judge,
        },
        'notes': [*NOTES, *of.notes],
        'results': _named(beam),
        'results_gaussian': _named(gaussian),
    }


def _cells(resolution_m: float) -> str:
    return f'{100.0 * resolution_m:.2g}'


def _tables(of: HardwareSet, found: Mapping[str, dict[str, Any]], kind: str) -> Tables:
    tables: Tables = {}
    for resolution in sorted({of.quick_resolution_m, *of.resolutions_m}, reverse=True):
        for number in of.pose_strides:
            for method in METHODS:
                one = found.get(part_name(kind, resolution, number, method))
                if one is not None:
                    tables.setdefault(resolution, {}).setdefault(number, {})[method] = one
    return tables


def _named(tables: Tables) -> dict[str, Any]:
    """Return tables with keys for JSON."""
    return {
        f'{_cells(resolution)}cm': {f'experiment_{k}': line for k, line in by_number.items()}
        for resolution, by_number in tables.items()
    }


def _portions(
    of: HardwareSet, resolution: float, by_number: Mapping[int, Mapping[str, dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Rows of Table III."""
    printed = of.published
    as_printed = resolution == printed.resolution_m
    cells = f'{_cells(resolution)} cm'
    any_of = next(iter(by_number.values()))['traditional']
    lines = [
        row(
            f'{cells}, benchmark: portion of cells mapped',
            any_of['benchmark_mapped_share'],
            printed.benchmark_mapped if as_printed else None,
            f'{any_of["benchmark_poses"]} poses, {any_of["benchmark_beams"]} measurements',
        ),
        row(
            f'{cells}: portion of cells that count',
            any_of['near_share'],
            printed.near if as_printed else None,
        ),
    ]
    for number, by_method in by_number.items():
        one = by_method['traditional']
        lines.append(
            row(
                f'{cells}, experiment {number}: portion of cells mapped',
                one['mapped_share'],
                printed.mapped[number] if as_printed else None,
                f'{one["poses"]} poses, {one["beams"]} measurements',
            )
        )
    return lines


def _rows(
    of: HardwareSet,
    resolution: float,
    number: int,
    method: str,
    one: Mapping[str, Any],
    what: str,
) -> list[dict[str, Any]]:
    """Rows of one map of one experiment."""
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
        as_printed = resolution == of.published.resolution_m
        seconds = of.published.seconds.get(method, {}).get(number) if as_printed else None
        settings = one['settings']
        prior = settings.get('patch.prior_file') or 'no prior file'
        lines.append(
            row(
                f'{what}: s per map sample', one['seconds_per_sample'], seconds,
                f'burn-in {settings["chain.burn_in"]}, {settings["sweeps"]} sweeps, sigma '
                f'{settings["model.sigma"]:.3g} m, {prior}',
            )
        )  # fmt: skip
    return lines


def _draw(
    of: HardwareSet,
    folder: Path,
    resolution: float,
    by_number: Mapping[int, Mapping[str, dict[str, Any]]],
) -> dict[str, str]:
    """Draw Fig. 7 or 8 and F1 over thresholds; name the maps of Fig. 9."""
    cells, last = _cells(resolution), of.sparsest
    numbers = np.array(list(by_number))
    captions = {}
    for key, what in (('max_f1', 'max F1'), ('heldout_loglik_per_beam', 'nats per held-out beam')):
        name = f'{key}_{cells}cm.png'
        series = [
            Series(
                method,
                numbers,
                np.array([line[method][key] for line in by_number.values()]),
                STYLES[method],
            )
            for method in METHODS
        ]
        save_picture(folder / name, curves_png(series, 'experiment', what))
        captions[name] = f'{what}, cells of {cells} cm (as [patch] {of.figure})'
    name = f'thresholds_{cells}cm.png'
    series = [
        Series(method, THRESHOLDS, np.array(one['f1_curve']), STYLES[method][:-1])
        for method, one in by_number[last].items()
    ]
    save_picture(folder / name, curves_png(series, 'threshold', 'F1', x_limits=(0.0, 1.0)))
    captions[name] = f'F1 over the threshold in experiment {last}, cells of {cells} cm'
    captions[benchmark_name(resolution)] = (
        f'The benchmark, cells of {cells} cm, under the first cells of the rays of experiment '
        f'{last} (blue), of the one before (and red) and of the first (and green; [patch] Fig. 9)'
    )
    for method in METHODS:
        captions[f'maps/{part_name("beam", resolution, last, method)}.png'] = (
            f'Experiment {last}, {method}, cells of {cells} cm ([patch] Fig. 9)'
        )
    return captions
