"""Sampling in rounds of about 0.1 s until a limit is reached, and how well the chains agree."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from ogm_mcmc.config import StopConfig
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.sampling import ChainQuality, PosteriorSampler
from ogm_mcmc.sampling.diagnostics import TURNS, judged_in_groups

__all__ = ['SamplingRounds', 'least_counted']

# Judging chains takes a look at every batch of every cell: at most this share of the time. Before
# it can end anything, and only says how far they are, at most the second.
JUDGING_SHARE = 0.1
EARLY_JUDGING_SHARE = 0.015

# Fewer sweeps agree by chance; of four chains that are judged in groups half of them do. More
# chains are of few beams, between which walls go on closing: the mean of a few sweeps more is
# nearer to the truth.
MIN_COUNTED, MIN_COUNTED_BY_FOUR, MIN_COUNTED_BY_MANY = 64, 32, 48


def least_counted(n_chains: int) -> int:
    """Return how many sweeps of each of so many chains have to count before they may agree."""
    if not judged_in_groups(n_chains):
        return MIN_COUNTED
    return MIN_COUNTED_BY_FOUR if n_chains == TURNS else MIN_COUNTED_BY_MANY


class SamplingRounds:
    """Rounds of sampling. `quality` is that of the informed cells when chains were judged last.

    Until there is one, progress says how far chains agree about their burn-in. That never ends
    anything, and is not said of a run that has ended.
    """

    def __init__(self) -> None:
        self._settling_share = 0.0
        self.quality: ChainQuality | None = None
        self._summary: dict[str, float] | None = None

    def run(
        self, sampler: PosteriorSampler, stop: StopConfig, cancelled: Callable[[], bool]
    ) -> Iterator[Progress]:
        """Sample until a limit is reached; yield after each round.

        The last progress carries the reason: `sweeps`, `time`, `converged` or `cancelled`.
        Raises ConfigError at once when the limits contradict each other.
        """
        # Chains that go on may have their burn-in behind them.
        if sampler.burn_in >= sampler.sweeps + stop.max_sweeps:
            raise ConfigError(
                f'max_sweeps is {stop.max_sweeps}: expected more than burn_in '
                f'({sampler.burn_in}), or no sweep counts'
            )
        return self._rounds(sampler, stop, cancelled)

    def _rounds(
        self, sampler: PosteriorSampler, stop: StopConfig, cancelled: Callable[[], bool]
    ) -> Iterator[Progress]:
        began, done, per_round = time.monotonic(), 0, 1
        judged_at, judging_s = began, 0.0
        reason, least = '', least_counted(sampler.n_chains)
        while not reason:
            started = time.monotonic()
            n = min(per_round, stop.max_sweeps - done)
            sampler.advance(n)
            done += n
            now = time.monotonic()
            per_round = max(
                1, min(round(sampler.round_s * n / max(now - started, 1e-6)), 2 * per_round)
            )
            if done >= stop.max_sweeps:
                reason = 'sweeps'
            elif now - began >= stop.max_time:
                reason = 'time'
            elif cancelled():
                reason = 'cancelled'
            early = sampler.counted < least
            share = EARLY_JUDGING_SHARE if early else JUDGING_SHARE
            due = (now - judged_at) * share >= judging_s
            if reason or due or 0 <= sampler.counted - least < n:
                self._judge(sampler, stop)
                judged_at = time.monotonic()
                judging_s = judged_at - now
                if not reason and sampler.counted >= least and self._converged(stop):
                    reason = 'converged'
            yield self._progress(sampler, done, time.monotonic() - began, stop, reason)

    def _judge(self, sampler: PosteriorSampler, stop: StopConfig) -> None:
        self.quality = sampler.informed_quality()
        self._summary = None if self.quality is None else self.quality.summary()
        if self.quality is None and stop.r_hat > 0.0:
            self._settling_share = sampler.settling_share(stop.r_hat)

    def _converged(self, stop: StopConfig) -> bool:
        return (
            self.quality is not None
            and stop.r_hat > 0.0
            and self.quality.agreeing_share(stop.r_hat) >= stop.agreeing_share
        )

    def _progress(
        self, sampler: PosteriorSampler, done: int, seconds: float, stop: StopConfig, reason: str
    ) -> Progress:
        quality = self.quality
        agreeing = 0.0 if reason else self._settling_share
        figures = {'r_hat_p99': np.inf, 'ess_median': 0.0, 'mcse_max': np.inf}
        if self._summary is not None:
            figures = {key: self._summary[key] for key in figures}
        return Progress(
            sweeps=sampler.sweeps,
            counted=sampler.counted,
            seconds=seconds,
            sweeps_per_s=done / max(seconds, 1e-9),
            agreeing_share=agreeing if quality is None else quality.agreeing_share(stop.r_hat),
            log_likelihood=float(np.mean(sampler.log_likelihoods())),
            chains=sampler.n_chains,
            reason=reason,
            **figures,
        )
