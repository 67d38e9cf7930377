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

Consequence. Chosen on buildings 1, 3, 5 and 9, which on their own would have 0.25 m2 (cluttered)
to 1.1 (halls). Smoothed shares instead of hits of 64 samples were not needed.

Design note: what known space tells of the unknown
--------------------------------------------------
Context. With one chance for all buildings, the prior of a cell (0.31), sparse halls were still
called blocked too often where they are unknown (0.032 over all ways, 0.07 over those), and single
places in unknown space too seldom: 0.45 to 0.8 of those behind walls are solid.

Decision. A chance lies between the prior and what known space shows, the share of its tiles of
`LUMP_M2` in which something is occupied: their geometric mean (`chance_of_unknown`). The best
single chance of ten maps of buildings 1, 3, 7, 9, 10 goes from 0.13 to 0.37 along with that share
(0.1 to 0.42). At a place to which the way is blocked already in a sample, a chance is `BEHIND`
there: 0.5 to 0.85 of the discs in unknown space behind walls are solid, 0.25 to 0.4 of those that
the way leads to freely. A way is not asked that: it is blocked there anyhow.

Consequence. Chosen on buildings 1, 3, 7, 10, with a look at 9; 2, 4, 6, 8 judge that and the area:
docs/results.md, collisions. The share alone errs more in cluttered buildings, the arithmetic mean
more in halls.

One word holds a cell's value in 64 samples (`SampleBits`), so that one pass over the cells of a
way asks all.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.engine.collision_kernels import built_up, way_risk
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.geometry import SampleBits

__all__ = ['BEHIND', 'LUMP_M2', 'chance_of_unknown', 'collision_risk']

# So much unknown space, m2, is one chance to meet something.
LUMP_M2 = 0.6

# That chance at a place which the way comes to through something occupied.
BEHIND = 0.6

# Beyond, a float no longer says which cell a place lies in, and soon no integer does.
FURTHEST_CELLS = 1e15


def chance_of_unknown(samples: SampleBits, prior: float) -> float:
    """Return how likely something is met in `LUMP_M2` of unknown space, by what known space shows.

    The geometric mean of the prior of a cell and the share of known tiles of that size in which
    a sample has something occupied; with few tiles the prior counts as one more.
    """
    side = max(1, round(math.sqrt(LUMP_M2) / samples.spec.resolution_m))
    occupied, tiles = built_up(samples.words, samples.known, side)
    share = (occupied / samples.draws + prior) / (tiles + 1)
    return math.sqrt(share * prior)


def collision_risk(
    samples: SampleBits, places: ArrayLike, radius_m: float, unknown: float, behind: float = BEHIND
) -> Float64Array:
    """Return (N + 1,): how likely a disc meets something at each place, and on the whole way.

    places  (N, 2), m: x and y; the way goes straight from each to the next
    A cell that any point of the disc lies in counts. Of cells that were not sampled, or lie
    outside of the map, nothing is known: each `LUMP_M2` of them, or a disc full if that is less,
    is one chance, `unknown` (see `chance_of_unknown`), to be blocked, beside what the samples say;
    at a place, in samples that block the way to it, `behind` if that is more.
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
    behind = max(unknown, behind)
    way_risk(
        samples.words, samples.known, samples.draws, cells, radius, unknown, behind, lump, risk
    )
    return risk
