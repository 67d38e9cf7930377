"""A window at its limit: scans go when others come, and chains go on as if it were built anew."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from support.refinements import run, scan_at, settings

from ogm_mcmc.config import PatchConfig
from ogm_mcmc.engine import beams_found
from ogm_mcmc.engine import refinement as refinement_module
from ogm_mcmc.engine.beams_found import BeamsFound
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowError
from ogm_mcmc.sampling.first_hits import first_hits

PRIORS = {
    'single': PatchConfig(),
    'patches': PatchConfig(prior='uniform', size=9, margin=1),
}


def drive(count):
    """Scans on a way through a room, from where the robot stood for a while in the middle."""
    rng = np.random.default_rng(7)
    scans = []
    for k in range(count):
        ranges = [*rng.uniform(0.8, 3.5, 4), math.inf]
        at = min(k, 9) + max(k - 11, 0)
        scans.append(scan_at(0.31 * at, math.sin(at), *ranges, yaw=0.7 * at, stamp_ns=k))
    return scans


SCANS = drive(26)


def begun(prior, **chain):
    config = replace(settings(**chain), patch=PRIORS[prior])
    return Refinement(config)


@pytest.mark.parametrize('prior', PRIORS)
def test_chains_go_on_as_in_an_index_that_was_built_of_the_same_scans(prior, monkeypatch):
    moving = begun(prior)
    moving.take(SCANS[:8])
    run(moving, max_sweeps=12)
    anew = []
    monkeypatch.setattr(moving, '_empty_window', lambda: anew.append(1))
    for first, end in ((3, 11), (5, 18), (9, 22), (10, 22), (13, 26)):
        moving.take(SCANS[first:end])
        fresh = begun(prior)
        fresh.take(SCANS[first:end])
        ours, theirs = moving.window, fresh.window
        assert ours.spec == theirs.spec
        assert ours.n_beams == theirs.n_beams
        assert np.array_equal(moving.sampler.model.touched, fresh.sampler.model.touched)
        if theirs.n_merged == 0:  # else rays take in as much as they were said to at first
            assert ours.index.n_pairs == theirs.index.n_pairs
            assert np.array_equal(ours.index.gains(), theirs.index.gains())
        if prior == 'patches':
            assert np.array_equal(moving.sampler.model.told, fresh.sampler.model.told)
        fresh.sampler.states = [
            fresh.sampler.model.start(state.cells) for state in moving.sampler.states
        ]
        fresh.sampler.rngs = copy.deepcopy(moving.sampler.rngs)
        for state in moving.sampler.states:
            looked_for = first_hits(state.cells, ours.index)
            assert np.array_equal(state.records[:, :3], looked_for[:, :3])
        for one in (moving, fresh):
            one.sampler.advance(15)
        for our, their in zip(moving.sampler.states, fresh.sampler.states, strict=True):
            assert np.array_equal(our.cells, their.cells)
    assert not anew


def test_the_sensor_is_looked_at_again_when_as_many_scans_came_as_had_told_of_it(monkeypatch):
    looked = []

    fit = beams_found.fit_sensor

    def fits(scans, config):
        looked.append(len(scans))
        return fit(scans, config)

    monkeypatch.setattr(beams_found, 'fit_sensor', fits)
    refinement = begun('single', sensor='fitted')
    for first in range(0, 14, 2):
        refinement.take(SCANS[first : first + 8])
    assert looked == [8, 8]


def test_where_most_scans_went_all_is_built_anew(monkeypatch):
    refinement = begun('single')
    refinement.take(SCANS[:8])
    monkeypatch.setattr(refinement.window, 'drop', lambda gone: pytest.fail('nothing stays'))
    refinement.take(SCANS[5:13])
    assert refinement.window.n_beams == 8 * 5
    refinement.take([SCANS[12], *SCANS[5:12]])
    assert refinement.holds([SCANS[12], *SCANS[5:12]])


def test_a_state_that_fails_after_its_index_was_built_leaves_nothing_taken(monkeypatch, tmp_path):
    """Where its sensor is another one, the index of before is gone: taking scans begins anew."""
    refinement = begun('single')
    refinement.take(SCANS[:8])
    run(refinement, max_sweeps=12)
    refinement.save(tmp_path / 'state')
    other = begun('single')
    other.take(SCANS[:8])
    expected = [state.cells.tolist() for state in other.sampler.states]
    found = other.beams._replace(model=replace(other.beams.model, sigma=0.5), told=8)
    monkeypatch.setattr(BeamsFound, 'saved', lambda *_: found)

    def fails(*_):
        assert other.sampler is None  # the index of before is no longer there
        raise WindowError('cut short')

    monkeypatch.setattr(refinement_module, 'load_chains', fails)
    with pytest.raises(WindowError, match='cut short'):
        other.resume(tmp_path / 'state')
    assert other.sampler is None
    assert not other.holds(SCANS[:8])
    other.take(SCANS[:8])
    assert [state.cells.tolist() for state in other.sampler.states] == expected
    assert other.beams.model == refinement.beams.model
