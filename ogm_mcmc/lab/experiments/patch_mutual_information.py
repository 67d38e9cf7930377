"""[patch] Fig. 2: what the cells of a line tell about each other.

Six readings about a wall in cell 8, the robot in cell 1. Mutual information between every two
cells from all 2^K maps, and from maps drawn by Gibbs sampling. The two-assumption map takes it to
be zero. The figure has no numbers in the text; noise and reach are not given either.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.lab.exact import Enumeration, enumerate_maps
from ogm_mcmc.lab.experiments.gibbs_line import (
    cell_model,
    draw_chain,
    draw_readings,
    measured_line,
)
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.plotting import Grid, Scale, Series, grids_png
from ogm_mcmc.sampling.estimates import mutual_information_bits, pair_information_bits

__all__ = ['exact_information', 'run']

READINGS, ROBOT, FIRST, SIGMA, REACH, PRIOR = 6, 1, 8, 2.0, 13, 0.5
BURN_IN = 50
FAR = 4


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Compare exact with sampled information; quick: fewer samples."""
    samples = 4000 if quick else 100_000
    rng = np.random.default_rng(seed)
    readings = draw_readings(rng, READINGS, float(FIRST - ROBOT), SIGMA, REACH)
    line = measured_line(readings, REACH, SIGMA, robot=ROBOT)
    model = cell_model(line, PRIOR)
    exact = exact_information(enumerate_maps(line.window.index, model.prior_log_odds))
    maps = draw_chain(rng, model, PRIOR, BURN_IN + samples)[BURN_IN:]
    sampled = mutual_information_bits(maps)
    apart = np.abs(np.subtract.outer(np.arange(line.n_cells), np.arange(line.n_cells)))
    others = np.where(apart > 0, exact, 0.0)
    first, second = np.unravel_index(int(others.argmax()), others.shape)
    top = float(others.max())
    for name, values in (('exact.png', exact), ('sampled.png', sampled)):
        save_picture(folder / name, information_png(np.where(apart > 0, values, np.nan), top))
    near, far = float(others[apart == 1].max()), float(others[apart >= FAR].max())
    return {
        'rows': [
            row('most information between two cells, bits', top, None,
                f'cells {ROBOT + int(first)} and {ROBOT + int(second)}'),
            row('most between neighbours, bits', near, None,
                'published: greatest between proximate cells'),
            row(f'most between cells {FAR} or more apart, bits', far, None,
                'published: approaches zero for cells farther apart'),
            row('sum over all pairs, bits', float(others.sum() / 2.0), 0.0,
                'published: what traditional maps assume'),
            row('largest difference sampled to exact, bits',
                float(np.abs(sampled - exact)[apart > 0].max()), None, f'{samples} samples'),
        ],
        'pictures': {
            'exact.png': f'[patch] Fig. 2: from all 2^{line.n_cells} maps; robot at k = {ROBOT}, '
                         f'wall at k = {FIRST} (dotted); the diagonal is left out',
            'sampled.png': f'From {samples} maps drawn by Gibbs sampling, on the same scale',
        },
        'settings': {
            'readings': [round(float(z), 3) for z in line.readings],
            'robot': ROBOT, 'first_occupied': FIRST, 'sigma_cells': SIGMA, 'reach_cells': REACH,
            'prior': PRIOR, 'samples': samples, 'burn_in': BURN_IN,
        },
        'exact': exact.tolist(),
        'sampled': sampled.tolist(),
        'notes': ['Noise and reach are ours: the paper prints neither for this example.'],
    }  # fmt: skip


def information_png(information: AnyArray, top: float) -> bytes:
    """Draw information (C, C), bits, over cells, the robot's being cell `ROBOT`, and the wall."""
    n_cells = information.shape[0]
    first, last = ROBOT - 0.5, ROBOT + n_cells - 0.5
    ends, wall = np.array([first, last]), np.full(2, float(FIRST))
    grid = Grid(
        information,
        (first, last, first, last),
        Scale('mutual information, bits', 0.0, top, 'viridis'),
        marks=(Series('', wall, ends, 'w:'), Series('', ends, wall, 'w:')),
    )
    return grids_png([grid], 'cell k', 'cell k')


def exact_information(everything: Enumeration) -> Float64Array:
    """Mutual information (C, C) between the touched cells, bits, from all maps."""
    n_cells = everything.touched.size
    weight = everything.probabilities()
    ones = (np.arange(weight.size)[:, None] >> np.arange(n_cells)) & 1
    both = ones.T @ (ones * weight[:, None])
    return pair_information_bits(np.diag(both).copy(), both)
