"""How many chains sample: as many as are asked for, or by the rays."""

from dataclasses import replace

import pytest
from support.local_tiles import LocalHolders
from support.refinements import FIRST, SECOND, THIRD, lattice_map, run, settings

from ogm_mcmc.config import PatchConfig, sampling
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.tiled_refinement import TiledRefinement

SCANS = [FIRST, SECOND, THIRD]  # of 4, 3 and 3 rays


@pytest.fixture(autouse=True)
def _few_rays_are_many(monkeypatch):
    monkeypatch.setattr(sampling, 'CHAINS_BELOW', ((5, 4), (8, 3)))


def chosen(chains):
    patch = PatchConfig(prior='uniform', size=9, margin=1)
    return replace(settings(chains=chains), patch=patch)


def generators(refinement):
    return [rng.bit_generator.state for rng in refinement.sampler.rngs]


@pytest.mark.parametrize(('asked', 'chains'), [(0, [4, 3, 2]), (1, [1, 1, 1]), (5, [5, 5, 5])])
def test_new_chains_are_as_many_as_asked_for_or_by_the_rays(asked, chains):
    found = []
    for n_scans in (1, 2, 3):
        refinement = Refinement(chosen(asked))
        refinement.take(SCANS[:n_scans])
        *_, last = run(refinement, max_sweeps=12)
        found.append(len(refinement.sampler.states))
        assert last.chains == found[-1]
    assert found == chains


def test_of_chains_that_go_on_with_more_rays_the_first_do():
    refinement = Refinement(chosen(0))
    refinement.take(SCANS[:1])
    run(refinement, max_sweeps=20)
    before, held = generators(refinement), refinement.sampler.states
    maps = [state.cells[refinement.sampler.model.touched].tolist() for state in held]
    touched, spec = refinement.sampler.model.touched, refinement.window.spec
    refinement.take(SCANS)
    assert generators(refinement) == before[:2]
    there = refinement.window.spec
    on = (touched // spec.width + spec.row0 - there.row0) * there.width
    on += touched % spec.width + spec.column0 - there.column0
    assert [state.cells[on].tolist() for state in refinement.sampler.states] == maps[:2]


def test_chains_that_go_on_with_fewer_rays_stay_as_many_also_where_scans_moved():
    refinement = Refinement(chosen(0))
    refinement.take(SCANS)
    refinement.take(SCANS[1:2])
    assert len(refinement.sampler.states) == len(generators(refinement)) == 2


def test_a_start_that_is_given_is_that_of_as_many_chains_as_the_rays_say():
    """Each draws numbers of its own: those of before go on, others are new."""
    refinement = Refinement(chosen(0))
    refinement.take(SCANS)
    run(refinement, max_sweeps=20)
    before = generators(refinement)
    refinement.take(SCANS[:1], lattice_map([[0.0, 0.9]]))
    assert len(refinement.sampler.states) == 4
    assert generators(refinement)[:2] == before
    drawn = {rng.random() for rng in refinement.sampler.rngs}
    assert len(drawn) == 4


def test_chains_taken_up_again_are_as_many_as_were_saved(tmp_path):
    """Chains that had gone on with more rays are fewer than new ones would be, or more."""
    grown, anew = Refinement(chosen(0)), Refinement(chosen(0))
    grown.take(SCANS)
    grown.take(SCANS[:1])
    run(grown, max_sweeps=20)
    grown.save(tmp_path / 'state.npz')
    anew.take(SCANS[:1])
    assert len(anew.sampler.states) == 4
    anew.resume(tmp_path / 'state.npz')
    assert generators(anew) == generators(grown)
    assert len(anew.sampler.states) == 2


def test_tiles_are_sampled_by_as_many():
    refinement = TiledRefinement(chosen(0), 2, 1, LocalHolders())
    refinement.take(SCANS[:2])
    assert len(refinement.sampler.states) == 3
