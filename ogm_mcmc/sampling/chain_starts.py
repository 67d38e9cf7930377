"""Maps that chains start from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import BoolArray, UInt8Array
from ogm_mcmc.sampling.posterior import ARRIVES, PosteriorModel

__all__ = ['forgotten', 'over_dispersed_starts']

FORGETTING_SWEEPS = 5
FORGETTING_AGAIN_SWEEPS = 3
"""Of chains that begin anew where scans were placed anew: the map of before waits."""

FORGETTING_LOG_ODDS = math.log(1e-4)


def forgotten(
    model: PosteriorModel,
    starts: Sequence[UInt8Array],
    seed: int,
    only: BoolArray | None = None,
    ended: BoolArray | None = None,
) -> list[UInt8Array]:
    """Return maps (K,) that do not depend on where they started, `only` in these cells (K,).

    Cells (K,) in which readings `ended` are solid where no ray arrives that tells of them.

    A block of solid or empty cells is held together by a learned prior, and would outlast any
    burn-in. So cells are drawn one by one first, given the same rays and an even, small chance of
    being occupied: a few sweeps leave what the readings ask for, and nothing else. Intel,
    occupied: 76 000 flips in the first sweep, 2 900 in the second, 410 in the fifth, 290 in the
    tenth. After three sweeps and five of the burn-in maps are as far from the end as after five
    and five (`only`: Intel corrected, log-likelihood 167 430 and 167 400, error .0068 and .0070).

    Behind a surface rays ask for nothing. All is left empty there, and only the prior fills it, in
    hundreds of sweeps, though some readings ended there. Of 465 cells behind the outer walls of
    the demo's office (all beams) which the live map measured the mean was 0.74, 0.77 and 0.79
    after 64, 128 and 192 counted sweeps; about all else chains had agreed before the first of
    these. Were they to begin as `ended` has them F1 at 0.5, with such cells counted as solid, was
    0.973, 0.974 and 0.975 instead of 0.963, 0.965 and 0.970 (live 0.964), calibration error .0022,
    .0021 and .0021 instead of .0032, .0030 and .0028 (live .0030).
    """
    sweeps = FORGETTING_SWEEPS if only is None else FORGETTING_AGAIN_SWEEPS
    rngs = np.random.default_rng([seed, 2]).spawn(len(starts))

    def one(rng: Generator, cells: UInt8Array) -> UInt8Array:
        state = model.start(cells)
        model.forget(rng, state, FORGETTING_LOG_ODDS, sweeps, only)
        return state.cells

    with ThreadPoolExecutor(len(starts)) as pool:
        found = list(pool.map(one, rngs, starts))
    if ended is not None:
        mean = np.asarray(np.mean(found, axis=0), np.float32)
        hidden = ended & (model.arrival(mean, ARRIVES) < ARRIVES)
        for cells in found:
            cells[hidden if only is None else hidden & only] = 1
    return found


def over_dispersed_starts(
    kind: str,
    n_chains: int,
    live: UInt8Array,
    prior: float,
    seed: int,
    free: BoolArray,
) -> list[UInt8Array]:
    """Return a map (K,) per chain to start from; `live` is the thresholded live map.

    `dispersed` takes live, occupied, free and a draw from the prior in turn, but for the cells
    that are `free` (K,) in the live map: the two extremes disagree about everything else, so
    chains that agree afterwards have forgotten their start. Were the free cells occupied, too,
    a ray would end in front of its sensor, where every next cell is as unlikely as the last: a
    solid block wears off from its rim only (Intel, a tenth of the scans, `beam`: half of it was
    still there after 400 sweeps).
    """
    rng = np.random.default_rng([seed, 1])

    def one(name: str) -> UInt8Array:
        if name == 'live':
            return live.copy()
        if name == 'prior':
            cells = (rng.random(live.size) < prior).astype(np.uint8)
        else:
            cells = np.full(live.size, name == 'occupied', np.uint8)
        if kind == 'dispersed':
            cells[free] = 0
        return cells

    turns = ('live', 'occupied', 'free', 'prior') if kind == 'dispersed' else (kind,)
    return [one(turns[j % len(turns)]) for j in range(n_chains)]
