"""Recorded buildings, [patch] section IV: Fig. 7, 8 and 9, Tables III and IV.

Experiments 1 to 3 are of the Intel Research Lab, 4 to 6 of the MIT Stata Center. Four maps of
each, `traditional`, `cell` (L = 1, independent cells), `patch9` and `border9` (L = 9 with the
prior learned from buildings), are compared with the benchmark of [patch], which is itself a
traditional map, and judged by the beams that the experiment leaves out, which takes no benchmark
at all. A fifth, `fitted9`, is `border9` with the share of random readings that the beams of the
experiment ask for, as `refine_server` has it, in place of one in twenty.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import BoolArray
from ogm_mcmc.config import ForwardModelConfig, flatten
from ogm_mcmc.engine.prior_files import default_prior_file
from ogm_mcmc.evaluation import (
    ForwardModel,
    beam_log_likelihood,
    confusion_counts,
    log_likelihood_of_samples,
    ratio_of_sums,
    without_beams_that_leave,
)
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.lab.experiments.benchmark_picture import benchmark_with_rays
from ogm_mcmc.lab.experiments.buildings import INTEL, STATA
from ogm_mcmc.lab.experiments.datasets import digest_of, run_all
from ogm_mcmc.lab.experiments.hardware_sets import (
    CELL_PRIOR,
    NEAR_CELLS,
    THRESHOLD,
    Benchmark,
    HardwareSet,
    benchmark_of,
    split,
    traditional_map,
    window_box,
)
from ogm_mcmc.lab.experiments.map_samples import FITTED, SampledMap, config_of, sample_map
from ogm_mcmc.lab.experiments.map_samples import METHODS as POSTERIORS
from ogm_mcmc.lab.experiments.patch_hardware_page import (
    METHODS,
    THRESHOLDS,
    benchmark_name,
    page_of,
    part_name,
)
from ogm_mcmc.lab.experiments.results import picture_text, row, save_part_pictures, save_picture
from ogm_mcmc.lab.experiments.unseen_space import STARTS, unseen
from ogm_mcmc.plotting import probability_png

__all__ = ['SETS', 'run_intel', 'run_stata', 'score']

SETS = {of.name: of for of in (INTEL, STATA)}

# Sweeps that do not count, and that do. Without a border a sweep takes thirty times as long; with
# one, patches settle slowly where nothing was measured (max F1 of experiment 3 at 5 cm: 0.811
# after 100 and 100 sweeps, 0.834 after 400 and 400, 0.836 after 1500 and 500).
SWEEPS = {
    'traditional': (0, 0), 'cell': (100, 200), 'patch9': (30, 60), 'border9': (400, 400),
    'fitted9': (400, 400),
}  # fmt: skip
QUICK_SWEEPS = {
    'traditional': (0, 0), 'cell': (10, 30), 'patch9': (3, 5), 'border9': (40, 60),
    'fitted9': (40, 60),
}  # fmt: skip

# The judge of held-out beams, alike for all maps: the default model.
JUDGE = ForwardModelConfig()

# One mixture of so many map samples is judged, too, by every so many-th held-out scan.
KEPT, MIXTURE_STRIDE = 20, 8


def run_intel(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Experiments 1 to 3, and unseen space in experiment 3; quick: cells of 5 cm, few samples."""
    data = INTEL.folder()
    scans = INTEL.scans(data)
    result = _run(INTEL, data, scans, folder, quick=quick, seed=seed)
    starts = run_all(
        folder / 'parts',
        unseen,
        {
            f'unseen_{start}': {
                'data': str(data),
                'resolution': 0.05,
                'number': INTEL.sparsest,
                'start': start,
                'seed': seed,
                'sweeps': [10, 20] if quick else list(SWEEPS['border9']),
            }
            for start in STARTS
        },
        title='unseen space',
        depends_on=depends_on(scans),
    )
    starts = save_part_pictures(folder / 'maps', starts)
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


