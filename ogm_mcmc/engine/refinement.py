"""Placed scans in, converging posterior mean out: what `refine_server` and `sample` run.

PlacedScan ---> Recording ---snapshot---> Refinement.take(scans)
|  RayWindow (which rays touch which cell)
|  live map (where one chain starts)
v
GridMap <--- posterior mean <--- PosteriorSampler.advance(sweeps) ... until a limit
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float32Array
from ogm_mcmc.config import SamplerConfig, StopConfig, flatten
from ogm_mcmc.engine.beams_found import BeamsFound, alike
from ogm_mcmc.engine.completed_map import Beside
from ogm_mcmc.engine.earlier_chains import EarlierChains
from ogm_mcmc.engine.fingerprint import fingerprint
from ogm_mcmc.engine.grazing import filled_in_part
from ogm_mcmc.engine.live_map import (
    cells_on,
    check_lattice,
    first_maps,
    live_map,
    reflection_map,
)
from ogm_mcmc.engine.no_returns import no_return_of
from ogm_mcmc.engine.posterior import Grown, patch_prior, posterior_model, size_of, window_of
from ogm_mcmc.engine.progress import IndexSize, Progress, nothing_said
from ogm_mcmc.engine.range_spread import blur_of
from ogm_mcmc.engine.sampling_rounds import SamplingRounds
from ogm_mcmc.engine.saved_chains import (
    FINGERPRINT,
    FOUND,
    load_chains,
    require_saved,
    save_chains,
    saved_settings,
)
from ogm_mcmc.engine.warp import moved_cells
from ogm_mcmc.engine.window_changes import WindowChange
from ogm_mcmc.errors import WindowError, WindowFullError
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.sampling import ChainQuality, PosteriorModel, PosteriorSampler, RayWindow
from ogm_mcmc.sampling.chain_starts import forgotten
from ogm_mcmc.sampling.informed import known_cells
from ogm_mcmc.sampling.posterior import ARRIVES, Estimate
from ogm_mcmc.sampling.ray_window import Dropped

__all__ = ['Refinement']

# So many sweeps at most, enough to see what moves, where at most a tenth of the scans are new,
# be they placed anew or not: a map that is right soon matters more then.
WARM_BURN_IN = 16


class Refinement:
    """The posterior of a set of scans, sampled for as long as there is time.

    Deterministic for a seed: how long a round takes changes when it stops, never what it draws.
    `prior` is the probability of being occupied of a cell of which nothing is known.
    """

    def __init__(self, config: SamplerConfig) -> None:
        self.config = config
        self._taken: list[PlacedScan] = []
        self.corrected = False  # whether scans were placed anew when they were last taken
        # Whether what is indexed, if anything, is no longer that of the chains.
        self._index_spent = False
        self.beams = BeamsFound.of_none(config)
        self.beams_found = self.beams  # in the last scans, even if these were refused
        self.window = self._empty_window()
        self._table, self.prior = patch_prior(config)
        self.sampler: PosteriorSampler | None = None
        self.rounds = SamplingRounds()
        # The live map where it was made for chains to begin at; on the window it is beside what
        # cells reflected, once a map is asked for.
        self._live: GridMap | None = None
        self._others: Beside | None = None

    # -- scans in ---------------------------------------------------------------------------

    def take(
        self, scans: Sequence[PlacedScan], start: GridMap | None = None, whole: bool = False
    ) -> int:
        """Use these scans from now on; return the number of rays.

        Scans added since the last time extend the rays already indexed, those that went are taken
        out of them; where most went, or came in between, all are indexed anew, also when all scans
        together say that +inf means another thing, or when as many came as had told what the
        sensor is like, and tell of another one. Chains begin at `start`; without it they go on
        from where they are (where scans were placed anew they begin anew there), and the first
        ones begin as the configuration says. Raises WindowError when there is nothing to sample,
        WindowFullError when it is too much (also without grazing that was found, unless `whole`),
        GridError when `start` is of another lattice. After an error all is as before; where the
        index had changed already nothing is taken, and the next take begins.
        """
        if not scans:
            raise WindowError('no scan was recorded: expected at least one')
        if start is not None:
            check_lattice(self.window.spec, start)
        change = WindowChange.between(self._taken, scans)
        old, before = self.window.spec, self.beams
        asked = self.config.window
        found = no_return_of(asked.no_return, scans, asked.resolution, asked.max_range)
        grows = change.small and found.value == before.no_return.value
        self.beams_found = self.beams_found._replace(no_return=found)
        self._index_spent, self._live = False, None
        try:
            beams = before._replace(no_return=found)
            beams = beams.renewed(scans, len(change.new), self.config, grows=grows)
            self.beams = self.beams_found = beams
            grows = grows and beams.model == before.model
            earlier = EarlierChains.of(self.sampler, self.window.spec, self.config.chain.prior)
            on = self.sampler if grows else None
            try:
                window, dropped = self._indexed(scans, change if grows else None)
            except WindowFullError:
                plain = beams.without_grazing(self.config.model)
                if plain is None or whole:
                    raise
                self.beams, on = plain, None
                window, dropped = self._indexed(scans, None)
            moved = None if change.extends else moved_cells(window.spec, self._taken, scans)
            grown = None if on is None else Grown(on.model, on.states, old, dropped)
            as_before = alike(self.beams.model, before.model)
            if moved is not None and not as_before:
                # Wrong poses told of a wrong sensor: no chain has been where it should be.
                moved = np.ones_like(moved)
            as_before = as_before or moved is not None
            same = found.value == before.no_return.value and as_before
            known = earlier is not None and earlier.know(self._taken, scans)
            soon = same and start is None and known
            sampler = self._begun(window, scans, start, (earlier, moved, soon), grown)
        except BaseException:
            self.beams, self._live = before, None
            if self._index_spent:
                self._take_nothing()
            raise
        self.window, self._taken, self.corrected = window, list(scans), moved is not None
        self.sampler, self.rounds, self._others = sampler, SamplingRounds(), None
        return self.size.n_rays

    def _take_nothing(self) -> None:
        """Hold no scan and no chain, as in the beginning."""
        self.window, self._taken = self._empty_window(), []
        self.sampler, self.rounds = None, SamplingRounds()

    def _indexed(
        self, scans: Sequence[PlacedScan], change: WindowChange | None
    ) -> tuple[RayWindow, Dropped | None]:
        """Return the rays of scans, and what went: all but a `change` are indexed.

        Without one all are indexed anew, and what was before is let go, once it is known that
        there is room: an index may be most of the memory.
        """
        window, dropped = self._empty_window() if change is None else self.window, None
        if change is None:
            window.add(scans, self._let_go)
        else:
            if change.gone:
                self._index_spent = True
                dropped = window.drop(change.gone)
            window.add([*(dropped.again if dropped else []), *change.new])
            self._index_spent = True
        if not window.index.telling.any():
            raise WindowError(nothing_said(len(scans), window.config.max_range))
        return window, dropped

    def _let_go(self) -> None:
        """Hold the index no longer, nor the chains, which do; scans are still those taken."""
        self.window, self.sampler, self._index_spent = self._empty_window(), None, True

    @property
    def size(self) -> IndexSize:
        """How large the index of the window is."""
        return size_of(self.window, None if self.sampler is None else self.sampler.model)

    def _n_rays(self, window: RayWindow) -> int:
        return window.n_beams

    def _posterior(self, window: RayWindow, grown: Grown | None) -> PosteriorModel:
        return posterior_model(self.config, window, self._table, grown_from=grown)

    def _decided(self) -> SamplerConfig:
        """Return the settings with what no return was found to mean."""
        return self.beams.in_settings(self.config)

    def _empty_window(self) -> RayWindow:
        return window_of(replace(self._decided(), model=self.beams.model))

    def _begun(
        self,
        window: RayWindow,
        scans: Sequence[PlacedScan],
        start: GridMap | None,
        warm: tuple[EarlierChains | None, BoolArray | None, bool],
        grown: Grown | None,
    ) -> PosteriorSampler:
        """Return chains on a window of scans, where they begin.

        warm  chains that go on, if any; where (K,) scans were placed anew; a short burn-in
        """
        chain, spec = self.config.chain, window.spec
        model = self._posterior(window, grown)
        earlier, moved, soon = warm
        n_chains = self.config.chains_for(self._n_rays(window))
        starts = [] if earlier is None or start is not None else earlier.maps_on(spec)[:n_chains]
        # Chains that began alike agree whether or not they have forgotten it.
        # Those that are forgotten are as far apart of whatever kind they are.
        forget = self._table is not None
        apart = start is None and not starts and (forget or chain.start == 'dispersed')
        if start is not None:
            starts = [cells_on(spec, start, chain.start_threshold, chain.prior)] * n_chains
        elif not starts or moved is not None:
            self._live = live_map(scans, self._decided().window)
            fresh = first_maps(self._live, self._decided(), spec, len(starts) or n_chains)
            only = moved if starts else None
            if only is not None:
                fresh = [np.where(only, a, b) for a, b in zip(fresh, starts, strict=True)]
            starts = fresh
            if forget:
                ended = cells_on(spec, self._live, 0.5, 0.0) == 1
                starts = forgotten(model, starts, chain.seed, only, ended)
        burn_in = min(chain.burn_in, WARM_BURN_IN) if soon else chain.burn_in
        goes_on = start is None and moved is None
        hits = grown.hits(window) if grown is not None and goes_on else []
        sampler = PosteriorSampler(
            model, starts, seed=chain.seed, burn_in=burn_in, may_end=apart, hits=hits
        )
        if earlier is not None:
            # From the seed, chains would repeat the numbers that brought them where they are. The
            # generators are in a saved state, too: chains taken up again draw the same from here.
            sampler.rngs[: len(earlier.rngs)] = earlier.rngs[: len(starts)]
        return sampler

    # -- sampling ---------------------------------------------------------------------------

    def run(
        self, stop: StopConfig, cancelled: Callable[[], bool] = lambda: False
    ) -> Iterator[Progress]:
        """Sample until a limit is reached; yield after each round of about 0.1 s.

        The last progress carries the reason: `sweeps`, `time`, `converged` or `cancelled`.
        Raises ConfigError at once when the limits contradict each other.
        """
        if self.sampler is None:
            raise WindowError('no scan was taken: nothing to sample')
        return self.rounds.run(self.sampler, stop, cancelled)

    @property
    def quality(self) -> ChainQuality | None:
        """How well the chains agreed when they were judged last, on the informed cells."""
        return self.rounds.quality

    # -- to disk and back -------------------------------------------------------------------

    def holds(self, scans: Sequence[PlacedScan]) -> bool:
        """Whether exactly these scans are being sampled: `run` then simply goes on."""
        return len(scans) == len(self._taken) > 0 and all(map(operator.is_, scans, self._taken))

    def save(self, path: Path) -> None:
        """Write the chains, so that `resume` goes on as if nothing had happened.

        Stored are every chain's map, counts and generator, the number of sweeps, the settings
        and a fingerprint of the scans; not the scans themselves. Raises OutputError.
        """
        if self.sampler is None:
            raise WindowError('nothing was sampled yet: no state to save')
        with replacing(path) as temporary:
            found = {**self._identity(), FOUND: self.beams.as_dict()}
            save_chains(self.sampler, temporary, found)

    def resume(self, path: Path) -> None:
        """Go on from a saved state instead of the start that `take` made.

        What its beams were found to be like holds, too: a window that grew keeps what its first
        scans told. Raises WindowError when the file is no such file, or was written for other
        scans or settings. After an error everything is as before; where the index had changed
        already nothing is taken any more, as after an error of `take`.
        """
        if self.sampler is None:
            raise WindowError('no scan was taken: take those of the saved state first')
        accept = partial(require_saved, path, self._identity())
        saved = saved_settings(path)
        accept(saved)
        before, self._index_spent = self.beams, False
        try:
            self.beams = before.saved(path, saved.get(FOUND), self.config.model, len(self._taken))
            if self.beams.model != before.model:
                self.window, _ = self._indexed(self._taken, None)
                posterior = self._posterior(self.window, None)
            else:
                posterior = self.sampler.model
            sampler, _ = load_chains(path, posterior, accept)
        except BaseException:
            self.beams = before
            if self._index_spent:
                self._take_nothing()
            raise
        self.sampler, self.rounds = sampler, SamplingRounds()

    def _identity(self) -> dict[str, Any]:
        return {FINGERPRINT: fingerprint(self._taken), **self.settings()}

    # -- maps out ---------------------------------------------------------------------------

    def map(self, of: Estimate | None = None) -> GridMap:
        """Return the probabilities on the window, nan where no ray ever came.

        The mean of draws, sure cells with some of their neighbours, the live map as one more, the
        share of beams that cells reflected with its weight, and at least what that share is of
        many beams: see `Beside.completed`. `of` draws of the burn-in as of those that count.
        """
        of, cell_m = of or self._sampled().estimate(), self.config.window.resolution
        blur, chain = blur_of(self.beams.model.sigma_m, cell_m), self.config.chain
        sensor = self.beams.sensor
        in_part = filled_in_part(None if sensor is None else sensor.grazing, blur, cell_m)
        return self._beside().completed(self.drawn_map(of), of.draws, chain, blur, in_part)

    def drawn_map(self, of: Estimate | None = None) -> GridMap:
        """Return the mean of the draws alone on the window, nan where no ray ever came."""
        return self.grid_map((of or self._sampled().estimate()).mean)

    @property
    def guess(self) -> GridMap:
        """The live map on the window, nan where no ray ever came: who shows draws has it too."""
        return self._beside().live

    def _beside(self) -> Beside:
        """Return the live map on the window, and what cells reflected where that weighs."""
        box = self.window.spec.box
        if self._others is None or self._others.live.spec.box != box:
            window = self._decided().window
            live = live_map(self._taken, window) if self._live is None else self._live
            counted = self.config.chain.reflecting > 0.0
            reflection = reflection_map(self._taken, window, box) if counted else None
            self._others, self._live = Beside(live.windowed(box), reflection), None
        return self._others

    def known_map(self, of: Estimate | None = None) -> GridMap:
        """Return `map` where data moved what was drawn, nan elsewhere (see `known_cells`)."""
        sampler, spec = self._sampled(), self.window.spec
        of = of or sampler.estimate()
        whole, drawn = self.map(of), self.drawn_map(of)
        arrives = (sampler.arrival(of.mean) >= ARRIVES).reshape(spec.height, spec.width)
        known = known_cells(drawn.probability, arrives, self.config.patch.margin)
        return GridMap(spec, np.where(known, whole.probability, np.float32(np.nan)))

    def grid_map(self, values: Float32Array) -> GridMap:
        """Return values (C,) of the touched cells on the window, nan elsewhere."""
        assert self.sampler is not None
        return GridMap.of_cells(self.window.spec, self.sampler.model.touched, values)

    def _sampled(self) -> PosteriorSampler:
        if self.sampler is None:
            raise WindowError('nothing was sampled yet: no map')
        return self.sampler

    def settings(self) -> dict[str, Any]:
        """Return what decided the samples: results carry it."""
        return {**flatten(self._decided()), 'scans': len(self._taken)}
