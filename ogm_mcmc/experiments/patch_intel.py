"""Intel Research Lab, experiments 1 to 3 of [patch] section IV: Fig. 7 and 9, Table IV.

Four maps of each experiment, `traditional`, `cell` (L = 1, independent cells), `patch9` and
`border9` (L = 9 with the prior learned from buildings), are compared with the benchmark of
[patch], which is itself a traditional map, and judged by the beams that the experiment leaves
out, which takes no benchmark at all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array
from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.evaluation import (
    beam_log_likelihood,
    confusion_counts,
    log_likelihood_of_samples,
)
from ogm_mcmc.experiments import intel
from ogm_mcmc.experiments.datasets import run_all
from ogm_mcmc.experiments.map_samples import METHODS as POSTERIORS
from ogm_mcmc.experiments.map_samples import SampledMap, config_of, sample_map
from ogm_mcmc.experiments.results import row
from ogm_mcmc.experiments.unseen_space import STARTS, unseen
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.map_files import writable_folder
from ogm_mcmc.plotting import Series, curves_png, probability_png
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['run', 'score']

METHODS = ('traditional', 'cell', 'patch9', 'border9')
THRESHOLDS = np.linspace(0.0, 1.0, 101)

# Sweeps that do not count, and that do. Without a border a sweep takes thirty times as long.
SWEEPS = {'traditional': (0, 0), 'cell': (30, 100), 'patch9': (10, 20), 'border9': (100, 100)}
QUICK_SWEEPS = {
    'traditional': (0, 0), 'cell': (10, 30), 'patch9': (3, 5), 'border9': (40, 60),
}  # fmt: skip

# The judge of held-out beams, alike for all maps: the default model.
JUDGE = ForwardModelConfig()

# One mixture of so many map samples is judged, too, by every so many-th held-out scan.
KEPT, MIXTURE_STRIDE = 20, 8

# Table IV, seconds per map sample with border; L = 9 without.
PUBLISHED_SECONDS = {
    'border9': {1: 1518.0, 2: 723.6, 3: 166.8},
    'patch9': {1: 6433.0, 2: 3023.0, 3: 306.1},
}

STYLES = {'traditional': 'k-o', 'cell': 'C0-o', 'patch9': 'C1-o', 'border9': 'C3-o'}

NOTES = [
    '[patch] shows F1 in Fig. 7 without numbers: traditional highest in experiment 1, border-based '
    'highest in 2 and, by a significant margin, in 3.',
    'The benchmark is the traditional map of every beam, thresholded at 0.20: cells it never '
    'measured are at 0.234 and count as occupied. Cells count within 10 cells of a measured one.',
    'The sampler uses the mixture `beam` with sigma 0.05 m; [patch] a Gaussian with sigma 3 cells '
    '(rows "gaussian", at 5 cm). All held-out beams are judged by `beam`, sigma 0.05 m.',
    'The prior is learned at 0.05 m per cell and used as it is at 0.02 m.',
    'Log recorded by Dirk Haehnel at the Intel Research Lab (Radish, CC-BY).',
]


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Sample and score everything; quick: cells of 5 cm, few samples."""
    data = intel.data_folder()
    sweeps = QUICK_SWEEPS if quick else SWEEPS
    pictures = writable_folder(folder / 'maps')
    jobs: dict[str, dict[str, Any]] = {}
    for resolution in (0.05,) if quick else (0.05, 0.02):
        for number in intel.POSE_STRIDES:
            common = {
                'data': str(data),
                'pictures': str(pictures),
                'resolution': resolution,
                'number': number,
                'seed': seed,
                'held_out_stride': 16 if quick else 2,
            }
            for method in METHODS:
                jobs[_name('beam', resolution, number, method)] = {
                    **common, 'method': method, 'kind': 'beam', 'sweeps': list(sweeps[method]),
                }  # fmt: skip
            if not quick and resolution == 0.05:
                for method in ('cell', 'border9'):
                    jobs[_name('gaussian', resolution, number, method)] = {
                        **common, 'method': method, 'kind': 'gaussian',
                        'sweeps': list(sweeps[method]),
                    }  # fmt: skip
    # The longest first, so that no core is left alone at the end.
    order = sorted(jobs, key=lambda name: 'patch9' not in name)
    found = run_all(
        folder / 'parts', score, {name: jobs[name] for name in order}, title='patch-intel'
    )
    starts = run_all(
        folder / 'parts',
        unseen,
        {
            f'unseen_{start}': {
                'data': str(data), 'pictures': str(pictures), 'resolution': 0.05, 'number': 3,
                'start': start, 'sweeps': list(sweeps['border9']), 'seed': seed,
            }
            for start in STARTS
        },
        title='unseen space',
    )  # fmt: skip
    result = _result(folder, {name: found[name] for name in jobs}, quick=quick)
    for start, one in starts.items():
        result['pictures'][f'maps/{start}.png'] = (
            f'Experiment 3, cells of 5 cm, four chains, {start.removeprefix("unseen_")} start; '
            'grey: no more certain than the prior'
        )
        result['rows'].append(
            row(
                f'{start}: never measured cells left unknown',
                one['unknown_of_never_measured'],
                None,
                f'occupied at 0.9 or more: {one["occupied_of_never_measured"]:.3f}; of the '
                f'measured cells unknown: {one["unknown_of_measured"]:.3f}',
            )
        )
    return {**result, 'unseen': starts}


