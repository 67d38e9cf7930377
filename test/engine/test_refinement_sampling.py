"""What is drawn, and when sampling stops."""

import json
import math

import numpy as np
import pytest
from support.refinements import (
    FIRST,
    SECOND,
    run,
    scan_at,
    settings,
    taken,
)

from ogm_mcmc.config import (
    StopConfig,
)
from ogm_mcmc.engine import sampling_rounds
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.sampling_rounds import least_counted
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.lab.exact import enumerate_maps
from ogm_mcmc.sampling import PosteriorSampler, RayWindow

approx = pytest.approx


def test_the_same_seed_gives_the_same_map_however_long_rounds_take(monkeypatch):
    found = []
    for round_s in (0.0, 0.001, 10.0):
        monkeypatch.setattr(PosteriorSampler, 'round_s', round_s)
        refinement = taken(FIRST, SECOND)
        assert run(refinement, max_sweeps=120)[-1].sweeps == 120
        found.append(refinement.map().probability)
    assert np.array_equal(found[0], found[1], equal_nan=True)
    assert np.array_equal(found[0], found[2], equal_nan=True)
    other = taken(FIRST, SECOND, seed=2)
    run(other, max_sweeps=120)
    assert not np.array_equal(other.map().probability, found[0], equal_nan=True)


def test_the_map_is_that_of_the_exact_posterior():
    """And nan where no ray ever came."""
    scan = scan_at(0.13, 0.22, 1.1, 1.6)
    config = settings(window={'resolution': 1.0}, model={'sigma': 0.8}, prior=0.3)
    refinement = Refinement(config)
    refinement.take([scan])
    run(refinement, max_sweeps=3000)
    window = RayWindow(config.window, config.model)
    window.add([scan])
    exact = enumerate_maps(window.index, config.chain.prior_log_odds)
    found = refinement.map()
    assert found.spec == window.spec
    flat = found.probability.reshape(-1)
    assert np.flatnonzero(~np.isnan(flat)).tolist() == exact.touched.tolist()
    assert flat[exact.touched] == approx(exact.marginals, abs=0.05)
    assert refinement.settings()['chain.prior'] == 0.3
    assert refinement.settings()['scans'] == 1


def test_sweeps_as_reason():
    progress = run(taken(FIRST), max_sweeps=77)
    last = progress[-1]
    assert (last.reason, last.sweeps, last.counted) == ('sweeps', 77, 67)
    assert [p.reason for p in progress[:-1]] == [''] * (len(progress) - 1)
    assert sum(p.sweeps < 77 for p in progress) == len(progress) - 1


def test_time_as_reason():
    last = run(taken(FIRST), max_sweeps=10**9, max_time=0.3)[-1]
    assert last.reason == 'time'
    assert 0.3 <= last.seconds < 3.0
    assert last.sweeps_per_s == approx(last.sweeps / last.seconds, rel=0.05)


def test_cancelled_as_reason():
    refinement = taken(FIRST)
    asked = []

    def cancelled():
        asked.append(1)
        return len(asked) == 3

    progress = list(refinement.run(StopConfig(max_sweeps=10**9, r_hat=0.0), cancelled))
    assert (progress[-1].reason, len(progress)) == ('cancelled', 3)
    assert np.isfinite(refinement.map().probability).any()


def test_converged_as_reason():
    refinement = taken(FIRST, SECOND)
    stop = StopConfig(max_sweeps=10**6, r_hat=1.05, agreeing_share=0.99)
    last = list(refinement.run(stop))[-1]
    assert last.reason == 'converged'
    assert last.counted >= 64
    assert last.agreeing_share >= 0.99
    assert refinement.quality.agreeing_share(1.05) == last.agreeing_share
    assert last.ess_median > 1.0
    assert 0.0 < last.mcse_max < 0.5


def test_progress_tells_how_far_a_burn_in_agrees_and_no_run_ends_by_that():
    refinement = taken(FIRST, burn_in=30)
    rounds = run(refinement, max_sweeps=40, r_hat=10.0, agreeing_share=0.0)
    shares = {p.sweeps: p.agreeing_share for p in rounds if p.counted < 16}
    assert [share for sweeps, share in shares.items() if sweeps < 5] == [0.0] * sum(
        sweeps < 5 for sweeps in shares
    )
    assert max(shares.values()) > 0.9
    # What has ended has agreed about what counts, or it has not.
    assert (rounds[-1].reason, rounds[-1].counted) == ('sweeps', 10)
    assert rounds[-1].agreeing_share == 0.0


def test_chains_are_judged_as_soon_as_they_may_stop(monkeypatch):
    """Whatever share of the time judging may take."""
    monkeypatch.setattr(sampling_rounds, 'JUDGING_SHARE', 0.0)
    monkeypatch.setattr(sampling_rounds, 'EARLY_JUDGING_SHARE', 0.0)
    refinement = taken(FIRST, burn_in=30)
    rounds = run(refinement, max_sweeps=500, r_hat=10.0, agreeing_share=0.0)
    assert [p.counted >= sampling_rounds.MIN_COUNTED for p in rounds[-2:]] == [False, True]
    assert rounds[-1].reason == 'converged'


def test_many_chains_may_agree_after_fewer_sweeps():
    assert [least_counted(n) for n in (1, 2, 3, 4, 5, 6, 8, 16)] == [
        64,
        64,
        64,
        32,
        64,
        64,
        48,
        48,
    ]
    rounds = run(
        taken(FIRST, burn_in=10, chains=4), max_sweeps=200, r_hat=10.0, agreeing_share=0.0
    )
    assert rounds[-1].reason == 'converged'
    assert 32 <= rounds[-1].counted < 64


def test_limits_that_contradict_each_other_are_refused_at_once():
    refinement = taken(FIRST, burn_in=30)
    with pytest.raises(ConfigError, match=r'max_sweeps is 30: expected more than burn_in \(30'):
        refinement.run(StopConfig(max_sweeps=30))
    assert refinement.sampler.sweeps == 0
    run(refinement, max_sweeps=31)
    # The burn-in is over: what comes counts.
    assert run(refinement, max_sweeps=5)[-1].counted == 6


def test_progress_is_plain_json():
    """Strictly so: a parser need not know of Infinity."""
    progress = run(taken(FIRST, burn_in=2), max_sweeps=4)[-1]
    assert progress.r_hat_p99 == math.inf  # not known yet
    values = json.loads(json.dumps(progress.as_dict(), allow_nan=False))
    assert values['r_hat_p99'] is None
    assert values['sweeps'] == 4
    assert values['reason'] == 'sweeps'
