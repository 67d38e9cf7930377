"""Intel Research Lab, experiments 1 to 3 of [patch] section IV: Fig. 7 and 9, Table IV.

Four maps of each experiment, `traditional`, `cell` (L = 1, independent cells), `patch9` and
`border9` (L = 9 with the prior learned from buildings), are compared with the benchmark of
[patch], which is itself a traditional map, and judged by the beams that the experiment leaves
out, which takes no benchmark at all.
"""

from __future__ import annotations

import math
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
from ogm_mcmc.experiments.patch_intel_page import METHODS, THRESHOLDS, page_of, part_name
from ogm_mcmc.experiments.results import row
from ogm_mcmc.experiments.unseen_space import STARTS, unseen
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.map_files import writable_folder
from ogm_mcmc.plotting import probability_png
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['run', 'score']

# Sweeps that do not count, and that do. Without a border a sweep takes thirty times as long.
SWEEPS = {'traditional': (0, 0), 'cell': (30, 100), 'patch9': (10, 20), 'border9': (100, 100)}
QUICK_SWEEPS = {
    'traditional': (0, 0), 'cell': (10, 30), 'patch9': (3, 5), 'border9': (40, 60),
}  # fmt: skip

# The judge of held-out beams, alike for all maps: the default model.
JUDGE = ForwardModelConfig()

# One mixture of so many map samples is judged, too, by every so many-th held-out scan.
KEPT, MIXTURE_STRIDE = 20, 8


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
                jobs[part_name('beam', resolution, number, method)] = {
                    **common, 'method': method, 'kind': 'beam', 'sweeps': list(sweeps[method]),
                }  # fmt: skip
            if not quick and resolution == 0.05:
                for method in ('cell', 'border9'):
                    jobs[part_name('gaussian', resolution, number, method)] = {
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
                'start': start, 'seed': seed,
                'sweeps': [10, 20] if quick else list(sweeps['border9']),
            }
            for start in STARTS
        },
        title='unseen space',
    )  # fmt: skip
    result = page_of(
        folder,
        {name: found[name] for name in jobs},
        f'{JUDGE.kind}, sigma {JUDGE.sigma} m, clutter {JUDGE.clutter}',
        sweeps,
    )
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
    name = part_name(kind, resolution, number, method)
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