def score(
    data: str,
    pictures: str,
    resolution: float,
    number: int,
    method: str,
    kind: str,
    sweeps: list[int],
    seed: int,
    held_out_stride: int,
) -> dict[str, Any]:
    """Make one map of one experiment, and judge it."""
    logs = intel.read_intel(Path(data))
    benchmark = intel.benchmark_of(logs, resolution)
    part = intel.split(logs, number)
    box = intel.window_box(resolution)
    traditional = intel.traditional_map(part.used, resolution)
    measured: BoolArray = np.isfinite(traditional.probability)
    sampled = None
    if method == 'traditional':
        filled = np.nan_to_num(traditional.probability, nan=intel.CELL_PRIOR)
        found = GridMap(traditional.spec, filled)
    else:
        sigma = 0.05 if kind == 'beam' else 3.0 * resolution
        config = config_of(
            POSTERIORS[method],
            resolution,
            ForwardModelConfig(kind=kind, sigma=sigma),
            prior=intel.CELL_PRIOR,
            threshold=intel.THRESHOLD,
            burn_in=sweeps[0],
            seed=seed,
        )
        sampled = sample_map(config, part.used, box, traditional, sweeps=sweeps[1], kept=KEPT)
        found = sampled.mean
    held_out = intel.without_beams_that_leave(part.held_out, box, resolution)
    name = _name(kind, resolution, number, method)
    (Path(pictures) / f'{name}.png').write_bytes(probability_png(found.probability))
    return {
        **_against(benchmark, found, measured),
        **_predicting(found, sampled, held_out, held_out_stride),
        'seconds_per_sample': None if sampled is None else sampled.seconds_per_sample,
        'mapped_share': float(measured.mean()),
        'benchmark_mapped_share': benchmark.mapped_share,
        'near_share': benchmark.near_share,
        'settings': {} if sampled is None else {**sampled.settings, 'rays': sampled.rays},
    }


def _against(benchmark: intel.Benchmark, found: GridMap, measured: BoolArray) -> dict[str, Any]:
    """F1 over thresholds, and where the mistakes at the best one lie."""
    counted, occupied = benchmark.counted, benchmark.occupied
    counts = confusion_counts(found.probability[counted], occupied[counted], THRESHOLDS)
    best = counts.best()
    called = found.probability >= np.float32(best.threshold)
    wrong = {
        'walls that are none, measured': called & ~occupied & measured,
        'walls that are none, never measured': called & ~occupied & ~measured,
        'walls missed, measured': ~called & occupied & measured,
        'walls missed, never measured': ~called & occupied & ~measured,
    }
    total = float(occupied[counted].sum())
    return {
        'max_f1': best.f1,
        'threshold': best.threshold,
        'precision': best.precision,
        'recall': best.recall,
        'f1_at_half': float(np.interp(0.5, counts.thresholds[::-1], counts.f1()[::-1])),
        'mistakes_per_occupied_cell': {
            what: float((cells & counted).sum()) / total for what, cells in wrong.items()
        },
        'f1_curve': counts.f1()[::-1].round(5).tolist(),
    }


