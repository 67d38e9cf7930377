"""How likely a way is blocked, asked of whole maps drawn from the posterior.

Cells of one wall are occupied together or not at all, so the probability that a disc meets
something does not follow from those of the cells: their product takes each for a chance of its
own, and calls every way past a few doubtful cells blocked. A sample holds all cells at once: the
share of samples in which the disc meets an occupied cell is the probability that it does.

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

__all__ = ['collision_risk']


def collision_risk(
    samples: SampleBits, places: Any, radius_m: float, unknown: float
) -> Float64Array:
    """Return (N + 1,): how likely a disc meets something at each place, and on the whole way.

    places  (N, 2), m: x and y; the way goes straight from each to the next
    A cell that any point of the disc lies in counts. Of cells that were not sampled, or lie
    outside of the map, nothing is known, not even that they are independent: all of them together
    are one chance, `unknown`, to be blocked, beside what the samples say.
    Raises PoseError without places and for those that are not finite, ConfigError for a radius
    below 0.
    """
    spec = samples.spec
    points: Float64Array = np.asarray(places, np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) == 0:
        raise PoseError(f'places of shape {points.shape}: expected (N, 2), N at least 1')
    if not np.isfinite(points).all():
        raise PoseError('a place of the way is not finite: expected x and y in m')
    if not 0.0 <= radius_m < np.inf:
        raise ConfigError(f'robot_radius is {radius_m}: expected 0 or more')
    risk = np.empty(len(points) + 1)
    origin = (spec.origin_x_m, spec.origin_y_m)
    cells = np.ascontiguousarray((points - origin) / spec.resolution_m)
    radius = radius_m / spec.resolution_m
    way_risk(samples.words, samples.known, samples.draws, cells, radius, unknown, risk)
    return risk
