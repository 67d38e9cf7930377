"""How likely a way is blocked, asked of whole maps drawn from the posterior.

Cells of one wall are occupied together or not at all, so the probability that a disc meets
something does not follow from those of the cells: their product takes each for a chance of its
own, and calls every way past a few doubtful cells blocked. A sample holds all cells at once: the
share of samples in which the disc meets an occupied cell is the probability that it does.

Design note: how much of the unknown is one chance
--------------------------------------------------
Context. All unknown cells that a way touches were one chance of the prior, however many. Ways that
touch a few at their side were called blocked too often, and in a sparse hall long ways out of the
map too: simulated building 9, every second scan, had an error of 0.031 over all ways.

Decision. Each `LUMP_M2` of unknown cells is a chance of its own: what is there comes in pieces of
walls and furniture, not in cells. Of ways that were free where the map knows, 0.01 were blocked by
up to 8 unknown cells of 0.1 m, 0.06 by 9 to 16, 0.2 by 17 to 32, 0.5 by more. A disc that stands
in unknown space alone is one chance at least: 0.2 to 0.5 of the ways that end so are blocked.

Consequence. The error over all ways of the buildings it was chosen by is 0.008 to 0.020 (before:
0.009 to 0.031); of others, sparser too, 0.006 to 0.032 (docs/results.md, collisions). Best for
single buildings would be 0.25 m2 (cluttered) to 1.1 (halls). Single places in unknown space behind
a wall are more often solid (0.45 to 0.8) than is said, 0.31: they err by 0.015 to 0.05. Smoothed
shares instead of hits of 64 samples were not needed: where all is known the error of ways is 0.006
to 0.027.

One word holds a cell's value in 64 samples (`SampleBits`), so that one pass over the cells of a
way asks all.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.engine.collision_kernels import way_risk
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.geometry import SampleBits

__all__ = ['LUMP_M2', 'collision_risk']

# So much unknown space, m2, is one chance to meet something.
LUMP_M2 = 0.6

# Beyond, a float no longer says which cell a place lies in, and soon no integer does.
FURTHEST_CELLS = 1e15


def collision_risk(
    samples: SampleBits, places: Any, radius_m: float, unknown: float
) -> Float64Array:
    """Return (N + 1,): how likely a disc meets something at each place, and on the whole way.

    places  (N, 2), m: x and y; the way goes straight from each to the next
    A cell that any point of the disc lies in counts. Of cells that were not sampled, or lie
    outside of the map, nothing is known: each `LUMP_M2` of them, or a disc full if that is less,
    is one chance, `unknown`, to be blocked, beside what the samples say.
    Raises PoseError without places and for those that are not finite or more than 1e15 cells
    away from the map, ConfigError for a radius below 0 or as large as that.
    """
    spec = samples.spec
    points: Float64Array = np.asarray(places, np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) == 0:
        raise PoseError(f'places of shape {points.shape}: expected (N, 2), N at least 1')
    if not np.isfinite(points).all():
        raise PoseError('a place of the way is not finite: expected x and y in m')
    furthest_m = FURTHEST_CELLS * spec.resolution_m
    if not 0.0 <= radius_m <= furthest_m:
        raise ConfigError(f'robot_radius is {radius_m}: expected 0 or more, up to {furthest_m:g}')
    risk = np.empty(len(points) + 1)
    away = points - (spec.origin_x_m, spec.origin_y_m)
    far = np.flatnonzero(~(np.abs(away) <= furthest_m).all(axis=1))
    if far.size:
        x, y = points[far[0]]
        raise PoseError(
            f'place {far[0] + 1} of the way is ({x:g}, {y:g}): expected x and y in m, up to '
            f'{furthest_m:g} from the map'
        )
    cells = np.ascontiguousarray(away / spec.resolution_m)
    radius = radius_m / spec.resolution_m
    lump = LUMP_M2 / spec.resolution_m**2
    way_risk(samples.words, samples.known, samples.draws, cells, radius, unknown, lump, risk)
    return risk
