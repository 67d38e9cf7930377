"""What scans from many views are expected to tell, fast enough to choose where to go.

The quantity is that of `expected_information_gain`: per beam, the mutual information between its
reading z and the map, I(f; z), f being the first occupied cell. Here f and z come in bins of one
cell, so that p(z | f) is one table for all beams, and a thousand beams are one matrix product.
p(f) comes from the probabilities of independent cells, or from samples, which know that the
cells of one wall are there together or not at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation.view_kernels import bin_hits, bin_sample_hits
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.geometry.sample_bits import WORD, SampleBits
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['ReadingChannel', 'hits_of_map', 'hits_of_samples']


class ReadingChannel(NamedTuple):
    """p(reading | where a beam ends) in bins of one cell; the last of each: nothing, no return.

    table      (F + 1, Z + 1) rows sum to 1; noise_nats (F + 1,) entropy of each row
    """

    table: Float64Array
    noise_nats: Float64Array
    reach_m: float
    depth: float

    @classmethod
    def of_model(cls, model: ForwardModel, reach_m: float, cell_m: float) -> ReadingChannel:
        """Tabulate a model: a beam that ends in a bin ends in its middle."""
        bins = bins_within(reach_m, cell_m)
        middles = (np.arange(bins) + 0.5) * cell_m
        readings = np.concatenate((middles[middles < reach_m], [np.inf]))
        z, f = np.meshgrid(readings, np.concatenate((middles, [np.inf])))
        table = np.exp(model.log_density(z.ravel(), f.ravel(), reach_m)).reshape(z.shape)
        table[:, :-1] *= cell_m
        table /= table.sum(axis=1, keepdims=True)
        return cls(table, _entropies(table), reach_m, model.depth)

    def information(self, hits: Float64Array) -> Float64Array:
        """Expected information (N,), nats, of beams that end by `hits` (N, F + 1)."""
        return np.maximum(_entropies(hits @ self.table) - hits @ self.noise_nats, 0.0)


def bins_within(reach_m: float, cell_m: float) -> int:
    """Return how many bins of one cell there are up to the far side of the last cell in reach."""
    return math.ceil(reach_m / cell_m) + 1


def hits_of_map(
    grid_map: GridMap,
    places: AnyArray,
    headings: AnyArray,
    channel: ReadingChannel,
    prior: float,
) -> Float64Array:
    """Return where beams (B,) from each place (V, 2), m, end: (V * B, F + 1), cells independent.

    Unknown cells and those outside are occupied with probability `prior`.
    """
    spec = grid_map.spec
    hits = _room(places, headings, channel)
    bin_hits(
        np.require(grid_map.probability, np.float32, ('C', 'W')),
        prior,
        spec.in_cells(places),
        np.asarray(headings, np.float64),
        channel.reach_m / spec.resolution_m,
        channel.depth,
        hits,
    )
    return hits


def hits_of_samples(
    bits: SampleBits,
    places: AnyArray,
    headings: AnyArray,
    channel: ReadingChannel,
    prior: float,
) -> Float64Array:
    """Return the same of map samples, 64 at most; cells not sampled are a chance each."""
    if not 1 <= bits.draws <= WORD:
        raise ConfigError(f'{bits.draws} map samples: expected 1 to {WORD}')
    spec = bits.spec
    hits = _room(places, headings, channel)
    bin_sample_hits(
        np.ascontiguousarray(bits.words[:, :, 0]),
        bits.known,
        bits.draws,
        prior,
        spec.in_cells(places),
        np.asarray(headings, np.float64),
        channel.reach_m / spec.resolution_m,
        channel.depth,
        hits,
    )
    return hits


def _room(places: AnyArray, headings: AnyArray, channel: ReadingChannel) -> Float64Array:
    return np.empty((len(places) * len(headings), len(channel.noise_nats)))


def _entropies(rows: Float64Array) -> Float64Array:
    """Entropy (N,) of each row, nats."""
    with np.errstate(divide='ignore', invalid='ignore'):
        terms = rows * np.log(rows)
    return np.asarray(-np.nansum(terms, axis=1), np.float64)
