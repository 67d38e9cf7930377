"""When a burn-in ends, and when it is decided where sweeps look most."""

import warnings

import numpy as np
import pytest
from support.small_chains import LoneCells, assert_same, patch_model, sampler_of

from ogm_mcmc.sampling import PosteriorSampler, over_dispersed_starts
from ogm_mcmc.sampling import burn_in as burn_in_module
from ogm_mcmc.sampling.diagnostics import later_halves, split_r_hat
from ogm_mcmc.sampling.gibbs_kernels import PARTS


@pytest.mark.parametrize(
    ('burn_in', 'expected'),
    [(40, [8, 16, 32, 38]), (20, [8, 16, 18]), (10, [8]), (9, []), (0, [])],
)
def test_where_sweeps_look_is_decided_in_the_burn_in(burn_in, expected):
    """And everything is drawn twice before a sweep counts; those that count are all alike."""
    model = patch_model()
    sampler = sampler_of(model, burn_in=burn_in)
    looks = []
    draw = model.advance
    model.advance = lambda *args, **kw: looks.append(kw['focus']) or draw(*args, **kw)
    decided, whole = [], []
    for done in range(burn_in + 70):
        looks.clear()
        sampler.advance(1)
        after = {focus.after for focus in sampler.focus.values()}
        assert len(after) <= 1
        decided += sorted(after.difference(decided))
        if all(look is None for look in looks):
            whole.append(done)
        else:
            assert sorted(map(id, looks)) == sorted(id(f.places) for f in sampler.focus.values())
    assert decided == expected
    last = [burn_in - 2, burn_in - 1]
    every = range(burn_in + 70) if not expected else {*range(expected[0]), *last}
    assert whole == sorted(every)
    assert sampler.settling == []


@pytest.mark.parametrize('ends', [True, False])
def test_a_burn_in_ends_at_the_first_look_at_which_chains_agree(ends, monkeypatch):
    """Looks are at its half and each eighth after that, two sweeps for the focus before these."""
    model = patch_model()
    sampler = sampler_of(model, burn_in=400, may_end=True)
    share = 0.9 if ends else 1.1
    monkeypatch.setattr(burn_in_module, 'AGREEING', (1.2, share))
    agreed = []
    for done in range(1, 400):
        sampler.advance(1)
        if done in (198, 248, 298, 348):
            # Chain by chain, the later two thirds of the sweeps so far, in two halves.
            means = []
            for counts in sampler.settling:
                skipped = counts.full // 3
                half = (counts.full - skipped) // 2
                first = counts.full - 2 * half
                for begin in (first, first + half):
                    rows = counts.counts[begin : begin + half].astype(float)
                    means.append(rows.sum(axis=0) / (half * counts.batch_length * PARTS))
            informed = sampler.arrival(np.mean(means, axis=0, dtype=np.float32))[model.touched]
            r_hat = split_r_hat(np.array(means)[:, informed >= 0.5], half * counts.batch_length)
            assert sampler.settling_share(1.2) == np.mean(r_hat < 1.2) > 0.0
            agreed += [done] if np.mean(r_hat < 1.2) >= share else []
        if agreed:
            break
    assert bool(agreed) == ends
    assert sampler.burn_in == (agreed[0] + 2 if ends else 400)
    sampler.advance(sampler.burn_in + 20 - sampler.sweeps)
    assert sampler.counted == 20
    if ends:
        assert {focus.after for focus in sampler.focus.values()} == {agreed[0]}
    at_once = sampler_of(patch_model(), burn_in=400, may_end=True)
    at_once.advance(sampler.sweeps)
    assert_same(at_once, sampler)


class ChainsOfTheirOwn(LoneCells):
    """Every chain draws its cells with the probability in its records, none where that is nan."""

    def advance(self, rng, state, **_):
        if np.isfinite(state.records[0]):
            state.cells[:] = rng.random(self.n_cells) < state.records[0]
        return 0


@pytest.mark.parametrize('chains', [4, 16])
@pytest.mark.parametrize('live', [0, 1])
@pytest.mark.parametrize('stay', [False, True])
def test_a_burn_in_of_many_chains_is_judged_in_two_groups(chains, live, stay):
    """Chains that differ within a group agree; those that stay where they began do not."""
    model = ChainsOfTheirOwn(np.full(400, 0.5))
    cells = np.full(400, live, np.uint8)
    starts = over_dispersed_starts('dispersed', chains, cells, 0.2, 1, np.zeros(400, np.bool_))
    sampler = PosteriorSampler(model, starts, seed=1, burn_in=400, may_end=True)
    for j, state in enumerate(sampler.states):
        own = np.nan if stay else (0.2, 0.8)[j % 2]
        sampler.states[j] = state._replace(records=np.array([own]))
    sampler.advance(198)
    means, length = later_halves(sampler.settling, model.touched)
    first = np.arange(2 * chains) // 4 % 2 == 0  # of every four chains the first two
    groups = [means[mine][half::2].mean(axis=0) for mine in (first, ~first) for half in (0, 1)]
    r_hat = split_r_hat(np.array(groups), length * chains // 2)
    assert sampler.settling_share(1.05) == np.mean(r_hat < 1.05)
    assert sampler.burn_in == (400 if stay else 200)
    assert np.mean(split_r_hat(means, length) < 1.05) < 0.5


def test_short_burn_ins_are_done_whole():
    sampler = sampler_of(patch_model(), burn_in=39, may_end=True)
    sampler.advance(60)
    assert sampler.counted == 21


def test_chains_that_nothing_is_told_of_agree():
    """As `ChainQuality` has it; no mean is taken of nothing."""
    model = LoneCells(np.full(5, 0.5))
    model.arrival = lambda probability, least: np.zeros_like(probability)
    starts = [np.full(5, j, np.uint8) for j in range(2)]
    sampler = PosteriorSampler(model, starts, seed=1, burn_in=40, may_end=True)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        sampler.advance(30)
    assert sampler.burn_in == 20


@pytest.mark.parametrize('chains', [1, 3])
def test_chains_that_start_alike_cannot_tell_that_they_forgot_it(chains, monkeypatch):
    monkeypatch.setattr(burn_in_module, 'AGREEING', (1e9, 0.0))
    model = LoneCells(np.full(5, 0.5))
    starts = [np.ones(5, np.uint8)] * chains
    sampler = PosteriorSampler(model, starts, seed=1, burn_in=40, may_end=True)
    sampler.advance(41)
    assert (sampler.burn_in, sampler.counted) == (40, 1)


@pytest.mark.parametrize(
    ('burn_in', 'cold', 'begins'), [(40, True, True), (39, True, False), (40, False, False)]
)
def test_only_a_long_burn_in_begins_cold(burn_in, cold, begins):
    """And no sweep that counts has anything but the likelihood."""
    powers = []

    class Recording(LoneCells):
        begins_cold = cold

        def advance(self, rng, state, *, settling, power, **_):
            assert settling or power == 1.0
            powers.append(power)
            return 0

    sampler = sampler_of(Recording(np.full(4, 0.5)), chains=1, burn_in=burn_in)
    sampler.advance(burn_in + 2)
    first = list(burn_in_module.POWERS) if begins else [1.0] * len(burn_in_module.POWERS)
    assert powers == first + [1.0] * (burn_in + 2 - len(burn_in_module.POWERS))
    assert first == sorted(first, reverse=True)
