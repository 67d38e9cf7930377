"""Where a scan is expected to tell most: by the traditional map, the posterior mean, samples.

Beams of one scan cross the same cells near the sensor, so the sum over beams that is compared is
an upper bound, for all policies alike. A place is worth its nats over the way there, as a
frontier is worth its cells: `PATIENCE_M` is added to each way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig, WindowConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.kept_samples import KeptSamples
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.evaluation import ForwardModel, ReadingChannel, hits_of_map, hits_of_samples
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan
from ogm_mcmc.mapping import make_method

__all__ = ['POLICIES', 'Explorer', 'border_map']

FRONTIER, LIVE, MEAN, SAMPLES = 'frontier', 'traditional map', 'mean of maps', 'samples'
POLICIES = (FRONTIER, LIVE, MEAN, SAMPLES)

PLACES, BEAMS, PATIENCE_M = 100, 48, 4.0

# Nothing is worth going for that tells less; all policies end so, or after the last metre.
WORTHLESS_NATS = 1.0

# Of cells never measured, in every map: one that takes walls for rare expects a beam to go far.
UNKNOWN = 0.05

# Sweeps of each chain after a scan, on from the maps it had; of the kept ones, one a sweep.
SETTLING, KEPT = 4, 8

# Sweeps of the map that judges at the end.
CHAINS, BURN_IN, COUNTED = 2, 40, 40


class Explorer:
    """Maps what a robot measures and chooses where it goes next, by one of `POLICIES`."""

    def __init__(
        self,
        policy: str,
        world: GridSpec,
        model: ForwardModelConfig,
        reach_m: float,
        rng: np.random.Generator,
        chain_seed: int,
    ) -> None:
        self.policy, self.world, self.rng = policy, world, rng
        forward = ForwardModel.from_config(model)
        self.channel = ReadingChannel.of_model(forward, reach_m, world.resolution_m)
        self._scans: list[PlacedScan] = []
        self._live = make_method(MapperConfig(resolution=world.resolution_m))
        self._refinement = Refinement(
            sampler_config(model, world.resolution_m, chain_seed, SETTLING)
        )

    def take(self, placed: PlacedScan) -> None:
        """Remember a scan."""
        self._scans.append(placed)
        self._live.update(placed)

    def choose(self, distances: AnyArray) -> tuple[int, int] | None:
        """Return the cell in reach, of a hundred at random, where a scan tells most for its way.

        distances  (height, width) steps over cells of the world, -1 where there is no way
        """
        reached = np.flatnonzero(distances > 0)
        if reached.size == 0:
            return None
        cells = self.rng.choice(reached, min(PLACES, reached.size), replace=False)
        rows, columns = np.divmod(cells, self.world.width)
        origin = (self.world.origin_x_m, self.world.origin_y_m)
        places = (np.column_stack((columns, rows)) + 0.5) * self.world.resolution_m + origin
        nats = self.information(places)
        if nats.max() < WORTHLESS_NATS:
            return None
        ways_m = distances.reshape(-1)[cells] * self.world.resolution_m
        best = int(np.argmax(nats / (ways_m + PATIENCE_M)))
        return int(columns[best]), int(rows[best])

    def information(self, places: Float64Array) -> Float64Array:
        """Nats (V,) that a scan from each place (V, 2), m, is expected to tell."""
        headings = np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
        if self.policy == LIVE:
            spec = self._live.spec
            live = GridMap(spec, self._live.probabilities(spec.box))
            hits = hits_of_map(live, places, headings, self.channel, UNKNOWN)
        else:
            self._refinement.take(self._scans)
            sampler, kept = self._refinement.sampler, KeptSamples()
            assert sampler is not None
            sampler.advance(SETTLING)
            for _ in range(KEPT):
                sampler.advance(1)
                kept.add(sampler)
            known = self._refinement.known_map()
            if self.policy == MEAN:
                hits = hits_of_map(known, places, headings, self.channel, UNKNOWN)
            else:
                bits = kept.bits(sampler, known.spec)
                assert bits is not None
                bits = bits.known_in(known)
                hits = hits_of_samples(bits, places, headings, self.channel, UNKNOWN)
        nats: Float64Array = self.channel.information(hits).reshape(len(places), BEAMS).sum(axis=1)
        return nats


def sampler_config(
    model: ForwardModelConfig, resolution_m: float, seed: int, burn_in: int
) -> RefineSamplerConfig:
    """Return what `~/refine` samples by, with a sensor that is known."""
    config = RefineSamplerConfig(model=model, window=WindowConfig(resolution=resolution_m))
    chain = replace(config.chain, chains=CHAINS, sensor='given', burn_in=burn_in, seed=seed)
    return replace(config, chain=chain)


def border_map(
    scans: Sequence[PlacedScan], model: ForwardModelConfig, resolution_m: float, seed: int
) -> GridMap:
    """Return the posterior mean of all scans, from chains of its own."""
    refinement = Refinement(sampler_config(model, resolution_m, seed, BURN_IN))
    refinement.take(scans)
    assert refinement.sampler is not None
    refinement.sampler.advance(BURN_IN + COUNTED)
    return refinement.map()
