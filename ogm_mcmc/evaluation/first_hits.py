"""First-hit distributions of the beams of a scan in a map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import ConfigError, require
from ogm_mcmc.evaluation.first_hit_kernels import scan_first_hits
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.geometry.rays import on_lattice

__all__ = ['FirstHits', 'first_hits']


class FirstHits(NamedTuple):
    """Of N beams: ray n may end at `distances_m[starts[n]:starts[n + 1]]` with those `masses`.

    `survival` (N,) is what is left: the probability that nothing is hit within reach.
    """

    distances_m: Float64Array
    masses: Float64Array
    starts: AnyArray
    survival: Float64Array


def first_hits(
    grid_map: GridMap,
    sensor: Pose2D,
    bearings_rad: AnyArray,
    reach_m: float,
    *,
    prior: float = 0.5,
    depth: float = 0.5,
) -> FirstHits:
    """Return where beams end if the cells are independent with the probabilities of the map.

    Unknown cells and those outside of the map are occupied with probability `prior`. `depth`
    says where inside a cell a beam is reflected, as a share of its way through. Raises GridError
    for a sensor absurdly far away from the map.
    """
    require(0.0 <= depth <= 1.0, 'depth', depth, 'expected 0 to 1')
    require(0.0 <= prior <= 1.0, 'prior', prior, 'expected 0 to 1')
    require(0.0 < reach_m < math.inf, 'reach', reach_m, 'expected a positive distance, m')
    spec = grid_map.spec
    on_lattice(sensor, spec)
    bearings = np.asarray(bearings_rad, np.float64).ravel()
    if not np.isfinite(bearings).all():
        raise ConfigError('bearings: expected finite angles')
    heading = sensor.yaw_rad + bearings
    directions = np.stack((np.cos(heading), np.sin(heading)))
    reach = reach_m / spec.resolution_m
    capacity = int(bearings.size * (1.5 * reach + 4.0))
    distances, masses = np.empty(capacity), np.empty(capacity)
    starts = np.empty(bearings.size + 1, np.int64)
    survival = np.empty(bearings.size)
    count = scan_first_hits(
        np.require(grid_map.probability, np.float32, ('C', 'W')),
        float(prior),
        (sensor.x_m - spec.origin_x_m) / spec.resolution_m,
        (sensor.y_m - spec.origin_y_m) / spec.resolution_m,
        directions,
        float(reach),
        float(depth),
        distances,
        masses,
        starts,
        survival,
    )
    return FirstHits(distances[:count] * spec.resolution_m, masses[:count], starts, survival)