def _predicting(
    found: GridMap, sampled: SampledMap | None, held_out: intel.Placed, stride: int
) -> dict[str, Any]:
    """Mean log-likelihood per held-out beam, nats; its standard error, scans independent."""
    model = ForwardModel.from_config(JUDGE)

    def log_density(z_m: Float64Array, f_m: Float64Array) -> Float64Array:
        return model.log_density(z_m, f_m, intel.RANGE_MAX_M)

    sums, beams = [], []
    for placed in held_out[::stride]:
        one = beam_log_likelihood(
            found, [placed], log_density, prior=intel.CELL_PRIOR, no_return='ignore'
        )
        sums.append(one.sum())
        beams.append(one.size)
    result: dict[str, Any] = {
        'heldout_loglik_per_beam': float(np.sum(sums) / np.sum(beams)),
        'heldout_standard_error': _error_of_ratio(np.array(sums), np.array(beams)),
        'heldout_beams': int(np.sum(beams)),
    }
    if sampled is not None:
        few = held_out[:: stride * MIXTURE_STRIDE]
        mixture = log_likelihood_of_samples(sampled.samples, few, log_density, no_return='ignore')
        result['heldout_loglik_of_samples'] = float(mixture.mean())
    return result


def _error_of_ratio(sums: AnyArray, counts: AnyArray) -> float:
    mean = sums.sum() / counts.sum()
    spread = (sums - mean * counts).std(ddof=1) * math.sqrt(sums.size)
    return float(spread / counts.sum())


def _name(kind: str, resolution: float, number: int, method: str) -> str:
    return f'{kind}_{round(100 * resolution)}cm_exp{number}_{method}'


def _result(folder: Path, found: Mapping[str, dict[str, Any]], *, quick: bool) -> dict[str, Any]:
    rows, tables = [], {}
    for kind in ('beam', 'gaussian'):
        for resolution in (0.05, 0.02):
            for number in intel.POSE_STRIDES:
                for method in METHODS:
                    one = found.get(_name(kind, resolution, number, method))
                    if one is None:
                        continue
                    place = tables.setdefault(kind, {}).setdefault(f'{resolution:.2f}', {})
                    place.setdefault(f'experiment_{number}', {})[method] = one
                    rows += _rows(kind, resolution, number, method, one)
    pictures = {}
    for resolution, by_number in tables['beam'].items():
        pictures.update(_draw(folder, resolution, by_number))
    any_of = next(iter(found.values()))
    sampled = next(one for name, one in found.items() if 'border9' in name)
    return {
        'rows': rows,
        'pictures': pictures,
        'settings': {
            **sampled['settings'],
            'sweeps': f'burn-in and counted: {QUICK_SWEEPS if quick else SWEEPS}',
            'mapped_share_of_benchmark': any_of['benchmark_mapped_share'],
            'share_of_cells_that_count': any_of['near_share'],
            'judge': f'{JUDGE.kind}, sigma {JUDGE.sigma} m, clutter {JUDGE.clutter}',
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
        lines.append(
            row(
                f'{what}: s per map sample', one['seconds_per_sample'], published,
                f'burn-in {settings["chain.burn_in"]}, {settings["sweeps"]} sweeps, sigma '
                f'{settings["model.sigma"]:g} m, {settings.get("patch.file") or "no prior file"}',
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
        source = f'{_name("beam", float(resolution), 3, method)}.png'
        captions[f'maps/{source}'] = (
            f'Experiment 3, {method}, cells of {centimetres} cm ([patch] Fig. 9)'
        )
    return captions
