"""Draws of a tile: what is kept between them changes nothing."""

import inspect

import numpy as np
import pytest
from support.kept_hits import assert_hits_are_those_of_the_map
from support.local_tiles import MODEL, PRIOR, WINDOW, room, some_map, tiled

from ogm_mcmc.sampling import RayWindow, patch_gibbs
from ogm_mcmc.sampling.patch_gibbs import SETTLED_WHOLE_SHARE, WHOLE_SHARE
from ogm_mcmc.sampling.patch_gibbs_kernels import sweep_patches
from ogm_mcmc.sampling.patch_prior import make_table
from ogm_mcmc.sampling.tiles import tiling_of


def test_what_a_tile_keeps_of_a_chain_changes_no_draw():
    """Two chains in turn, one of them copied: as by tiles that look at everything every time."""
    scans, window = room(), RayWindow(WINDOW, MODEL, margin=5)
    window.add(scans)
    tiling = tiling_of(window.spec, 2, 2, 0)
    model, tiles = tiled(scans, WINDOW, MODEL, tiling, None, log_odds=PRIOR)
    fresh, others = tiled(scans, WINDOW, MODEL, tiling, None, log_odds=PRIOR)
    states = [model.start(some_map(model.n_cells, seed, 0.3)) for seed in range(2)]
    again = [fresh.start(state.cells) for state in states]
    flips = told = 0
    for turn in range(8):
        for number in (0, 1):
            if turn == 4:
                states[number] = states[number].copy()
            flips += model.advance(np.random.default_rng(turn), states[number])
            for sampler in tiles.samplers:
                kept = sampler._kept[model._chains.number_of(states[number])[0]]
                told += assert_hits_are_those_of_the_map(kept, sampler.rays.local, sampler.width)
            for sampler in others.samplers:
                sampler._kept.clear()
            fresh.advance(np.random.default_rng(turn), again[number])
            assert np.array_equal(states[number].cells, again[number].cells)
            assert np.array_equal(states[number].records, again[number].records, equal_nan=True)
    assert flips > 100
    assert told > 100
    # No more is kept than there are chains.
    assert all(len(sampler._kept) == 2 for sampler in tiles.samplers)
    for sampler in tiles.samplers:
        kept = [array.nbytes for state in sampler._kept.values() for array in state]
        assert sum(kept) == 2 * sampler.report().n_bytes_of_chain
        assert sampler.report().n_bytes == sampler.rays.n_bytes


@pytest.mark.parametrize(
    ('settling', 'looking', 'expected'),
    [(True, True, WHOLE_SHARE), (False, False, WHOLE_SHARE), (False, True, SETTLED_WHOLE_SHARE)],
)
def test_tiles_draw_patches_whole_as_seldom_as_whole_windows(
    settling, looking, expected, monkeypatch
):
    scans, window = room(), RayWindow(WINDOW, MODEL, margin=5)
    window.add(scans)
    table = make_table('uniform', 9, p_occupied=0.3)
    model, _ = tiled(scans, WINDOW, MODEL, tiling_of(window.spec, 2, 2, 3), table, margin=3)
    state = model.start(some_map(model.n_cells, 1))
    doubt = np.zeros(model.n_cells, np.bool_)
    doubt[model.touched[::2]] = True
    shares = []
    kernel = getattr(sweep_patches, 'py_func', sweep_patches)
    at = list(inspect.signature(kernel).parameters).index('whole_share')
    monkeypatch.setattr(patch_gibbs, 'sweep_patches', lambda *given: shares.append(given[at]) or 0)
    focus = model.focus(doubt, doubt) if looking else None
    model.advance(np.random.default_rng(1), state, settling=settling, focus=focus)
    assert len(shares) == 4
    assert set(shares) == {expected}
