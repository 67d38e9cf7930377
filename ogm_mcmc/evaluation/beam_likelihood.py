"""Log-likelihood of held-out beams: a judge that needs no true map.

log p(z | map) = log sum over f of p(f is the first occupied cell) p(z | f), per beam, nats. On
real data this is the fairest comparison: a benchmark map would be made by one of the
contestants. Beams of one scan share cells, so the sum over beams is not a joint likelihood; the
mean per beam is what is compared.

A forward model is any callable `log_density(z_m, f_m)` on arrays of equal shape: log p(z | f),
nats (per metre), where f = inf stands for nothing hit within reach and z = inf for a beam that
did not return, whose value is a log-probability. A `ForwardModel` serves as well, with the
reach of each scan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation.first_hit_kernels import segment_log_sums
from ogm_mcmc.evaluation.first_hits import FirstHits, first_hits
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = [
    'LogDensity',
    'beam_log_likelihood',
    'density_within',
    'depth_of',
    'log_likelihood_of_samples',
]

LogDensity = Callable[[Float64Array, Float64Array], Float64Array]


def density_within(judge: LogDensity | ForwardModel, reach_m: float) -> LogDensity:
    """Return the density of a judge for beams of one reach."""
    if isinstance(judge, ForwardModel):
        return partial(judge.log_density, reach_m=reach_m)
    return judge


def depth_of(judge: LogDensity | ForwardModel | None) -> float:
    """Return where inside a cell a judge lets a beam end, as a share of its way through."""
    return judge.depth if isinstance(judge, ForwardModel) else 0.5


def beam_log_likelihood(
    grid_map: GridMap,
    placed: Iterable[PlacedScan],
    judge: LogDensity | ForwardModel,
    *,
    prior: float = 0.5,
    no_return: str = 'clear',
    depth: float | None = None,
) -> Float64Array:
    """Log-likelihood (N,) of every informative beam of scans at their mean poses, nats.

    Unknown cells and those outside of the map are occupied with probability `prior`. `depth`
    says where inside a cell a beam is reflected: by default as the model has it, or half way.
    """
    if depth is None:
        depth = depth_of(judge)
    parts = [np.empty(0)]
    for scan, belief in placed:
        beams = scan.informative(no_return_clears=no_return == 'clear')
        bearings = scan.bearings()[beams]
        reach = scan.range_max_m
        hits = first_hits(grid_map, belief.mean, bearings, reach, prior=prior, depth=depth)
        log_density = density_within(judge, reach)
        parts.append(_log_likelihood(hits, scan.ranges_m[beams].astype(np.float64), log_density))
    return np.concatenate(parts)


def log_likelihood_of_samples(
    samples: Iterable[GridMap],
    placed: Sequence[PlacedScan],
    judge: LogDensity | ForwardModel,
    *,
    prior: float = 0.0,
    no_return: str = 'clear',
    depth: float | None = None,
) -> Float64Array:
    """Log-likelihood (N,) of every beam under the mixture of S map samples of 0 and 1, nats.

    log (1 / S) sum over samples of p(z | sample): unlike the posterior mean, samples keep what
    neighbouring cells know of each other. Cells outside of a sample, or unknown in it, are
    occupied with probability `prior`, independently of all others.
    """
    total, count = np.empty(0), 0
    for count, sample in enumerate(samples, 1):
        one = beam_log_likelihood(
            sample, placed, judge, prior=prior, no_return=no_return, depth=depth
        )
        total = one if count == 1 else np.logaddexp(total, one)
    if count == 0:
        raise GridError('samples: expected at least one map')
    return np.asarray(total - np.log(count), np.float64)


def _log_likelihood(hits: FirstHits, z_m: Float64Array, log_density: LogDensity) -> Float64Array:
    per_beam = np.diff(hits.starts)
    with np.errstate(divide='ignore'):
        log_terms = np.log(hits.masses) + log_density(np.repeat(z_m, per_beam), hits.distances_m)
        log_rest = np.log(hits.survival) + log_density(z_m, np.full(z_m.shape, np.inf))
    sums = np.empty(z_m.size)
    segment_log_sums(log_terms, hits.starts, log_rest, sums)
    return sums
