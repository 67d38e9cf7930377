"""Section IV-B of [gibbs]: single cells sampled on a hundred simulated data sets; Fig. 4 and 5.

The paper gives two divergences without saying which map is the benchmark or what became of
probabilities of exactly 0 and 1, where a divergence is infinite. Here both directions are shown,
with the estimate q kept `FLOOR` away from 0 and 1, the smallest step of a double, which is what
Matlab code would add. The ground truth is that of Fig. 5 (b): 0, 1, and the prior inside of walls.

Burn-in is what it takes a chain from a random map until the log posterior comes within three
standard deviations of its mean over the second half of the run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.evaluation import total_divergence
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.lab.experiments.chains import (
    CUT_SIGMA,
    DEPTH,
    on_window,
    posterior_map,
    rays_of,
    traditional_map,
)
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.gibbs_figures import Maps, convergence_png, figure_5, sample_png
from ogm_mcmc.lab.experiments.hundred_sets import SimulatedSet, set_names, simulated_set
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.sampling import CellModel, GibbsState, PosteriorSampler, RayWindow

__all__ = ['burn_in', 'run', 'score', 'true_map']

NOISE_CELLS, BEAMS = 2.0, 360
PRIOR, UNINFORMED = 0.15, 0.5
SWEEPS, SAMPLES = 200, 200
FLOOR = 2.0**-52

PUBLISHED_TRUTH, PUBLISHED_LIVE, PUBLISHED_SWEEP_S = 8.8e5, 6.3e3, 53.0

# Fig. 4 shows these samples; Fig. 5 one of the data sets.
SHOWN_SWEEPS, SHOWN = (5, 10, 20), (5, 1)


class Trace(NamedTuple):
    """Log posterior (n,), nats, less a constant, after each sweep, and seconds for a sweep."""

    log_posterior: Float64Array
    seconds: float


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Sample all data sets; quick: one run in every second building."""
    names = set_names(runs=1 if quick else 10)
    if quick:
        names = {name: chosen for name, chosen in names.items() if chosen[0] % 2}
    settings = {'seed': seed, 'noise_cells': NOISE_CELLS, 'beams': BEAMS}
    results = run_all(
        folder / 'datasets',
        score,
        {name: {'building': b, 'run': r, **settings} for name, (b, r) in names.items()},
        title='gibbs-2d',
        depends_on={
            'priors': [PRIOR, UNINFORMED],
            'sweeps': SWEEPS,
            'samples': SAMPLES,
            'floor': FLOOR,
        },
    )
    every = list(results.values())
    return {
        'rows': [*_divergences(every), *_convergence(every)],
        'pictures': _pictures(folder, seed),
        'settings': {
            **settings,
            'data_sets': len(every),
            'prior': PRIOR,
            'samples': SAMPLES,
            'sweeps_before': SWEEPS,
            'floor': FLOOR,
            'forward_model': f'gaussian, sigma {NOISE_CELLS:g} cells, depth {DEPTH:g}, '
            f'rays cut {CUT_SIGMA:g} sigma behind their reading',
        },
        'notes': NOTES,
    }


NOTES = [
    'D(p, q): p the benchmark, q the estimate. The paper does not say which is which, nor what '
    'was done about q = 0 and q = 1, nor the noise of its ranges: compare orders of magnitude.',
    'With the MCMC map as benchmark the truth is infinitely far off wherever a sample doubts it; '
    'the sum is then the floor (36 nats) times the doubt, and says little else.',
]


