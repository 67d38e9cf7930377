"""The maps of half a log that a localizer is given, and all ways to read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.config import ForwardModelConfig, MapperConfig, WindowConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.kept_samples import MOST_SAMPLES, KeptSamples
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowError
from ogm_mcmc.evaluation import (
    CastBeams,
    ForwardModel,
    LikelihoodField,
    SampleBeams,
)
from ogm_mcmc.evaluation.scan_fit import NAV2
from ogm_mcmc.geometry import GridMap, PlacedScan, SampleBits
from ogm_mcmc.mapping import ProbabilityBeams
from ogm_mcmc.simulation import ScanFit

__all__ = [
    'BURN_IN',
    'CHAINS',
    'FIT_MODEL',
    'MEAN',
    'MEAN_FIELD',
    'POWER',
    'PRODUCT',
    'READERS',
    'SAMPLES',
    'SWEEPS_BETWEEN',
    'THREE',
    'UNKNOWN',
    'Maps',
    'maps_of',
    'readers_of',
    'some_beams',
]

CHAINS, BURN_IN, SWEEPS_BETWEEN = 2, 60, 2

# Noise, poses and walls that are cells: what a localizer expects of a range.
FIT_MODEL = ForwardModelConfig(sigma=0.1)
POWER = 0.2

# A localizer's beam meets something in a cell that no map tells of. Chosen, as sigma and power, in
# building 3, which is in no result: 0.31, the share of occupied cells in the prior, loses readers
# of any map more often where little was measured, 0.01 does as well as this.
UNKNOWN = 0.05

FIELD, CAST = 'three values, likelihood_field of amcl', 'three values, beam of amcl'
PRODUCT = 'three values, likelihood_field_prob of amcl'
THREE, LIVE = 'three values, first hits', 'traditional probabilities, first hits'
MEAN_FIELD = 'border mean in three values, likelihood_field_prob'
MEAN, SAMPLES = 'border mean, first hits', 'border samples, beam by beam'
SCANS = 'border samples, whole scans'

READERS = (FIELD, CAST, PRODUCT, THREE, LIVE, MEAN_FIELD, MEAN, SAMPLES, SCANS)


class Maps(NamedTuple):
    """The traditional map, posterior mean and samples of the same beams; `prior` of a cell."""

    live: GridMap
    mean: GridMap
    bits: SampleBits
    prior: float


def some_beams(
    placed: Sequence[PlacedScan], share: float, rng: np.random.Generator
) -> list[PlacedScan]:
    """Keep a share of all beams, drawn at random."""
    kept = []
    for scan, belief in placed:
        chosen = rng.random(scan.ranges_m.size) < share
        ranges = np.where(chosen, scan.ranges_m, np.float32(np.nan))
        kept.append(PlacedScan(replace(scan, ranges_m=ranges), belief))
    return kept


def maps_of(placed: Sequence[PlacedScan], resolution_m: float, seed: int) -> Maps:
    """Map scans the traditional way, and sample their posterior as `~/refine` does.

    Two chains of 60 sweeps of burn-in and 64 more, of which every other one is kept. What no data
    moved is unknown in the mean and in the samples (`Refinement.known_map`). Cells of a wall of
    which it is not certain which are occupied stay: without them walls have gaps.
    """
    config = RefineSamplerConfig(window=WindowConfig(resolution=resolution_m))
    chain = replace(config.chain, chains=CHAINS, burn_in=BURN_IN, seed=seed)
    config = replace(config, chain=chain)
    refinement, kept = Refinement(config), KeptSamples()
    refinement.take(placed)
    sampler = refinement.sampler
    assert sampler is not None
    sampler.advance(BURN_IN)
    for _ in range(MOST_SAMPLES // len(sampler.states)):
        sampler.advance(SWEEPS_BETWEEN)
        kept.add(sampler)
    bits = kept.bits(sampler, refinement.window.spec)
    if bits is None:
        raise WindowError('no map sample was kept: expected chains that sweep')
    live = map_of(placed, MapperConfig(resolution=resolution_m))
    mean = refinement.known_map()
    return Maps(live, mean, bits.known_in(mean), refinement.prior)


def readers_of(maps: Maps) -> dict[str, tuple[ScanFit, float]]:
    """Return what weighs poses in each way, and the power at which a filter takes it."""
    model, prior = ForwardModel.from_config(FIT_MODEL), UNKNOWN
    return {
        FIELD: (LikelihoodField(maps.live), 1.0),
        CAST: (CastBeams(maps.live), 1.0),
        THREE: (ProbabilityBeams(_three_values(maps.live), model, prior), POWER),
        LIVE: (ProbabilityBeams(maps.live, model, prior), POWER),
        PRODUCT: (LikelihoodField(maps.live, product=True), POWER),
        MEAN_FIELD: (LikelihoodField(maps.mean, product=True), POWER),
        MEAN: (ProbabilityBeams(maps.mean, model, prior), POWER),
        SAMPLES: (SampleBeams(maps.bits, model, prior), POWER),
        SCANS: (SampleBeams(maps.bits, model, prior, jointly=True, power=POWER), 1.0),
    }


def _three_values(grid_map: GridMap) -> GridMap:
    """Return 1, 0 and nan where nav2 has occupied, free and unknown cells."""
    known = np.nan_to_num(grid_map.probability, nan=0.5)
    values = np.full(known.shape, np.nan, np.float32)
    values[known <= NAV2.free] = 0.0
    values[known >= NAV2.occupied] = 1.0
    return GridMap(grid_map.spec, values)
