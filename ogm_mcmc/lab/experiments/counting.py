"""The counting example of [slides]: a cell that reflects three beams in five.

"Out of n beams only 60 % are reflected from a cell and 40 % intercept it without ending in it."
The reflection map says 0.6. The occupancy grid, with p(occ | z) = 0.55 where a beam ends and 0.45
where it passes, goes to 1 as n grows: each step of five beams adds log(11/9) once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array
from ogm_mcmc.config import MapperConfig, StepModelConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.mapping import CountingMapper, TwoAssumptionMapper
from ogm_mcmc.plotting import Series, curves_png

__all__ = ['run']

REFLECTED, P_END, P_PASS = 0.6, 0.55, 0.45
CELL_M, RANGE_M = 1.0, 3.0
HERE, CELL = PoseBelief(Pose2D(0.5, 0.5)), CellBox(1, 0, 2, 1)


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Send beams at one cell; three in five of them end in it."""
    beams = 200 if quick else 1000
    rng = np.random.default_rng(seed)
    # In every five beams three are reflected, in random order: exactly 60 % at each full five.
    ends = np.concatenate([rng.permutation([True, True, True, False, False])
                           for _ in range(beams // 5)])  # fmt: skip
    occupancy = occupancy_after_each_beam(ends)
    counts = np.arange(1, beams + 1)
    reflection = reflection_after_each_beam(ends)
    expected = 1.0 / (1.0 + math.exp(-(beams / 5) * math.log(11.0 / 9.0)))
    save_picture(
        folder / 'counting.png',
        curves_png(
            [
                Series('counting: hits / (hits + misses)', counts, reflection),
                Series('occupancy grid', counts, occupancy),
                Series('reflection probability', counts, np.full(beams, REFLECTED), 'k:'),
            ],
            'beams',
            'value of the cell',
            y_limits=(0.0, 1.02),
            log_x=True,
        ),
    )
    to_99 = int(counts[occupancy >= 0.99][0])
    return {
        'rows': [
            row('reflection map', float(reflection[-1]), 0.6, f'after {beams} beams'),
            row('occupancy grid', float(occupancy[-1]), 1.0, 'the limit as n grows'),
            row(
                'the same in closed form', expected, None,
                f'(11/9)^{beams // 5} / (1 + (11/9)^{beams // 5})',
            ),
            row('beams until the occupancy grid says 0.99', to_99),
        ],
        'pictures': {'counting.png': 'A cell that reflects three beams in five'},
        'settings': {'beams': beams, 'reflected': REFLECTED, 'p_end': P_END, 'p_pass': P_PASS},
        'notes': [
            'Of every five beams three speak for the cell and two against it, so one remains: '
            'the n in (11/9)^n on the slide counts groups of five beams.'
        ],
    }  # fmt: skip


def occupancy_after_each_beam(ends: BoolArray) -> Float64Array:
    """Return the probability of the cell after each beam, by the live mapper itself."""
    step = StepModelConfig(
        l_free=math.log(P_PASS / (1.0 - P_PASS)), l_occ=math.log(P_END / (1.0 - P_END))
    )
    method = TwoAssumptionMapper(MapperConfig(fusion='per_beam', resolution=CELL_M, step=step))
    values = np.empty(ends.size)
    for index, scan in enumerate(_beams(ends)):
        method.update(PlacedScan(scan, HERE))
        values[index] = method.probabilities(CELL)[0, 0]
    return values


def reflection_after_each_beam(ends: BoolArray) -> Float64Array:
    """Return hits / (hits + misses) of the cell after each beam, as the counting mapper counts.

    Its `reflection` is this number in single precision.
    """
    method = CountingMapper(MapperConfig(method='counting', fusion='per_beam', resolution=CELL_M))
    values = np.empty(ends.size)
    for index, scan in enumerate(_beams(ends)):
        method.update(PlacedScan(scan, HERE))
        hits, misses = (int(count[0, 0]) for count in method.counts(CELL))
        values[index] = hits / (hits + misses)
    return values


def _beams(ends: BoolArray) -> Iterator[Scan]:
    """Yield a scan of one beam for each: it ends in the cell, or in the one behind."""
    for reflected in ends:
        yield Scan.checked(
            np.array([1.0 if reflected else 2.0]),
            angle_min_rad=0.0,
            angle_increment_rad=0.0,
            range_min_m=0.0,
            range_max_m=RANGE_M,
        )
