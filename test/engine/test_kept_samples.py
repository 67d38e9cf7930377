"""Which maps are kept, and that their bits are the chains' own."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from ogm_mcmc.engine.kept_samples import KeptSamples
from ogm_mcmc.geometry import GridSpec

SPEC = GridSpec(0.1, 3, 2)
TOUCHED = np.array([0, 2, 3, 5])


class Chains(SimpleNamespace):
    """What a sampler has that is looked at."""


def chains(count):
    """A sampler whose maps tell chain and round: see `turn`."""
    states = [SimpleNamespace(cells=np.zeros(6, np.uint8)) for _ in range(count)]
    return Chains(states=states, model=SimpleNamespace(touched=TOUCHED))


def turn(sampler, rng):
    for state in sampler.states:
        state.cells[TOUCHED] = rng.integers(0, 2, 4)
    return [state.cells.copy() for state in sampler.states]


@pytest.mark.parametrize(('n_chains', 'most'), [(1, 64), (3, 64), (4, 64), (4, 8), (9, 4)])
@pytest.mark.parametrize('rounds', [1, 16, 17, 100])
def test_rounds_lie_evenly(n_chains, most, rounds):
    rng, sampler, kept = np.random.default_rng(0), chains(n_chains), KeptSamples(most)
    maps = []
    for _ in range(rounds):
        maps.append(turn(sampler, rng))
        kept.add(sampler)
    used = min(n_chains, most)
    every = 1
    while -(-rounds // every) > most // used:
        every *= 2
    expected = [tuple(cells) for of in maps[::every] for cells in of[:used]]
    bits = kept.bits(sampler, SPEC)
    assert bits.draws == len(expected)
    assert bits.known.ravel().tolist() == [True, False, True, True, False, True]
    words = bits.words.ravel()
    columns = [tuple((words >> np.uint64(s) & np.uint64(1)).tolist()) for s in range(64)]
    blank = [(0,) * 6] * (64 - len(expected))
    assert sorted(columns) == sorted(expected + blank)


def test_another_sampler_takes_the_place():
    rng, first, second, kept = np.random.default_rng(0), chains(2), chains(2), KeptSamples()
    assert kept.bits(first, SPEC) is None
    turn(first, rng)
    kept.add(first)
    assert kept.bits(second, SPEC) is None
    kept.add(second)
    assert kept.bits(first, SPEC) is None
    assert not kept.bits(second, SPEC).words.any()


def test_a_sampler_is_never_held_and_samples_are_forgotten():
    rng, sampler, kept = np.random.default_rng(0), chains(2), KeptSamples()
    turn(sampler, rng)
    held = sys.getrefcount(sampler)
    kept.add(sampler)
    assert sys.getrefcount(sampler) == held
    assert kept.bits(sampler, SPEC) is not None
    kept.clear()
    assert kept.bits(sampler, SPEC) is None


def test_none_are_kept_when_none_are_asked_for():
    sampler, kept = chains(2), KeptSamples(0)
    kept.add(sampler)
    assert kept.bits(sampler, SPEC) is None
