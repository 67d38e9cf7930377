"""Placed scans in, converging posterior mean out: what `refine_server` and `sample` run.

Placement ---> Recording ---snapshot---> Refinement.take(scans)
|  RayWindow (which rays touch which cell)
|  live map (where one chain starts)
v
GridMap <--- posterior mean <--- PosteriorSampler.advance(sweeps) ... until a limit
"""

from __future__ import annotations

import time
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float32Array, UInt8Array
from ogm_mcmc.config import (
    MapperConfig,
    RecordingConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
    flatten,
)
from ogm_mcmc.errors import ConfigError, GridError, WindowError
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D, PoseBelief, Scan
from ogm_mcmc.mapping import make_method
from ogm_mcmc.placement import Placement
from ogm_mcmc.sampling import (
    CellModel,
    ChainQuality,
    PosteriorSampler,
    RayWindow,
    over_dispersed_starts,
)

__all__ = [
    'Progress',
    'Recording',
    'Refinement',
    'cells_on',
    'hide_uncertain',
    'live_map',
    'warm_up',
]

NS_PER_S = 1_000_000_000

# Long enough that Python costs nothing, short enough that a stop is not waited for.
ROUND_S = 0.1

# Judging chains takes a look at every batch of every cell: at most this share of the time.
JUDGING_SHARE = 0.1

# Fewer sweeps agree by chance.
MIN_COUNTED = 64


class Recording:
    """The most recent placed scans, within limits."""

    def __init__(self, config: RecordingConfig) -> None:
        self.config = config
        self.n_rays = 0
        self._scans: deque[Placement] = deque()

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self._scans)

    def add(self, placement: Placement) -> None:
        """Keep a scan with the belief about its sensor's pose; the oldest go."""
        config = self.config
        self._scans.append(placement)
        self.n_rays += placement.scan.ranges_m.size
        oldest = placement.scan.stamp_ns - round(config.max_seconds * NS_PER_S)
        while len(self._scans) > 1 and (
            len(self._scans) > config.max_scans
            or self.n_rays > config.max_rays
            or (config.max_seconds > 0.0 and self._scans[0].scan.stamp_ns < oldest)
        ):
            self.n_rays -= self._scans.popleft().scan.ranges_m.size

    def snapshot(self) -> list[Placement]:
        """Return the scans as they are now."""
        return list(self._scans)

    def clear(self) -> None:
        """Forget all scans."""
        self._scans.clear()
        self.n_rays = 0


class Progress(NamedTuple):
    """How far sampling has come; `reason` says why it stopped, empty while it has not."""

    sweeps: int
    counted: int
    seconds: float
    sweeps_per_s: float
    agreeing_share: float
    r_hat_p99: float
    ess_median: float
    mcse_max: float
    log_likelihood: float
    reason: str = ''

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            key: round(value, 6) if isinstance(value, float) else value
            for key, value in self._asdict().items()
        }