def _divergences(every: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the divergences: means over the data sets."""

    def mean(what: str) -> float:
        return float(np.mean([result[what] for result in every]))

    return [
        row('D(MCMC, truth)', mean('mcmc_truth'), PUBLISHED_TRUTH, 'nats a data set'),
        row('D(truth, MCMC)', mean('truth_mcmc'), PUBLISHED_TRUTH),
        row('D(MCMC, two-assumption)', mean('mcmc_live'), PUBLISHED_LIVE),
        row('D(two-assumption, MCMC)', mean('live_mcmc'), PUBLISHED_LIVE),
        row('D(truth, two-assumption)', mean('truth_live')),
    ]


def _convergence(every: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of burn-in and time."""
    rows = []
    for prior, published in ((PRIOR, 'less than 20'), (UNINFORMED, 'in excess of 200')):
        sweeps = [result['burn_in'][f'{prior:g}'] for result in every]
        rows.append(
            row(
                f'sweeps of burn-in, prior {prior:g}',
                float(np.median(sweeps)),
                published,
                f'median; {min(sweeps)} to {max(sweeps)}',
            )
        )
    gaps = [result['behind_truth'] for result in every]
    rows.append(
        row(
            'log posterior below that of a chain from the truth',
            float(np.median(gaps)),
            None,
            f'nats, median; {min(gaps):.0f} to {max(gaps):.0f}',
        )
    )
    seconds = [result['seconds_per_sweep'] for result in every]
    rows.append(row('seconds a sweep', float(np.median(seconds)), PUBLISHED_SWEEP_S, 'median'))
    return rows


def score(building: int, run: int, seed: int, noise_cells: float, beams: int) -> dict[str, Any]:
    """Sample one data set from random maps with both priors; compare with truth and live map."""
    data = simulated_set(building, run, seed=seed, noise_cells=noise_cells, beams=beams)
    window = rays_of(data, noise_cells)
    rng = np.random.default_rng((seed, building, run, 4))
    burn_ins, traces = {}, {}
    for prior in (UNINFORMED, PRIOR):
        model = _model(window, prior)
        state = model.start((rng.random(model.n_cells) < prior).astype(np.uint8))
        traces[prior] = _traced(model, rng, state)
        burn_ins[f'{prior:g}'] = burn_in(traces[prior].log_posterior)
    # The chain with the informed prior goes on: its burn-in is over.
    sampler = PosteriorSampler(model, [state.cells], seed=seed, burn_in=0)
    sampler.advance(SAMPLES)
    spec = data.world.spec
    sampled = posterior_map(sampler, window.spec, spec).probability
    told = model.start(on_window(window.spec, data.world.occupied, spec, 0))
    best = _traced(model, rng, told).log_posterior[SWEEPS // 2 :].mean()
    return {
        **_compared(data, np.nan_to_num(sampled, nan=PRIOR)),
        'burn_in': burn_ins,
        'behind_truth': float(best - traces[PRIOR].log_posterior[SWEEPS // 2 :].mean()),
        'seconds_per_sweep': traces[PRIOR].seconds,
        'scans': len(data.scans),
        'pairs': window.index.n_pairs,
    }


def burn_in(log_posterior: Float64Array) -> int:
    """Return the sweep (from 1) that first comes near the level of the second half."""
    later = log_posterior[log_posterior.size // 2 :]
    near = log_posterior >= later.mean() - 3.0 * later.std()
    return int(np.argmax(near)) + 1


def true_map(data: SimulatedSet) -> Float32Array:
    """Return the truth of Fig. 5 (b): 0, 1, and the prior where no beam could ever look."""
    occupied = data.world.occupied.astype(np.float32)
    return np.where(data.world.observable(), occupied, np.float32(PRIOR))


def _model(window: RayWindow, prior: float) -> CellModel:
    return CellModel(window.index, math.log(prior / (1.0 - prior)), window.spec.width)


def _traced(model: CellModel, rng: np.random.Generator, state: GibbsState) -> Trace:
    """Advance a chain by `SWEEPS` in place and follow its log posterior."""
    values = np.empty(SWEEPS)
    seconds = 0.0
    for i in range(SWEEPS):
        began = time.perf_counter()
        model.advance(rng, state)
        seconds += time.perf_counter() - began
        values[i] = model.log_likelihood(state) + model.log_prior(state)
    return Trace(values, seconds / SWEEPS)


def _compared(data: SimulatedSet, sampled: Float32Array) -> dict[str, Any]:
    """Divergences between the three maps; cells that no ray touches have the prior in both."""
    live = np.nan_to_num(traditional_map(data, PRIOR).probability, nan=PRIOR)
    maps = {'truth': true_map(data), 'mcmc': sampled, 'live': live}
    wanted = (
        ('mcmc', 'truth'),
        ('truth', 'mcmc'),
        ('mcmc', 'live'),
        ('live', 'mcmc'),
        ('truth', 'live'),
    )
    return {f'{p}_{q}': total_divergence(maps[p], maps[q], floor=FLOOR).nats for p, q in wanted}


def _pictures(folder: Path, seed: int) -> dict[str, str]:
    """Draw Fig. 4 and 5 of one data set; return the captions by file name."""
    data = simulated_set(*SHOWN, seed=seed, noise_cells=NOISE_CELLS, beams=BEAMS)
    window = rays_of(data, NOISE_CELLS)
    captions = {}
    traces = {}
    for prior in (PRIOR, UNINFORMED):
        rng = np.random.default_rng((seed, *SHOWN, 5))
        trace = []
        for sweep, (state, value) in enumerate(_chain(window, prior, rng), 1):
            trace.append(value)
            if prior == PRIOR and sweep in SHOWN_SWEEPS:
                name = f'sample_{sweep}.png'
                sample = _on_world(state, window, data)
                save_picture(folder / name, sample_png(sample, data.world.spec))
                captions[name] = f'Sample {sweep} from a random map (Fig. 4); bluish: no ray came'
        traces[prior] = np.array(trace)
        if prior == PRIOR:
            sampler = PosteriorSampler(_model(window, prior), [state.cells], seed=seed, burn_in=0)
            sampler.advance(SAMPLES)
    over = {prior: burn_in(trace) for prior, trace in traces.items()}
    save_picture(folder / 'convergence.png', convergence_png(traces, over))
    captions['convergence.png'] = 'Log posterior of chains from a random map; dotted: burn-in'
    live = traditional_map(data, PRIOR).probability
    sampled = posterior_map(sampler, window.spec, data.world.spec).probability
    panels = figure_5(
        data, Maps(true_map(data), live, np.nan_to_num(sampled, nan=PRIOR)), PRIOR, FLOOR
    )
    for name, (png, caption) in panels.items():
        save_picture(folder / name, png)
        captions[name] = caption
    return captions


def _chain(
    window: RayWindow, prior: float, rng: np.random.Generator
) -> Iterator[tuple[GibbsState, float]]:
    """Yield the state, always the same one, and its log posterior after each sweep."""
    model = _model(window, prior)
    state = model.start((rng.random(model.n_cells) < prior).astype(np.uint8))
    for _ in range(SWEEPS):
        model.advance(rng, state)
        yield state, model.log_likelihood(state) + model.log_prior(state)


def _on_world(state: GibbsState, window: RayWindow, data: SimulatedSet) -> Float32Array:
    """Return a sample on the cells of the world, nan where no ray came."""
    touched = window.index.touched()
    found = GridMap.of_cells(window.spec, touched, state.cells[touched])
    return found.windowed(data.world.spec.box).probability
