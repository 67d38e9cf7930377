"""What all methods with one log-odds per cell share."""

from __future__ import annotations

import math

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, GridSpec
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid

__all__ = ['NOTHING', 'LogOddsMapper']

NOTHING = CellBox(0, 0, 0, 0)


class LogOddsMapper:
    """A dense grid of log-odds; subclasses say what a scan adds."""

    def __init__(self, config: MapperConfig) -> None:
        self.grid = LogOddsGrid(config.resolution, config.max_cells)
        self.configure(config)

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; the ones that are fixed at start are as before."""
        self.config = config
        # Kernels see float32 only, so that each has one signature.
        self._prior = np.float32(math.log(config.prior) - math.log1p(-config.prior))
        self._limit = np.float32(config.log_odds_limit)

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie."""
        return self.grid.spec

    def log_odds(self, box: CellBox) -> Float32Array:
        """Log-odds in nats for each cell of a box, nan where never measured; a view."""
        return self.grid.log_odds[self.grid.spec.slices(box)]

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied; see `MappingMethod.probabilities`."""
        with np.errstate(over='ignore'):
            odds_against = np.exp(-self.log_odds(box))
        probability: Float32Array = np.float32(1.0) / (np.float32(1.0) + odds_against)
        return probability

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        self.grid.clear()

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        self.grid.log_odds.fill(np.nan)