def run_stata(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Experiments 4 to 6; quick: cells of 10 cm, few samples."""
    data = STATA.folder()
    return _run(STATA, data, STATA.scans(data), folder, quick=quick, seed=seed)


def _run(
    of: HardwareSet, data: Path, scans: list[PlacedScan], folder: Path, *, quick: bool, seed: int
) -> dict[str, Any]:
    """Sample and score everything."""
    sweeps = QUICK_SWEEPS if quick else SWEEPS
    jobs: dict[str, dict[str, Any]] = {}
    for resolution in (of.quick_resolution_m,) if quick else of.resolutions_m:
        save_picture(
            folder / benchmark_name(resolution), benchmark_with_rays(of, scans, resolution)
        )
        gaussian = not quick and resolution == of.resolutions_m[0]
        for number in of.pose_strides:
            for kind in ('beam', 'gaussian') if gaussian else ('beam',):
                for method in METHODS if kind == 'beam' else ('cell', 'border9'):
                    jobs[part_name(kind, resolution, number, method)] = {
                        'of': of.name,
                        'data': str(data),
                        'resolution': resolution,
                        'number': number,
                        'method': method,
                        'kind': kind,
                        'sweeps': list(sweeps[method]),
                        'seed': seed,
                        'held_out_scans': of.held_out_scans // (8 if quick else 1),
                    }
    # The longest first, so that no core is left alone at the end.
    order = sorted(jobs, key=lambda name: 'patch9' not in name)
    found = run_all(
        folder / 'parts',
        score,
        {name: jobs[name] for name in order},
        title=f'patch-{of.name}',
        depends_on=depends_on(scans),
    )
    found = save_part_pictures(folder / 'maps', found)
    judge = f'{JUDGE.kind}, sigma {JUDGE.sigma} m, clutter {JUDGE.clutter}'
    return page_of(of, folder, {name: found[name] for name in jobs}, judge, sweeps)


def depends_on(scans: list[PlacedScan]) -> dict[str, Any]:
    """Return what maps and scores depend on beside the arguments of `score`."""
    return {
        'recording': digest_of(
            *(one.scan.ranges_m.tobytes() + repr(one.pose).encode() for one in scans)
        ),
        'prior': digest_of(default_prior_file().read_bytes()),
        'judge': flatten(JUDGE),
        'mixture': [KEPT, MIXTURE_STRIDE],
        'benchmark': [CELL_PRIOR, THRESHOLD, NEAR_CELLS],
    }


def score(
    of: str,
    data: str,
    resolution: float,
    number: int,
    method: str,
    kind: str,
    sweeps: list[int],
    seed: int,
    held_out_scans: int,
) -> dict[str, Any]:
    """Make one map of one experiment, and judge it."""
    recorded = SETS[of]
    scans = recorded.scans(Path(data))
    box = window_box(recorded, scans, resolution)
    benchmark = benchmark_of(scans, box, resolution)
    part = split(recorded, scans, number)
    traditional = traditional_map(part.used, box, resolution)
    measured: BoolArray = np.isfinite(traditional.probability)
    sampled = None
    if method == 'traditional':
        filled = np.nan_to_num(traditional.probability, nan=CELL_PRIOR)
        found = GridMap(traditional.spec, filled)
    else:
        sigma = 0.05 if kind == 'beam' else 3.0 * resolution
        config = config_of(
            POSTERIORS[method],
            resolution,
            ForwardModelConfig(kind=kind, sigma=sigma),
            prior=CELL_PRIOR,
            threshold=THRESHOLD,
            burn_in=sweeps[0],
            seed=seed,
            sensor='fitted' if method in FITTED else 'given',
        )
        sampled = sample_map(config, part.used, box, traditional, sweeps=sweeps[1], kept=KEPT)
        found = sampled.mean
    held_out = without_beams_that_leave(part.held_out, found.spec)
    return {
        'picture': picture_text(probability_png(found.probability)),
        **_sizes(part.used),
        **{f'benchmark_{what}': count for what, count in _sizes(scans).items()},
        'window_corner_m': [box.column0 * resolution, box.row0 * resolution],
        **_against(benchmark, found, measured),
        **_predicting(found, sampled, held_out, held_out_scans),
        'seconds_per_sample': None if sampled is None else sampled.seconds_per_sample,
        'mapped_share': float(measured.mean()),
        'benchmark_mapped_share': benchmark.mapped_share,
        'near_share': benchmark.near_share,
        'settings': {} if sampled is None else {**sampled.settings, 'rays': sampled.rays},
    }


def _sizes(scans: list[PlacedScan]) -> dict[str, int]:
    return {'poses': len(scans), 'beams': sum(scan.ranges_m.size for scan, _ in scans)}


def _against(benchmark: Benchmark, found: GridMap, measured: BoolArray) -> dict[str, Any]:
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
    found: GridMap, sampled: SampledMap | None, held_out: list[PlacedScan], count: int
) -> dict[str, Any]:
    """Mean log-likelihood per held-out beam, nats; its standard error, scans independent.

    Of all scans about `count` are judged, evenly spread.
    """
    stride = max(1, len(held_out) // count)
    model = ForwardModel.from_config(JUDGE)
    sums, beams = [], []
    for placed in held_out[::stride]:
        one = beam_log_likelihood(found, [placed], model, prior=CELL_PRIOR, no_return='ignore')
        sums.append(one.sum())
        beams.append(one.size)
    per_beam = ratio_of_sums(np.array(sums), np.array(beams))
    result: dict[str, Any] = {
        'heldout_loglik_per_beam': per_beam.value,
        'heldout_standard_error': per_beam.standard_error,
        'heldout_beams': int(np.sum(beams)),
    }
    if sampled is not None:
        few = held_out[:: stride * MIXTURE_STRIDE]
        mixture = log_likelihood_of_samples(sampled.samples, few, model, no_return='ignore')
        result['heldout_loglik_of_samples'] = float(mixture.mean())
    return result
