"""How well a scan fits at many poses in a map: what a localizer can do with what a map offers.

Readers of maps, each a `ScanFit` of `ParticleFilter` (`ProbabilityBeams` is in `mapping`):

========================  =================================================================
`LikelihoodField`         three values; how far each beam's end is from a wall
`CastBeams`               three values; how far each range is from the one cast in the map
`ProbabilityBeams`        probabilities; each range from the mixture of where it may end first
`SampleBeams`             samples; that mixture with what neighbouring cells know of each other
========================  =================================================================

The first two are the sensor models of amcl, written anew from what it does and with nav2's
defaults: unknown cells are no walls to the field, and end a ray; a particle's weight is 1 plus
the sum of p^3 over the beams, which is no product of likelihoods but says less, on purpose. With
`product` the field is its `likelihood_field_prob`, the product. Casts here are exact where amcl
steps with Bresenham's line.

The other two take the `beam` model without short returns: p(z) is the sum over cells f of
p(f first) p(z | f), and that of a scan the product over its beams. Beams are no independent
witnesses: what is made of that is the filter's business (`ParticleFilterSettings.power`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array, UInt8Array
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation.distance import distance_to
from ogm_mcmc.evaluation.scan_fit_kernels import cast_fits, field_fits, sample_fits
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.geometry.sample_bits import WORD, SampleBits
from ogm_mcmc.sensors.forward_model import PLAIN, ForwardModel, per_metre

__all__ = ['AmclNumbers', 'CastBeams', 'LikelihoodField', 'SampleBeams']


class AmclNumbers(NamedTuple):
    """Shares of the mixture, sigma and largest distance, m, decay, 1/m: nav2's defaults.

    Occupied from `occupied` on, free up to `free`, unknown between, as nav2's map server reads.
    """

    hit: float = 0.5
    short: float = 0.05
    missing: float = 0.05
    clutter: float = 0.5
    sigma_m: float = 0.2
    decay: float = 0.1
    furthest_m: float = 2.0
    occupied: float = 0.65
    free: float = 0.25


NAV2 = AmclNumbers()


@dataclass(frozen=True)
class LikelihoodField:
    """amcl's `likelihood_field`: an end near a wall is likely, whatever lies before it."""

    grid_map: GridMap
    numbers: AmclNumbers = NAV2
    product: bool = False
    distances: Float32Array = field(init=False)
    """(height, width), cells: to the nearest occupied cell, `furthest_m` at most."""

    def __post_init__(self) -> None:
        """Measure the distances."""
        probability = self.grid_map.probability
        walls = np.nan_to_num(probability, nan=0.0) >= self.numbers.occupied
        furthest = self.numbers.furthest_m / self.grid_map.spec.resolution_m
        distances = np.minimum(distance_to(walls), furthest).astype(np.float32)
        object.__setattr__(self, 'distances', distances)

    def log_likelihoods(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> Float64Array:
        """Logarithms of amcl's weights (M,), see `ScanFit`."""
        spec, n = self.grid_map.spec, self.numbers
        cells = 1.0 / spec.resolution_m
        log_p = np.empty(len(poses))
        field_fits(
            self.distances,
            *spec.scan_in_cells(poses, bearings, ranges, reach),
            n.hit,
            # per metre there, per cell here
            n.clutter * cells,
            n.sigma_m * cells,
            n.furthest_m * cells,
            self.product,
            log_p,
        )
        return log_p


@dataclass(frozen=True)
class CastBeams:
    """amcl's `beam`: ranges around those cast to the first cell that is not free."""

    grid_map: GridMap
    numbers: AmclNumbers = NAV2
    blocked: UInt8Array = field(init=False)
    """(height, width): what is not free, unknown cells too."""

    def __post_init__(self) -> None:
        """Look which cells end a ray."""
        free = np.nan_to_num(self.grid_map.probability, nan=1.0) <= self.numbers.free
        object.__setattr__(self, 'blocked', (~free).astype(np.uint8))

    def log_likelihoods(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> Float64Array:
        """Logarithms of amcl's weights (M,), see `ScanFit`."""
        spec, n = self.grid_map.spec, self.numbers
        cells = 1.0 / spec.resolution_m
        log_p = np.empty(len(poses))
        cast_fits(
            self.blocked,
            *spec.scan_in_cells(poses, bearings, ranges, reach),
            n.hit,
            n.short * cells,
            n.missing,
            n.clutter * cells,
            n.sigma_m * cells,
            n.decay / cells,
            log_p,
        )
        return log_p


@dataclass(frozen=True)
class SampleBeams:
    """First-hit mixture over maps drawn from the posterior, 64 at most.

    Beam by beam the samples are mixed anew. `jointly`, one map has to explain the whole scan:
    log of the mean over samples of p(scan | sample)^power; a filter then takes power 1.
    """

    bits: SampleBits
    model: ForwardModel
    prior: float
    jointly: bool = False
    power: float = 1.0

    def __post_init__(self) -> None:
        """Refuse models with another mixture, and more samples than a word has bits."""
        if not self.model.plain:
            raise ConfigError(f'model: {PLAIN}')
        if not 1 <= self.bits.draws <= WORD:
            raise ConfigError(f'{self.bits.draws} map samples: expected 1 to {WORD}')

    def log_likelihoods(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> Float64Array:
        """Sums over beams (M,), nats, or of the whole scan by `power`; see `ScanFit`."""
        spec = self.bits.spec
        cells = 1.0 / spec.resolution_m
        log_p = np.empty(len(poses))
        sample_fits(
            np.ascontiguousarray(self.bits.words[:, :, 0]),
            self.bits.known,
            self.bits.draws,
            self.prior,
            self.jointly,
            self.power,
            *spec.scan_in_cells(poses, bearings, ranges, reach),
            *self.model.mixture(cells),
            log_p,
        )
        power = self.power if self.jointly else 1.0
        return log_p + power * per_metre(ranges, reach, cells)
