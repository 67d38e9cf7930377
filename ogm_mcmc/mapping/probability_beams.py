"""The first-hit mixture of a map's probabilities: how well a scan fits at many poses.

p(z) is the sum over cells f of p(f first) p(z | f), and that of a scan the product over its
beams. Beams are no independent witnesses: whoever asks takes a power of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.mapping.probability_beams_kernels import probability_fits
from ogm_mcmc.sensors import ForwardModel
from ogm_mcmc.sensors.forward_model import PLAIN, per_metre

__all__ = ['ProbabilityBeams']


@dataclass(frozen=True)
class ProbabilityBeams:
    """First-hit mixture of independent cells, beam by beam, at many poses.

    Cells that are unknown or lie outside are occupied with probability `prior`.
    """

    grid_map: GridMap
    model: ForwardModel
    prior: float

    def __post_init__(self) -> None:
        """Refuse models with another mixture."""
        if not self.model.plain:
            raise ConfigError(f'model: {PLAIN}')

    def log_likelihoods(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> Float64Array:
        """Sums over beams (M,), nats, at poses (M, 3); bearings (B,) rad, ranges (B,) m."""
        spec = self.grid_map.spec
        cells = 1.0 / spec.resolution_m
        log_p = np.empty(len(poses))
        probability_fits(
            np.require(self.grid_map.probability, np.float32, ('C', 'W')),
            self.prior,
            *spec.scan_in_cells(poses, bearings, ranges, reach),
            *self.model.mixture(cells),
            log_p,
        )
        return log_p + per_metre(ranges, reach, cells)