class Refinement:
    """The posterior of a set of scans, sampled for as long as there is time.

    Deterministic for a seed: how long a round takes changes when it stops, never what it draws.
    """

    def __init__(self, config: SamplerConfig) -> None:
        self.config = config
        self._taken: list[Placement] = []
        self.window = RayWindow(config.window, config.model)
        self.sampler: PosteriorSampler | None = None
        self.quality: ChainQuality | None = None
        self._summary: dict[str, float] | None = None

    # -- scans in ---------------------------------------------------------------------------

    def take(self, scans: Sequence[Placement], start: GridMap | None = None) -> int:
        """Use these scans from now on; return the number of rays.

        Scans added since the last time extend the rays already indexed; any other change builds
        them anew. Chains go on from where they are (a warm start), or begin at `start` or as the
        configuration says. Raises WindowError when there is nothing to sample or too much, and
        GridError when `start` is of another lattice; nothing has changed then.
        """
        if not scans:
            raise WindowError('no scan was recorded: expected at least one')
        known = len(self._taken)
        extends = 0 < known <= len(scans) and all(
            old is new for old, new in zip(self._taken, scans[:known], strict=True)
        )
        warm = self._present_maps()
        window = self.window if extends else RayWindow(self.config.window, self.config.model)
        fresh = scans[known:] if extends else scans
        window.add((scan, belief.mean) for scan, belief in fresh)
        if window.index.n_rays == 0:
            raise WindowError(f'no beam of {len(scans)} scans says anything: nothing to sample')
        self.window, self._taken = window, list(scans)
        self._begin(start, warm)
        return window.index.n_rays

    def _begin(self, start: GridMap | None, warm: list[GridMap]) -> None:
        chain, spec = self.config.chain, self.window.spec
        model = CellModel(self.window.index, chain.prior_log_odds, spec.width, chain.order)
        if warm:
            starts = [cells_on(spec, grid, 0.5) for grid in warm]
        elif start is not None:
            starts = [cells_on(spec, start, chain.start_threshold)] * chain.chains
        else:
            live = live_map(self._taken, self.config.window)
            starts = over_dispersed_starts(
                chain.start,
                chain.chains,
                model.n_cells,
                cells_on(spec, live, chain.start_threshold),
                chain.prior,
                chain.seed,
            )
        # After a warm start another stream of random numbers, or the chains would repeat it.
        seed = chain.seed + len(self._taken) if warm else chain.seed
        self.sampler = PosteriorSampler(model, starts, seed=seed, burn_in=chain.burn_in)
        self.quality, self._summary = None, None

    def _present_maps(self) -> list[GridMap]:
        if self.sampler is None:
            return []
        spec = self.window.spec
        return [
            GridMap(spec, state.cells.reshape(spec.height, spec.width).astype(np.float32))
            for state in self.sampler.states
        ]

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
        # A sampler that was loaded has sweeps already.
        if self.sampler.burn_in >= self.sampler.sweeps + stop.max_sweeps:
            raise ConfigError(
                f'max_sweeps is {stop.max_sweeps}: expected more than burn_in '
                f'({self.sampler.burn_in}), or no sweep counts'
            )
        return self._rounds(self.sampler, stop, cancelled)

    def _rounds(
        self, sampler: PosteriorSampler, stop: StopConfig, cancelled: Callable[[], bool]
    ) -> Iterator[Progress]:
        began, done, per_round = time.monotonic(), 0, 1
        judged_at, judging_s = began, 0.0
        reason = ''
        while not reason:
            started = time.monotonic()
            n = min(per_round, stop.max_sweeps - done)
            sampler.advance(n)
            done += n
            now = time.monotonic()
            per_round = max(1, min(round(ROUND_S * n / max(now - started, 1e-6)), 2 * per_round))
            if done >= stop.max_sweeps:
                reason = 'sweeps'
            elif now - began >= stop.max_time:
                reason = 'time'
            elif cancelled():
                reason = 'cancelled'
            if reason or (now - judged_at) * JUDGING_SHARE >= judging_s:
                self.quality = sampler.quality()
                self._summary = None if self.quality is None else self.quality.summary()
                judged_at = time.monotonic()
                judging_s = judged_at - now
                if not reason and self._converged(stop, sampler.counted):
                    reason = 'converged'
            yield self._progress(sampler, done, time.monotonic() - began, stop, reason)

    def _converged(self, stop: StopConfig, counted: int) -> bool:
        return (
            self.quality is not None
            and stop.r_hat > 0.0
            and counted >= MIN_COUNTED
            and self.quality.agreeing_share(stop.r_hat) >= stop.agreeing_share
        )

    def _progress(
        self, sampler: PosteriorSampler, done: int, seconds: float, stop: StopConfig, reason: str
    ) -> Progress:
        quality = self.quality
        figures = {'r_hat_p99': np.inf, 'ess_median': 0.0, 'mcse_max': np.inf}
        if self._summary is not None:
            figures = {key: self._summary[key] for key in figures}
        return Progress(
            sweeps=sampler.sweeps,
            counted=sampler.counted,
            seconds=seconds,
            sweeps_per_s=done / max(seconds, 1e-9),
            agreeing_share=0.0 if quality is None else quality.agreeing_share(stop.r_hat),
            log_likelihood=float(np.mean(sampler.log_likelihoods())),
            reason=reason,
            **figures,
        )

    # -- maps out ---------------------------------------------------------------------------

    def map(self) -> GridMap:
        """Return the posterior mean on the window, nan where no ray ever came."""
        if self.sampler is None:
            raise WindowError('nothing was sampled yet: no map')
        return self.grid_map(self.sampler.estimate().mean)

    def grid_map(self, values: Float32Array) -> GridMap:
        """Return values (C,) of the touched cells on the window, nan elsewhere."""
        assert self.sampler is not None
        spec = self.window.spec
        whole = np.full(spec.height * spec.width, np.nan, np.float32)
        whole[self.sampler.model.touched] = values
        return GridMap(spec, whole.reshape(spec.height, spec.width))

    def settings(self) -> dict[str, Any]:
        """Return what decided the samples: results carry it."""
        return {**flatten(self.config), 'scans': len(self._taken)}

    # -- the state on disk ------------------------------------------------------------------

    def save(self, path: Path) -> None:
        """Write the state of the chains; `resume` goes on as if nothing had happened."""
        if self.sampler is None:
            raise WindowError('nothing was sampled yet: no state to save')
        self.sampler.save(path, self._identity())

    def resume(self, path: Path) -> int:
        """Let the chains go on from a saved state of the same scans; return their sweeps.

        Raises WindowError, with nothing changed, when the state is of other scans or settings.
        """
        if self.sampler is None:
            raise WindowError('no scan was taken: nothing to resume')
        sampler, saved = PosteriorSampler.load(path, self.sampler.model)
        for name, here in self._identity().items():
            if saved.get(name) != here:
                raise WindowError(
                    f'{path}: sampled with {name} {saved.get(name)!r}: expected {here!r}'
                )
        self.sampler, self.quality, self._summary = sampler, None, None
        return sampler.sweeps

    def _identity(self) -> dict[str, Any]:
        """Return what a saved state must have in common with this one."""
        settings = self.settings()
        del settings['window.max_memory_mb']  # decides nothing that is drawn
        index = self.window.index
        check = zlib.crc32(index.first_cell.data)
        return {**settings, 'rays_crc32': zlib.crc32(index.ray_likelihood.data, check)}


