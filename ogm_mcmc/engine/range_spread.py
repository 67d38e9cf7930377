"""How far readings scatter, from the beams that passed the cells in which others ended.

Design note: sigma from the data
--------------------------------
Context. `sigma` decides how surely the cell in which a beam ends is the one that stopped it. With
0.05 m for every sensor, walls seen by few beams of a precise lidar stay in doubt (F1 at 0.5 of
`uma_236_237`, 5 % of the beams, noise of 1 cm: 0.874 instead of 0.954 with 0.02); with 0.02 m a
log whose poses err by centimetres loses (Intel, experiment 3: 0.76 -> 0.70 nats a beam). How
readings scatter about lines through their neighbours does not tell the two apart: what poses err
by does not show there (0.019 to 0.029 m in both).

Decision. Of the other scans that came to the cell of a reading, what share passed it? Were the
map made of solid cells and sigma 0, none. The share holds all that makes readings miss their
cell: noise, poses, and walls that do not follow the lattice. What it is under the sampler's own
model was simulated (walls of cells at all angles, 1 cell thick or more, beams from all sides,
readings off the middle of the way through the first solid cell by sigma):

sigma, cells | 0.1 | 0.2 | 0.3 | 0.4 | 0.5 | 0.6 | 0.8 | 1.0 | 1.2 | 1.5 | 2.0
share        | .07 | .13 | .23 | .32 | .37 | .43 | .51 | .57 | .62 | .67 | .74

So sigma is 1.3 to 1.75 times the share up to one cell, and 0.75 times its odds beyond. 1.8 is
taken throughout the first part: real walls are thinner than cells, oblique or both, and taking
the sensor for a little less precise than it is costs less than the other way round. Chosen by
`uma_236_237`, the office and experiments 2 and 3 of Intel; `docs/results.md` has those and others.

Readings that others contradict do not count (`contradicted`): they are clutter, which has a share
of its own. Below a fifth of a cell nothing is gained. Few readings are held at the default by a
prior of four, each of which passed or not: it is no surer of the default than four readings are.

Consequence. It costs nothing where shares are found, too: the same counts. Sigma is of the poses
as they are used: where `sample --poses joint` moved them together first, it is smaller.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array, Int64Array
from ogm_mcmc.config import ForwardModelConfig, settings_of

__all__ = ['Spread', 'blur_of', 'contradicted', 'spread_of']

# So many others passed through the cell of a reading that is contradicted, and so many for each
# that ended beside it.
PASSED, PASSED_PER_CONFIRMED = 2, 8

# Sigma in cells is so many times the share of others that passed, or so many times its odds.
PER_SHARE, PER_ODDS = 1.8, 0.75

# As if so many readings had been seen before, of a sensor with the default sigma.
SEEN_BEFORE = 4.0

# Sigma is within so many cells, or as many as the default is where cells are finer.
LEAST_CELLS, MOST_CELLS = 0.2, 4.0

# And within what it may be set to.
SETTING = next(one for one in settings_of(ForwardModelConfig) if one.name == 'sigma')

# Up to a sigma of so many cells a reading is of the cell that it ends in; from so many on it may
# as well be of others.
SHARP_CELLS, BLURRED_CELLS = 0.5, 0.7


class Spread(NamedTuple):
    """A standard deviation of ranges, m, how sure it is, m, from so many readings that others met.

    The ends are those of its 95 % interval, by chance alone: readings of a wall err alike where
    poses do. Like the mean they are within the limits of sigma: both ends at 0.2 cells say that it
    is no more. Without a reading the mean is the default, and how sure it is nobody knows. Of
    grazing all of them are 0 or more, and the mean is 0 without a reading.
    """

    mean: float
    deviation: float | None
    beams: int
    low_95: float | None
    high_95: float | None

    def __str__(self) -> str:
        """Return `0.0168 m (0.0150 to 0.0190)`."""
        if self.beams == 0:
            return f'{self.mean:.4f} m (not told)'
        return f'{self.mean:.4f} m ({self.low_95:.4f} to {self.high_95:.4f})'


def blur_of(sigma_m: float, resolution_m: float) -> float:
    """Return how far what a cell reflected may be what others did: 0 not, 1 as likely as not.

    Design note. A cell drawn solid in every map that let half of its beams pass is 0.1 less
    sure by the weight of reflections. Where poses err that is right: Intel, even beams mapped,
    loses 0.058 of 1.289 nats without it. Where readings are exact within a cell it is the rim of a
    wall, and solid: without it the demo office's calibration error is 0.0021 instead of 0.0034
    with 5 % of the beams (live 0.0027), 0.0030 instead of 0.0041 with all (live 0.0030).
    Where no beam ended it is lowered all the same: without that best F1 of `pal_office` with 5 %
    of the beams is 0.920 instead of 0.926.
    So, too, is a cell that many beams ended in surely solid: with 5 beams instead of 20 for doubt
    (`at_least`) the office with all beams has F1 at 0.5 of 0.964 instead of 0.959, 70 sweeps.

    While shares told sigma all of it counted from 0.85 of a cell on. Pairs of beams say less, and
    cells reflect as before: even beams of Belgioioso, 0.81 of a cell by shares and 0.74 by pairs,
    lost 0.0084 and 0.0093 of 1.325 nats (two seeds) by pairs and 0.85, and +0.0012 and -0.0004
    with 0.7. Where no wall follows the lattice, sigma 0.54 to 0.81 of a cell, figures of the same
    draws are the same with both to 0.0002 or less (F1, Brier score, calibration error of
    six such maps); nats of `uma_236_237` by 7 degrees rise by 0.003. The
    office has 0.45 and 0.50 of a cell, and nothing changes.
    """
    cells = sigma_m / resolution_m
    return min(max((cells - SHARP_CELLS) / (BLURRED_CELLS - SHARP_CELLS), 0.0), 1.0)


def contradicted(misses: Int64Array, others: Int64Array) -> BoolArray:
    """Whether many passed through the cell of a reading, and none or few of others ended near."""
    against: BoolArray = (misses >= PASSED) & (misses >= PASSED_PER_CONFIRMED * others)
    return against


def spread_of(
    hits: Int64Array, misses: Int64Array, beside: Int64Array, resolution_m: float
) -> Spread:
    """Return sigma from what scans say of cells (height, width).

    hits    how many ended in a cell; misses: how many passed it; beside: how many ended near it,
            those in it included
    """
    others = hits - 1 + misses
    counts = (hits > 0) & (others > 0) & ~contradicted(misses, beside - 1)
    if not counts.any():
        return Spread(ForwardModelConfig.sigma, None, 0, None, None)
    default_cells = ForwardModelConfig.sigma / resolution_m
    readings = hits[counts].astype(np.float64)
    passed = misses[counts] / others[counts]
    default = _share(default_cells)
    known = readings.sum() + SEEN_BEFORE
    share = float((readings @ passed + SEEN_BEFORE * default) / known)
    # Readings of one cell are about the same others; those seen before are each of their own.
    before = (default - share) ** 2 + default * (1.0 - default)
    squares = readings**2 @ (passed - share) ** 2 + SEEN_BEFORE * before
    shares = share + math.sqrt(squares) / known * np.array([0.0, -1.96, 1.96])
    found_m = resolution_m * _cells(shares, max(MOST_CELLS, default_cells))
    mean, low, high = np.clip(found_m, SETTING.low, SETTING.high).tolist()
    return Spread(mean, (high - low) / 3.92, round(float(readings.sum())), low, high)


def _cells(share: Float64Array, most: float = MOST_CELLS) -> Float64Array:
    """Return the sigma, cells, up to `most`, at which such shares of others pass."""
    share = np.clip(share, 0.0, 0.99)
    cells = share * np.maximum(PER_SHARE, PER_ODDS / (1.0 - share))
    limited: Float64Array = np.clip(cells, LEAST_CELLS, most)
    return limited


def _share(cells: float) -> float:
    """Return the share at which sigma is so many cells."""
    return min(cells / PER_SHARE, cells / (cells + PER_ODDS))
