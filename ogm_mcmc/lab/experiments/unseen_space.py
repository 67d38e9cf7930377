"""What a posterior map says where nothing was measured, by where its chains start.

A border-conditioned sampler keeps a solid block as it is for thousands of sweeps: started from
the thresholded live map, in which unmeasured cells are occupied ([patch]), unseen space stays
occupied, and the mean says so with certainty. Chains that start from all occupied, all free, the
live map and a draw from the prior disagree there, and the mean says "unknown".
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.lab.experiments.buildings import INTEL
from ogm_mcmc.lab.experiments.hardware_sets import (
    CELL_PRIOR,
    THRESHOLD,
    benchmark_of,
    split,
    traditional_map,
    window_box,
)
from ogm_mcmc.lab.experiments.map_samples import METHODS, config_of, sample_map
from ogm_mcmc.lab.experiments.results import picture_text
from ogm_mcmc.plotting import probability_png
from ogm_mcmc.sampling.estimates import hide_uncertain

__all__ = ['STARTS', 'unseen']

STARTS = ('live', 'dispersed')
CHAINS = 4

# A cell is shown when it is more certain than the prior by so much, as refine_server does.
MARGIN = 0.02


def unseen(
    data: str,
    resolution: float,
    number: int,
    start: str,
    sweeps: list[int],
    seed: int,
) -> dict[str, Any]:
    """Return the share of cells left unknown: never measured ones that count, and measured."""
    scans = INTEL.scans(Path(data))
    box = window_box(INTEL, scans, resolution)
    benchmark = benchmark_of(scans, box, resolution)
    used = split(INTEL, scans, number).used
    live = traditional_map(used, box, resolution)
    config = config_of(
        METHODS['border9'],
        resolution,
        ForwardModelConfig(),
        prior=CELL_PRIOR,
        threshold=THRESHOLD,
        burn_in=sweeps[0],
        seed=seed,
    )
    config = replace(config, chain=replace(config.chain, start=start, chains=CHAINS))
    found = sample_map(config, used, box, live, sweeps=sweeps[1])
    shown = hide_uncertain(found.mean, CELL_PRIOR, MARGIN)
    measured = np.isfinite(live.probability)
    unknown = ~np.isfinite(shown.probability)
    beyond = benchmark.counted & ~measured
    return {
        'picture': picture_text(probability_png(shown.probability)),
        'unknown_of_never_measured': float(unknown[beyond].mean()),
        'unknown_of_measured': float(unknown[measured].mean()),
        'occupied_of_never_measured': float((found.mean.probability[beyond] >= 0.9).mean()),
        'settings': found.settings,
    }