def live_map(scans: Sequence[Placement], window: WindowConfig) -> GridMap:
    """Return the two-assumption map of the same scans on the same lattice."""
    mapper = make_method(
        MapperConfig(
            resolution=window.resolution, max_range=window.max_range, no_return=window.no_return
        )
    )
    for scan, belief in scans:
        mapper.update(scan, belief)
    return GridMap(mapper.spec, mapper.probabilities(mapper.spec.box))


def cells_on(spec: GridSpec, grid: GridMap, threshold: float) -> UInt8Array:
    """Return a map (K,) of a window: 1 where `grid` is at least at a threshold, 0 elsewhere."""
    same = (
        grid.spec.resolution_m == spec.resolution_m
        and grid.spec.anchor_x_m == spec.anchor_x_m
        and grid.spec.anchor_y_m == spec.anchor_y_m
    )
    if not same:
        raise GridError(
            f'start map with cells of {grid.spec.resolution_m:g} m anchored at '
            f'({grid.spec.anchor_x_m:g}, {grid.spec.anchor_y_m:g}): expected '
            f'{spec.resolution_m:g} m at ({spec.anchor_x_m:g}, {spec.anchor_y_m:g})'
        )
    cells = np.zeros((spec.height, spec.width), np.uint8)
    rows, columns = np.nonzero(grid.probability >= threshold)
    rows, columns = rows + grid.spec.row0 - spec.row0, columns + grid.spec.column0 - spec.column0
    inside = (rows >= 0) & (rows < spec.height) & (columns >= 0) & (columns < spec.width)
    cells[rows[inside], columns[inside]] = 1
    return cells.reshape(-1)


def warm_up(config: SamplerConfig) -> int:
    """Compile, or load from the cache, every kernel sampling needs; return the cells sampled.

    Otherwise the first sweep of a process would take the time that is for sampling.
    """
    resolution = config.window.resolution
    scan = Scan.checked(
        np.array([1.5, 1.2]) * resolution,
        angle_min_rad=0.1,
        angle_increment_rad=1.0,
        range_min_m=0.0,
        range_max_m=2.0 * resolution,
    )
    window = replace(config.window, beam_stride=1, max_range=0.0)
    refinement = Refinement(replace(config, window=window))
    refinement.take([Placement(scan, PoseBelief(Pose2D()))])
    assert refinement.sampler is not None
    refinement.sampler.advance(1)
    return int(refinement.sampler.model.touched.size)


def hide_uncertain(grid_map: GridMap, prior: float, margin: float | Float32Array) -> GridMap:
    """Return a map with nan wherever it is no more certain than the prior.

    Certain is max(p, 1 - p); a cell is shown when it exceeds that of the prior by `margin`, one
    number or one for every cell.
    """
    p = grid_map.probability
    limit = max(prior, 1.0 - prior) + margin
    with np.errstate(invalid='ignore'):
        shown = np.maximum(p, np.float32(1.0) - p) > limit
    return GridMap(grid_map.spec, np.where(shown, p, np.float32(np.nan)))
