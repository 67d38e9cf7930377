"""Scans in: what is taken, what extends a window, what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.refinements import (
    FAR,
    FIRST,
    NOTHING,
    SECOND,
    THIRD,
    maps,
    run,
    scan_at,
    settings,
    taken,
)

from ogm_mcmc.config import (
    PatchConfig,
)
from ogm_mcmc.config.nodes import NodeWindowConfig
from ogm_mcmc.engine.posterior import patch_prior, posterior_of
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowError
from ogm_mcmc.sampling import PosteriorSampler
from ogm_mcmc.sampling.kept_odds import zones_of


def test_rays_of_all_scans_are_counted():
    refinement = Refinement(settings())
    assert refinement.take([FIRST]) == 4
    assert refinement.take([FIRST, SECOND]) == 7
    assert refinement.take([FIRST, SECOND, NOTHING]) == 7
    assert refinement.take([SECOND]) == 3


def test_scans_that_came_in_extend_the_window():
    """The same posterior as of all scans at once, with the old rays left where they are."""
    refinement = taken(FIRST)
    window = refinement.window
    refinement.take([FIRST, SECOND, THIRD])
    assert refinement.window is window
    whole = taken(FIRST, SECOND, THIRD).window
    assert window.spec == whole.spec
    for name in ('rays', 'lists', 'near', 'front', 'runs'):
        assert np.array_equal(getattr(window.index, name), getattr(whole.index, name)), name


@pytest.mark.parametrize(('kind', 'more'), [('beam', 0), ('gaussian', 1)])
def test_zones_of_rays_are_memory_of_the_index(kind, more):
    refinement = taken(FIRST, SECOND, model={'kind': kind})
    index, size = refinement.window.index, refinement.size
    assert size.n_bytes - index.n_bytes == zones_of(index).n_bytes
    assert np.sign(size.n_bytes - index.n_bytes) == more


def test_a_posterior_without_chains_is_that_of_chains():
    """What workers build, who are told where chains stand."""
    scans = [FIRST, SECOND, THIRD, FIRST._replace(), SECOND._replace()]
    whole = taken(*scans)
    given = whole.beams.as_given(whole.config)
    window, model = posterior_of(given, scans, patch_prior(whole.config).table)
    assert window.spec == whole.window.spec
    assert window.n_beams == whole.size.n_rays
    assert window.n_merged == whole.size.n_merged > 0
    draws = []
    for one in (model, whole.sampler.model):
        state = one.start(np.ones(one.n_cells, np.uint8))
        one.advance(np.random.default_rng(1), state)
        draws.append(state.cells)
    assert np.array_equal(*draws)


@pytest.mark.parametrize(
    'patch',
    [PatchConfig(), PatchConfig(prior='uniform', size=9, margin=2)],
    ids=['cells', 'patches'],
)
def test_a_window_that_grew_draws_what_one_built_at_once_draws(patch):
    config = replace(settings(), patch=patch)
    grown, whole = Refinement(config), Refinement(config)
    scans = [FIRST, SECOND, NOTHING, THIRD, FIRST]
    for count in (1, 2, 5):
        grown.take(scans[:count])
    whole.take(scans)
    assert grown.window.spec == whole.window.spec
    draws = []
    for refinement in (grown, whole):
        model = refinement.sampler.model
        sampler = PosteriorSampler(
            model, [np.zeros(model.n_cells, np.uint8)] * 2, seed=3, burn_in=4
        )
        sampler.advance(20)
        cells = [state.cells.tolist() for state in sampler.states]
        draws.append((model.touched.tolist(), model.telling.tolist(), cells))
    assert draws[0] == draws[1]
    assert 0 < sum(draws[0][2][0]) < len(draws[0][2][0])


def test_beams_of_a_robot_that_stands_are_merged_and_counted():
    """In a window that grows, too: the same cells, so that a saved state fits."""
    again = scan_at(0.13, 0.22, 1.0, 1.5, 2.3, 2.0)
    grown, whole = taken(FIRST), taken(FIRST, again, SECOND)
    assert grown.size.n_merged == 0
    assert grown.take([FIRST, again, SECOND]) == whole.size.n_rays == 11
    assert (grown.size.n_merged, whole.size.n_merged) == (3, 4)
    assert whole.window.index.n_rays == 11 - 4
    assert grown.sampler.model.touched.tolist() == whole.sampler.model.touched.tolist()


def test_scans_that_went_build_the_window_anew():
    refinement = taken(FIRST, SECOND)
    refinement.take([SECOND, THIRD])
    assert refinement.window.spec == taken(SECOND, THIRD).window.spec
    assert refinement.window.index.n_rays == 6


def test_nothing_to_sample_is_refused():
    refinement = Refinement(settings())
    with pytest.raises(WindowError, match='no scan was recorded: expected at least one'):
        refinement.take([])
    with pytest.raises(WindowError, match='no beam of 2 scans says anything: nothing to sample'):
        refinement.take([NOTHING, NOTHING])
    with pytest.raises(WindowError, match='no scan was taken: nothing to sample'):
        run(refinement)
    with pytest.raises(WindowError, match='nothing was sampled yet: no map'):
        refinement.map()
    assert refinement.take([NOTHING, FIRST]) == 4


@pytest.mark.parametrize('extends', [True, False])
def test_too_much_is_refused_and_sampling_can_go_on(extends):
    far = scan_at(4000.0, 4000.0, 1.0, 2.0)  # a window of many cells
    refinement = taken(FIRST, window={'max_memory_mb': 1.0})
    run(refinement, max_sweeps=30)
    before = refinement.window.index, refinement.sampler, refinement.window.spec
    arrays = [array.copy() for array in refinement.window.index]
    mean = refinement.map().probability.copy()
    with pytest.raises(WindowError, match='expected at most max_memory_mb = 1'):
        refinement.take([FIRST, far] if extends else [SECOND, far])
    assert (refinement.window.index, refinement.sampler, refinement.window.spec) == before
    for a, b in zip(arrays, refinement.window.index, strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(refinement.map().probability, mean, equal_nan=True)
    run(refinement, max_sweeps=30)
    assert refinement.take([FIRST, SECOND]) == 7


def test_what_no_return_means_is_seen_in_the_scans():
    """Every other beam on a wall is lost; decided anew where rays are indexed anew."""
    lost = [
        scan_at(0.1 * k, 0.0, *((2.0, math.inf) * 10 if k % 2 else (math.inf, 2.0) * 10), yaw=0.5)
        for k in range(8)
    ]
    refinement = Refinement(replace(settings(), window=NodeWindowConfig(0.5)))
    refinement.take(lost)
    assert refinement.beams.no_return.value == 'ignore'
    assert refinement.beams.no_return.found.doubtful
    assert refinement.window.index.n_rays == 80
    assert refinement.settings()['window.no_return'] == 'ignore'
    with pytest.raises(WindowError):
        refinement.take([NOTHING])
    assert refinement.beams.no_return.value == 'ignore'  # as before: nothing was taken
    with pytest.raises(WindowError):
        refinement.take([*lost, FAR])
    assert refinement.window.index.n_rays == 80
    refinement.take([FIRST, SECOND])
    assert refinement.beams.no_return.value == 'ignore'  # two beams do not tell
    assert refinement.window.index.n_rays == 8 - 3


def before_a_wall(k, losing):
    """Beams without a return past a wall; or beams at it, every other of which is lost."""
    if not losing:
        return scan_at(0.1 * k, 0.0, *(2.0, 2.0, 2.0, *[math.inf] * 9), yaw=0.5)
    return scan_at(0.1 * k, 0.0, *((2.0, math.inf) * 10 if k % 2 else (math.inf, 2.0) * 10))


def test_a_window_that_grows_means_what_one_taken_at_once_means(tmp_path):
    """Too few beams, then clear, then ignore; a state that was saved fits after a restart."""
    first = [before_a_wall(k, losing=False) for k in range(4)]
    scans = [*first, *(before_a_wall(k, losing=True) for k in range(12))]
    chosen = replace(settings(), window=NodeWindowConfig(0.5))
    grown, found = Refinement(chosen), []
    for count in (1, 4, 8, 16):
        if grown.sampler is not None:
            run(grown, max_sweeps=20)
            before = maps(grown)
        grown.take(scans[:count])
        found.append(grown.beams.no_return.value)
        whole = Refinement(chosen)
        whole.take(scans[:count])
        assert grown.beams.no_return == whole.beams.no_return
        assert grown.settings() == whole.settings()
        assert grown.window.spec == whole.window.spec
        for name in ('rays', 'lists', 'near', 'front', 'runs'):
            ours, theirs = (getattr(one.window.index, name) for one in (grown, whole))
            assert np.array_equal(ours, theirs), (name, count)
        if count > 1:  # warm
            spec = grown.window.spec
            cells = {
                (k % spec.width + spec.column0, k // spec.width + spec.row0)
                for k in grown.sampler.model.touched.tolist()
            }
            assert maps(grown) == [one & cells for one in before]
    assert (found[0], found[1], found[-1]) == ('ignore', 'clear', 'ignore')
    run(grown, max_sweeps=20)
    grown.save(tmp_path / 'state')
    whole.resume(tmp_path / 'state')
    assert maps(whole) == maps(grown)


@pytest.mark.parametrize('extends', [True, False])
@pytest.mark.parametrize('where', ['posterior_model', 'PosteriorSampler'])
def test_what_fails_after_indexing_leaves_something_to_go_on_with(monkeypatch, extends, where):
    refinement = taken(FIRST)
    run(refinement, max_sweeps=20)

    def fails(*_, **__):
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(f'ogm_mcmc.engine.refinement.{where}', fails)
        with pytest.raises(MemoryError):
            refinement.take([FIRST, SECOND] if extends else [SECOND])
    # The index of the chains is no longer there: two would not fit.
    assert refinement.sampler is None
    assert not refinement.holds([FIRST])
    assert refinement.take([FIRST, SECOND, THIRD]) == taken(FIRST, SECOND, THIRD).size.n_rays
    run(refinement, max_sweeps=20)
