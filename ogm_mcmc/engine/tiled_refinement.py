"""A refinement whose window no process holds as a whole; see `ogm_mcmc.sampling.tiles`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Protocol

from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.engine.posterior import Grown
from ogm_mcmc.engine.progress import IndexSize, nothing_said
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.window_changes import WindowChange
from ogm_mcmc.errors import ConfigError, WindowError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.sampling import PosteriorModel, RayWindow
from ogm_mcmc.sampling.patch_prior import PatchTable
from ogm_mcmc.sampling.tile_gibbs import TileReport, TileSampler
from ogm_mcmc.sampling.tile_index import arrivals, batch_of
from ogm_mcmc.sampling.tiled_model import TiledModel, TilePrior, Tiles
from ogm_mcmc.sampling.tiles import Tiling, tiling_of

__all__ = ['Held', 'Holders', 'TiledRefinement', 'tile_sampler']


class Held(NamedTuple):
    """Tiles that are held somewhere, and what they say of themselves, in order."""

    tiles: Tiles
    reports: Sequence[TileReport]


class Holders(Protocol):
    """Processes that hold tiles; settings name the numbers of the sensor, nothing is fitted."""

    def hold(self, config: SamplerConfig, scans: Sequence[PlacedScan], tiling: Tiling) -> Held:
        """Let each tile be held by one of them."""
        ...


def tile_sampler(
    config: SamplerConfig,
    table: PatchTable | None,
    scans: Sequence[PlacedScan],
    tiling: Tiling,
    tile: int,
) -> TileSampler:
    """Return what holds a tile, with the `table` of the `patch_prior` of the settings.

    Raises WindowError where it takes too much memory.
    """
    return TileSampler(scans, config.window, config.model, table, tiling, tile)


class TiledRefinement(Refinement):
    """A refinement in `columns` x `rows` tiles. All scans are indexed anew when some come in.

    What is here: the map of every chain, its counts, the scans, and some 30 bytes a ray.
    """

    def __init__(self, config: SamplerConfig, columns: int, rows: int, holders: Holders) -> None:
        super().__init__(config)
        patch = config.patch
        if patch.order != 'tiled':
            raise ConfigError(
                f'patch.order is {patch.order}: expected tiled where the map is in tiles'
            )
        if patch.random_share > 0.0:
            raise ConfigError(
                f'patch.random_share is {patch.random_share:g}: expected 0 where the map is in '
                'tiles'
            )
        self._shape, self._holders = (columns, rows), holders
        self._model: TiledModel | None = None
        self._size = IndexSize(0, 0, 0)

    def _indexed(
        self, scans: Sequence[PlacedScan], change: WindowChange | None
    ) -> tuple[RayWindow, None]:
        """Let the rays of scans be held; what is returned has none, and says where cells lie."""
        window = self._empty_window()
        size = window.sum_of_sizes(scans)
        if size.rays == 0:
            raise WindowError(nothing_said(len(scans), window.config.max_range))
        window.spec = window.spec.windowed(size.box)
        side = 0 if self._table is None else self._table.side
        tiling = tiling_of(window.spec, *self._shape, side)
        given = self.beams.as_given(self.config)
        patch, chain = given.patch, given.chain
        n_chains = given.chains_for(size.rays)
        self._index_spent = True  # the tiles of before are held no longer
        held = self._holders.hold(given, scans, tiling)
        prior = TilePrior(chain.prior_log_odds, chain.order, side, patch.margin, patch.escape)
        batch = batch_of(scans, given.window, given.model)
        arrive = partial(arrivals, batch, given.model, tiling.spec)
        self._model = TiledModel(tiling, held.reports, held.tiles, prior, arrive)
        self._size = IndexSize(
            size.rays,
            sum(report.n_pairs for report in held.reports),
            sum(report.n_bytes + n_chains * report.n_bytes_of_chain for report in held.reports),
            size.rays - self._model.summaries.n_rays,
        )
        return window, None

    @property
    def size(self) -> IndexSize:
        """How large the parts of the index are together, and what tiles keep of all chains."""
        return self._size

    def _n_rays(self, window: RayWindow) -> int:
        return self._size.n_rays

    @property
    def tiled(self) -> TiledModel:
        """The posterior that is sampled."""
        if self._model is None:
            raise WindowError('no scan was taken: nothing to sample')
        return self._model

    def _take_nothing(self) -> None:
        super()._take_nothing()
        self._model, self._size = None, IndexSize(0, 0, 0)

    def _posterior(self, window: RayWindow, grown: Grown | None) -> PosteriorModel:
        return self.tiled
