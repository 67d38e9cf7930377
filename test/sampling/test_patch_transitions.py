"""One draw of a patch against its slow twin: reversible, and the kernel draws as it says."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import naive_patch_sampler as naive
from support.patch_windows import (
    PLACES,
    WIDTH,
    handmade_table,
    some_map,
    table_of,
    two_scans,
    window_of,
)

from ogm_mcmc.sampling.gibbs_kernels import NO_CHANCE, PARTS
from ogm_mcmc.sampling.patch_gibbs import PatchModel


def corner_of(place):
    return np.array([place[0] * WIDTH + place[1]], np.int32)


@pytest.mark.parametrize(
    ('name', 'escape'),
    [('uniform', 0.5), ('handmade', 0.02), ('handmade', 0.5), ('border', 0.02), ('border', 1.0)],
)
def test_a_draw_leaves_the_conditional_as_it_is(name, escape, buildings):
    rays = naive.rays_of(window_of(two_scans()).index)
    table = table_of(name, buildings)
    rng = np.random.default_rng(11)
    for place in PLACES:
        draw = naive.PatchDraw(rays, some_map(rng).tolist(), WIDTH, place, table)
        conditional, transition = draw.conditional(), draw.transition(escape)
        assert_allclose(transition.sum(axis=1), 1.0, rtol=1e-12)
        flow = conditional[:, None] * transition
        assert_allclose(flow, flow.T, rtol=1e-9, atol=1e-300)  # reversible, so invariant
        assert_allclose(conditional @ transition, conditional, rtol=1e-9)
        # Everything can be reached: from anywhere a listed pattern, from there anything.
        twice = transition @ transition
        assert (twice[:, draw.listed] > 0.0).all()
        assert (twice[draw.listed] > 0.0).all()


def kernel_frequencies(sampler, cells, place, escape, count, seed, doubted=None, chances=None):
    """How often one draw from `cells` gives each pattern (512,)."""
    rng = np.random.default_rng(seed)
    state = sampler.start(cells)
    before = state.copy()
    corner = corner_of(place)
    seen = np.zeros(512)
    for _ in range(count):
        state.cells[:] = before.cells
        state.records[:] = before.records
        sampler.draw_patches(rng, corner, state, escape, doubted, chances)
        seen[naive.pattern_at(state.cells, WIDTH, *place, 3)] += 1
    return seen


def disagreement(seen, expected):
    """Pearson's statistic in standard deviations; rare outcomes pooled."""
    expected = expected * seen.sum()
    assert seen[expected == 0.0].sum() == 0
    common = expected >= 5.0
    pairs = list(zip(seen[common], expected[common], strict=True))
    pairs.append((seen[~common].sum(), expected[~common].sum()))
    terms = [(s - e) ** 2 / e for s, e in pairs if e > 0.0]
    freedom = max(len(terms) - 1, 1)
    return (sum(terms) - freedom) / math.sqrt(2.0 * freedom)


@pytest.mark.jit
@pytest.mark.parametrize('present', [0, 73, 341], ids=['free', 'listed', 'not listed'])
@pytest.mark.parametrize(
    ('name', 'escape'), [('uniform', 0.3), ('handmade', 0.3), ('border', 1.0)]
)
def test_kernel_draws_as_its_twin(name, escape, present, buildings):
    index = window_of(two_scans()).index
    table = table_of(name, buildings)
    place = PLACES[1]
    cells = np.array(
        naive.with_pattern(some_map(np.random.default_rng(5)), WIDTH, *place, 3, present),
        np.uint8,
    )
    draw = naive.PatchDraw(naive.rays_of(index), cells.tolist(), WIDTH, place, table)
    sampler = PatchModel(index, WIDTH, table)
    seen = kernel_frequencies(sampler, cells, place, escape, 6000, 17)
    assert (seen > 0).sum() > 1
    assert abs(disagreement(seen, draw.transition(escape)[present])) < 4.0


def cells_in_turn(share, conditional):
    """Distribution (512,) after one of nine cells and the next are drawn given the others.

    From a random one on; `share` (512,) before.
    """
    patterns, after = np.arange(512), np.zeros(512)
    for first in range(9):
        turned = share
        for cell in (i % 9 for i in range(first, first + 9)):
            free, occupied = patterns & ~(1 << cell), patterns | (1 << cell)
            drawn = conditional / (conditional[free] + conditional[occupied])
            turned = (turned[free] + turned[occupied]) * drawn
        after += turned / 9.0
    return after


