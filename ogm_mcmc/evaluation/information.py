"""How much a scan from somewhere would tell: expected information gain ([gibbs] section I).

Per beam it is the mutual information between its reading z and the map. A reading depends on the
map through the first occupied cell f alone, so I(map; z) = I(f; z), with p(f) from the
probabilities of the cells. Without noise that is the entropy of f. Beams of one scan cross the
same cells near the sensor, so the sum over beams is an upper bound for the scan.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.evaluation.beam_likelihood import LogDensity, density_within, depth_of
from ogm_mcmc.evaluation.first_hits import first_hits
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['expected_information_gain']


def expected_information_gain(
    grid_map: GridMap,
    sensor: Pose2D,
    bearings_rad: AnyArray,
    reach_m: float,
    judge: LogDensity | ForwardModel | None = None,
    *,
    z_step_m: float | None = None,
    prior: float = 0.5,
    depth: float | None = None,
) -> Float64Array:
    """Expected information gain (B,) of each beam from a pose, nats.

    Without a forward model readings are exact. With one, they are told apart in steps of
    `z_step_m` (a quarter of a cell by default) up to `reach_m`; "no return" is one more reading.
    `prior` and `depth` as in `beam_log_likelihood`.
    """
    if depth is None:
        depth = depth_of(judge)
    log_density = None if judge is None else density_within(judge, reach_m)
    hits = first_hits(grid_map, sensor, bearings_rad, reach_m, prior=prior, depth=depth)
    step = 0.25 * grid_map.spec.resolution_m if z_step_m is None else z_step_m
    require(step > 0.0, 'z_step_m', step, 'must be positive')
    readings = np.concatenate((np.arange(0.5 * step, reach_m, step), [np.inf]))
    gains = np.empty(hits.survival.size)
    for beam in range(gains.size):
        segment = slice(hits.starts[beam], hits.starts[beam + 1])
        p_f = np.concatenate((hits.masses[segment], hits.survival[beam : beam + 1]))
        if log_density is None:
            gains[beam] = _entropy(p_f)
            continue
        f = np.concatenate((hits.distances_m[segment], [np.inf]))
        gains[beam] = _mutual_information(p_f, f, readings, step, log_density)
    return gains


def _mutual_information(
    p_f: Float64Array,
    f: Float64Array,
    readings: Float64Array,
    step: float,
    log_density: LogDensity,
) -> float:
    """I(f; z) = H(z) - sum over f of p(f) H(z | f), nats."""
    z_grid, f_grid = np.meshgrid(readings, f, indexing='ij')
    p_z_given_f = np.exp(log_density(z_grid.ravel(), f_grid.ravel())).reshape(z_grid.shape)
    p_z_given_f[:-1] *= step
    # The density need not integrate to 1 over the readings there are (a Gaussian cut at reach).
    p_z_given_f /= p_z_given_f.sum(axis=0)
    given_f = np.array([_entropy(column) for column in p_z_given_f.T])
    return max(0.0, _entropy(p_z_given_f @ p_f) - float(p_f @ given_f))


def _entropy(p: Float64Array) -> float:
    positive = p[p > 0.0]
    return float(-(positive * np.log(positive)).sum())
