"""Settings and recorded rays to a model that the sampler draws from: the one builder of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray
from ogm_mcmc.config import PatchConfig, PatchTableConfig, SamplerConfig
from ogm_mcmc.engine.prior_files import Prior, default_prior_file, load_prior
from ogm_mcmc.engine.progress import IndexSize
from ogm_mcmc.engine.warp import laid_on
from ogm_mcmc.errors import PriorError
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import GridSpec, PlacedScan
from ogm_mcmc.sampling import CellModel, GibbsState, PosteriorModel, RayWindow
from ogm_mcmc.sampling.first_hits import HitsBefore
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_prior import PatchTable, make_table
from ogm_mcmc.sampling.ray_window import Dropped

__all__ = [
    'Grown',
    'PatchPrior',
    'patch_prior',
    'posterior_model',
    'posterior_of',
    'size_of',
    'window_of',
]


class PatchPrior(NamedTuple):
    """The table of a patch prior, None for single independent cells.

    `occupied`: the probability of a cell of which nothing is known.
    """

    table: PatchTable | None
    occupied: float


class Grown(NamedTuple):
    """The chains of a window that changed: what they know need not be found again.

    dropped  what went; rays were added after that
    """

    model: PosteriorModel
    states: Sequence[GibbsState]
    spec: GridSpec
    dropped: Dropped | None = None

    def known(self, spec: GridSpec) -> tuple[BoolArray, AnyArray] | None:
        """Return what a model of the window as it is now need not find again."""
        found = self.model.found()
        if found is None:
            return None
        told, telling = found
        cells, there = told.view(np.uint8), self.spec
        if self.dropped is not None:
            _, staying, then, untold = self.dropped
            # First on the window as it was without them: beyond it nothing was told any more.
            cells, there = laid_on(cells, there, then, 0) & ~untold.reshape(-1), then
            telling = telling[staying]
        told = laid_on(cells, there, spec, 0).view(np.bool_)
        return told, telling

    def hits(self, window: RayWindow) -> list[HitsBefore]:
        """Return what rays that stayed hit first in each chain, for the window as it is now."""
        here, again = window.spec, window.said_more
        found = []
        for cells, records, *_ in self.states:
            if self.dropped is not None:
                records = records[self.dropped.staying]
            found.append(HitsBefore(cells, self.spec, records, here, again))
        return found


def patch_prior(config: SamplerConfig) -> PatchPrior:
    """Return the prior that the settings name; PriorError for a file that cannot be used."""
    return _patch_prior(config.patch, config.chain.prior, config.window.resolution)


def window_of(config: SamplerConfig) -> RayWindow:
    """Return a window without rays, as the posterior of these settings needs it."""
    margin, chains = config.patch.window_margin, config.chains_of_cells
    return RayWindow(config.window, config.model, margin=margin, merge=True, chains=chains)


def size_of(window: RayWindow, model: PosteriorModel | None) -> IndexSize:
    """Return how large the index of a window is, with what a model of it keeps of its rays."""
    index = window.index
    kept = model.zones.n_bytes if isinstance(model, CellModel) else 0
    return IndexSize(window.n_beams, index.n_pairs, index.n_bytes + kept, window.n_merged)


def posterior_model(
    config: SamplerConfig,
    window: RayWindow,
    table: PatchTable | None,
    *,
    everywhere: bool = False,
    grown_from: Grown | None = None,
) -> PosteriorModel:
    """Return the posterior of the rays of a window, single cells where there is no `table`.

    With `everywhere` patches are drawn on all of the window, as the papers do; without it only
    where readings can tell something. `grown_from`: see there.
    """
    chain, patch, width = config.chain, config.patch, window.spec.width
    if table is None:
        return CellModel(window.index, chain.prior_log_odds, width, chain.order)
    return PatchModel(
        window.index,
        width,
        table,
        order=patch.order,
        escape=patch.escape,
        random_share=patch.random_share,
        margin=None if everywhere else patch.margin,
        flip_cells=not everywhere and patch.random_share == 0.0,
        known=None if grown_from is None else grown_from.known(window.spec),
    )


def posterior_of(
    config: SamplerConfig, scans: Sequence[PlacedScan], table: PatchTable | None
) -> tuple[RayWindow, PosteriorModel]:
    """Return the rays of scans and their posterior, as `Refinement` has them, without chains.

    For settings of which nothing has to be found out, see `BeamsFound.as_given`; `table`:
    that of their `patch_prior`.
    """
    window = window_of(config)
    window.add(scans)
    return window, posterior_model(config, window, table)


@lru_cache(maxsize=4)
def _learned(path: Path, resolution_m: float) -> Prior:
    """Read a prior once, and so warn once that it was learned at another resolution."""
    return load_prior(path, resolution_m)


@lru_cache(maxsize=8)
def _patch_prior(patch: PatchConfig, cell_prior: float, resolution_m: float) -> PatchPrior:
    if patch.single_cells:
        return PatchPrior(None, cell_prior)
    if patch.prior == 'uniform':
        table = make_table('uniform', patch.size, p_occupied=cell_prior)
        return PatchPrior(table, cell_prior)
    config = PatchTableConfig(
        min_probability=patch.min_probability,
        strength=patch.strength,
        max_floor=patch.max_floor,
    )
    file = patch.prior_file
    path = user_path(file, 'patch.prior_file', PriorError) if file else default_prior_file()
    counts = _learned(path, resolution_m).counts
    share = float(counts.cells[1] / counts.cells.sum())
    table = make_table(patch.prior, patch.size, counts, config)
    return PatchPrior(table, share)