@pytest.mark.jit
@pytest.mark.parametrize('present', [0, 341], ids=['listed', 'not listed'])
@pytest.mark.parametrize(
    ('name', 'escape'), [('uniform', 0.3), ('handmade', 0.3), ('border', 0.02)]
)
def test_flips_of_cells_leave_the_conditional_as_it_is(name, escape, present, buildings):
    """Some draws of the patch, always of each of its cells: the kernel does as its twin."""
    index = window_of(two_scans()).index
    table, place = table_of(name, buildings), PLACES[1]
    cells = np.array(
        naive.with_pattern(some_map(np.random.default_rng(5)), WIDTH, *place, 3, present),
        np.uint8,
    )
    draw = naive.PatchDraw(naive.rays_of(index), cells.tolist(), WIDTH, place, table)
    conditional = draw.conditional()
    assert_allclose(cells_in_turn(conditional, conditional), conditional, rtol=1e-9)
    sampler = PatchModel(index, WIDTH, table, flip_cells=True)
    assert 0.0 < sampler.whole_share < 1.0
    whole = sampler.whole_share * draw.transition(escape)
    before = (whole + (1.0 - sampler.whole_share) * np.eye(512))[present]
    expected = cells_in_turn(before, conditional)
    seen = kernel_frequencies(sampler, cells, place, escape, 6000, 29)
    assert (seen > 0).sum() > 3
    assert abs(disagreement(seen, expected)) < 4.0


@pytest.mark.jit
def test_the_probability_a_cell_is_drawn_with_is_told(buildings):
    """In the mean over the rounding to parts; and the draw has that probability."""
    index, place, which = window_of(two_scans()).index, PLACES[1], 5
    table = table_of('handmade', buildings)
    cells = some_map(np.random.default_rng(9))
    present = naive.pattern_at(cells, WIDTH, *place, 3)
    conditional = naive.PatchDraw(
        naive.rays_of(index), cells.tolist(), WIDTH, place, table
    ).conditional()
    free, occupied = (conditional[p] for p in (present & ~(1 << which), present | 1 << which))
    expected = occupied / (free + occupied)
    assert 0.01 < expected < 0.99
    sampler = PatchModel(index, WIDTH, table, flip_cells=True)
    sampler.whole_share = 0.0
    cell = corner_of(place)[0] + sampler._inner[which]
    doubted, chances = np.zeros(cells.size, np.uint8), np.full(cells.size, NO_CHANCE)
    doubted[cell] = 1
    state = sampler.start(cells)
    told, drawn, first = [], [], []
    for seed in range(4000):
        before = state.copy()
        rng = np.random.default_rng(seed)
        sampler.draw_patches(rng, corner_of(place), state, 0.0, doubted, chances)
        told.append(int(chances[cell]))
        drawn.append(int(state.cells[cell]))
        # The second number says after which cell the turn begins.
        first.append(int(9.0 * np.random.default_rng(seed).random(2)[1]) == which - 1)
        state.cells[:], state.records[:] = before.cells, before.records
    # Where others were drawn before it has another probability.
    assert np.mean(drawn) == pytest.approx(np.mean(told) / PARTS, abs=0.03)
    told = np.array(told)[first]
    assert told.size > 350
    assert set(told.tolist()) == {math.floor(expected * PARTS), math.ceil(expected * PARTS)}
    assert told.mean() / PARTS == pytest.approx(expected, abs=0.002)
    assert (chances == NO_CHANCE).sum() == cells.size - 1


@pytest.mark.jit
def test_published_variant_draws_as_its_twin():
    index = window_of(two_scans()).index
    cells = some_map(np.random.default_rng(5))
    draw = naive.PatchDraw(
        naive.rays_of(index), cells.tolist(), WIDTH, PLACES[0], handmade_table()
    )
    sampler = PatchModel(index, WIDTH, handmade_table(), random_share=0.3)
    present = naive.pattern_at(cells, WIDTH, *PLACES[0], 3)
    seen = kernel_frequencies(sampler, cells, PLACES[0], 0.0, 6000, 23)
    assert abs(disagreement(seen, draw.transition(0.0, 0.3)[present])) < 4.0
