"""Forward sensor models: p(z | f), the likelihood of a range given the first occupied cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.sensors.forward_model_kernels import (
    range_log_likelihood,
    range_log_likelihoods,
)

__all__ = ['PLAIN', 'ForwardModel', 'per_metre']

# What else than a `plain` model is told.
PLAIN = 'expected `beam` without short returns'


class ForwardModel(NamedTuple):
    """Numbers of one model, as kernels take them; make it with `from_config`.

    `gaussian`: z ~ N(d, sigma^2), d the distance of the first occupied cell ([gibbs] section
    III-B). A ray with nothing on it ends at its reach, and so does a reading without a return.

    `beam`: with d the distance of the first occupied cell and R the reach of the ray,
      p(z | d)         = hit N(z; d, sigma^2) / Phi(d / sigma) + clutter / R
                         + short * decay e^(-decay z) / (1 - e^(-decay d)) [z <= d]
      p(no return | d) = missing + hit (1 - Phi((R - d) / sigma)) / Phi(d / sigma)
    and with nothing on the ray the share of hits goes to "no return". Over all ranges in [0, R]
    and "no return" these sum to 1 (d = 0 leaves no range to short returns: they count for
    nothing there). Both are strictly positive everywhere.

    `depth` says where inside a cell a beam is reflected, as a share of its way through.
    """

    is_gaussian: bool
    sigma_m: float
    hit: float
    clutter: float
    missing: float
    short: float
    short_decay: float
    depth: float

    @classmethod
    def from_config(cls, config: ForwardModelConfig) -> ForwardModel:
        """Return the model a configuration describes."""
        return cls(
            config.kind == 'gaussian',
            config.sigma_m,
            1.0 - config.clutter - config.missing - config.short,
            float(config.clutter),
            float(config.missing),
            float(config.short),
            float(config.short_decay),
            float(config.depth),
        )

    @property
    def plain(self) -> bool:
        """Whether p(z) is a mixture of hits, clutter and missing returns, and of no more."""
        return not self.is_gaussian and self.short == 0.0

    def mixture(self, cells_per_m: float) -> tuple[float, float, float, float, float]:
        """Return depth, hit, clutter, missing and sigma in cells, as kernels take a plain one."""
        return self.depth, self.hit, self.clutter, self.missing, self.sigma_m * cells_per_m

    def log_likelihood(self, reading_m: float, reach_m: float, distance_m: float) -> float:
        """Nats; `reading_m` may be inf (no return), `distance_m` inf (nothing on the ray)."""
        return float(range_log_likelihood(self, reading_m, reach_m, distance_m))

    def log_density(
        self, readings_m: Float64Array, distances_m: Float64Array, reach_m: float
    ) -> Float64Array:
        """`log_likelihood` (N,), nats, of readings (N,) given distances (N,), with one reach."""
        log_p = np.empty(readings_m.size)
        range_log_likelihoods(self, readings_m, reach_m, distances_m, log_p)
        return log_p


def per_metre(ranges: Float64Array, reach: float, cells_per_m: float) -> float:
    """Return the nats that turn densities per cell into such per metre, summed over a scan.

    A range beyond the reach is no return, which has a probability and no density.
    """
    return float(np.count_nonzero(ranges <= reach)) * float(np.log(cells_per_m))
