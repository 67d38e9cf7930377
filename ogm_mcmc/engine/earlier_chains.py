"""What chains leave to those that go on with other scans, without the index they drew with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.engine.warp import laid_on
from ogm_mcmc.engine.window_changes import taken_before
from ogm_mcmc.geometry import GridSpec, PlacedScan
from ogm_mcmc.sampling import PosteriorSampler

__all__ = ['EarlierChains']


class EarlierChains(NamedTuple):
    """Maps (K,) of chains on a window, their generators, and whether they had counted sweeps.

    elsewhere  what a cell that no chain has drawn yet begins as
    """

    maps: list[UInt8Array]
    spec: GridSpec
    elsewhere: int
    rngs: list[np.random.Generator]
    counted: bool

    @classmethod
    def of(
        cls, sampler: PosteriorSampler | None, spec: GridSpec, prior: float
    ) -> EarlierChains | None:
        """Return what chains of a window leave, if there are any; nothing holds the sampler.

        Cells that no chain has drawn yet begin as the prior has it. The solid that surrounds
        patches would not do: from a block a ray has to pass chains wear off the rim only.
        """
        if sampler is None:
            return None
        elsewhere, touched, maps = int(prior >= 0.5), sampler.model.touched, []
        for own in sampler.maps():
            cells = np.full_like(own, elsewhere)
            cells[touched] = own[touched]
            maps.append(cells)
        return cls(maps, spec, elsewhere, sampler.rngs, sampler.counted > 0)

    def maps_on(self, spec: GridSpec) -> list[UInt8Array]:
        """Return the maps (K,) where their cells are on another window of the lattice."""
        return [laid_on(cells, self.spec, spec, self.elsewhere) for cells in self.maps]

    def know(self, taken: Sequence[PlacedScan], scans: Sequence[PlacedScan]) -> bool:
        """Return whether sweeps counted, with all but a tenth of these scans among those taken."""
        new = taken_before(taken, scans).count(None)
        return self.counted and 10 * new <= len(scans)
