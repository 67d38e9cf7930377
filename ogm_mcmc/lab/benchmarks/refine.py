"""Times what `~/refine` promises: chains that agree, effective samples, a map better than live.

Seconds count from the moment the scans are handed over: index, starts and burn-in are included,
judging by held-out beams is not. `cpu` seconds are those of all threads together.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.config import SamplerConfig, ShownConfig, StopConfig, flatten
from ogm_mcmc.engine.live_map import live_map
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.warm_up import warm_up_sampling
from ogm_mcmc.evaluation import ForwardModel, beam_log_likelihood
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.sampling.estimates import hide_uncertain
from ogm_mcmc.simulation import WORLDS, Lidar, record

__all__ = ['Clock', 'Patience', 'every_other_beam', 'recorded_office', 'time_refining']

# The next map is judged after so much more time than the last one took.
NEXT_LOOK = 1.25


@dataclass(frozen=True)
class Patience:
    """How long is waited for agreement and for the first better map, s of sampling each."""

    agreement_s: float = 60.0
    better_s: float = 20.0


class Seconds(NamedTuple):
    """Time that has passed and time of the processors."""

    wall: float
    cpu: float

    def rounded(self) -> dict[str, float]:
        """Return plain numbers for JSON."""
        return {'wall': round(self.wall, 3), 'cpu': round(self.cpu, 3)}


class Clock:
    """Seconds since it was made, but for those between `pause` and `resume`."""

    def __init__(self) -> None:
        self._passed = Seconds(0.0, 0.0)
        self.resume()

    def resume(self) -> None:
        """Go on."""
        self._since: Seconds | None = Seconds(time.perf_counter(), time.process_time())

    def pause(self) -> Seconds:
        """Stand still; return the seconds so far."""
        self._passed, self._since = self.seconds, None
        return self._passed

    @property
    def seconds(self) -> Seconds:
        """The seconds so far."""
        passed = self._passed
        if self._since is None:
            return passed
        return Seconds(
            passed.wall + time.perf_counter() - self._since.wall,
            passed.cpu + time.process_time() - self._since.cpu,
        )


def time_refining(
    placed: Sequence[PlacedScan], config: SamplerConfig, patience: Patience
) -> dict[str, Any]:
    """Measure one input: all beams until the chains agree, and even beams judged by odd ones."""
    warm_up_sampling(config)
    return {
        **_agreement(placed, config, patience.agreement_s),
        'first_better': _first_better(placed, config, patience.better_s),
        'scans': len(placed),
        'settings': flatten(config),
    }


def recorded_office() -> list[PlacedScan]:
    """Return the simulated office: 1156 scans of 360 beams, 416 000 rays."""
    return list(record(WORLDS['office'](), Lidar(), np.random.default_rng(1)))


def every_other_beam(placed: Sequence[PlacedScan], first: int) -> list[PlacedScan]:
    """Return scans in which only the beams first, first + 2, ... say anything."""

    def one(scan: PlacedScan) -> PlacedScan:
        ranges = np.full_like(scan.scan.ranges_m, np.nan)
        ranges[first::2] = scan.scan.ranges_m[first::2]
        return PlacedScan(replace(scan.scan, ranges_m=ranges), scan.belief)

    return [one(scan) for scan in placed]


def _agreement(
    placed: Sequence[PlacedScan], config: SamplerConfig, most_s: float
) -> dict[str, Any]:
    """Sample until the chains agree; the effective samples are those of the time it took."""
    clock = Clock()
    refinement = Refinement(config)
    refinement.take(placed)
    taken = clock.seconds
    progress = _last(refinement.run(StopConfig(max_time=most_s, max_sweeps=10**6)))
    done = clock.seconds
    sampling = max(done.wall - taken.wall, 1e-9), max(done.cpu - taken.cpu, 1e-9)
    agreed = progress.reason == 'converged'
    return {
        'seconds_to_start': taken.rounded(),
        'seconds_to_agreement': done.rounded() if agreed else None,
        'agreeing_share': round(progress.agreeing_share, 5),
        'effective_samples': round(progress.ess_median, 2),
        'effective_samples_per_second': {
            'wall': round(progress.ess_median / sampling[0], 3),
            'cpu': round(progress.ess_median / sampling[1], 3),
        },
        'chains': progress.chains,
        'sweeps': progress.sweeps,
        'ms_per_sweep_and_chain': round(1e3 * sampling[1] / progress.sweeps / progress.chains, 3),
        'rays': refinement.size.n_rays,
    }


def _first_better(
    placed: Sequence[PlacedScan], config: SamplerConfig, most_s: float
) -> dict[str, Any]:
    """Map the even beams; say when odd ones first prefer the refined map, and how it went on.

    First is the first map that is better as the node shows it, unknown cells as the prior has it.
    """
    mapped, held_out = every_other_beam(placed, 0), every_other_beam(placed, 1)
    judge = ForwardModel.from_config(config.model)

    def nats(grid_map: GridMap, prior: float) -> float:
        beams = beam_log_likelihood(
            grid_map, held_out, judge, prior=prior, no_return=config.window.no_return
        )
        return round(float(beams.mean()), 5)

    live = nats(live_map(mapped, config.window), config.chain.prior)
    clock = Clock()
    refinement = Refinement(config)
    refinement.take(mapped)
    first: Seconds | None = None
    looks: list[dict[str, Any]] = []
    for progress in refinement.run(StopConfig(max_time=1e6, max_sweeps=10**6, r_hat=0.0)):
        now = clock.seconds
        if looks and now.wall < NEXT_LOOK * looks[-1]['wall']:
            continue
        clock.pause()
        whole, shown = _maps(refinement)
        look = {
            'sweeps': progress.sweeps,
            'nats': nats(whole, refinement.prior),
            'nats_as_shown': nats(shown, refinement.prior),
            'shown_cells': int(np.isfinite(shown.probability).sum()),
        }
        looks.append({**now.rounded(), **look})
        if first is None and look['nats_as_shown'] > live:
            first = now
        if now.wall > most_s:
            break
        clock.resume()
    return {
        'seconds': None if first is None else first.rounded(),
        'live_nats': live,
        'refined': looks,
    }


def _maps(refinement: Refinement) -> tuple[GridMap, GridMap]:
    """Return the whole map while sampling goes on, and as the node shows it, nan elsewhere."""
    assert refinement.sampler is not None
    of = refinement.sampler.present_estimate()
    known, drawn = refinement.known_map(of), refinement.drawn_map(of)
    margin = ShownConfig().unknown_margin
    shown = hide_uncertain(known, refinement.prior, margin, of.draws, drawn, refinement.guess)
    return refinement.map(of), shown


def _last(rounds: Iterator[Progress]) -> Progress:
    """Return the last of some progress; there is always one."""
    progress = next(rounds)
    for later in rounds:
        progress = later
    return progress
