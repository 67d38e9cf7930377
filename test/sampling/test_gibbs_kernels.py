"""Conditionals and first hits for every map of small windows."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.conditionals import conditional_log_odds
from support.kept_hits import assert_hits_are_those_of_the_map
from support.strategies import REPEATABLE
from support.tiny_problems import cell_numbers, tiny_problems

from ogm_mcmc.sampling import CellModel
from ogm_mcmc.sampling.cell_gibbs import draw_cells
from ogm_mcmc.sampling.first_hit_kernels import find_first_hits
from ogm_mcmc.sampling.gibbs_kernels import (
    NO_CHANCE,
    PARTS,
    add_occupied,
    sweep_cells,
)
from ogm_mcmc.sampling.ray_index_kernels import NOTHING
from ogm_mcmc.sampling.ray_line_kernels import SHAPE, START, first_place

approx = pytest.approx


def prepared(problem):
    """Twin, window, model, and where the twin's cells are in the window."""
    naive, window = problem.naive(), problem.indexed()
    model = CellModel(window.index, problem.prior_log_odds, window.spec.width)
    return naive, window, model, np.array(cell_numbers(window.spec, naive.touched))


def as_cells(number, places, n_cells):
    """Map `number` of the twin as an array of the window."""
    cells = np.zeros(n_cells, np.uint8)
    cells[places] = number >> np.arange(places.size) & 1
    return cells


@given(problem=tiny_problems(max_cells=7))
@settings(REPEATABLE, max_examples=60)
def test_conditional_equals_enumerated_joint_for_every_map_and_cell(problem):
    naive, _, model, places = prepared(problem)
    assert model.touched.tolist() == places.tolist()
    log_joint = naive.enumerate_log_joint()
    for number in range(log_joint.size):
        state = model.start(as_cells(number, places, model.n_cells))
        for b, cell in enumerate(places):
            expected = log_joint[number | 1 << b] - log_joint[number & ~(1 << b)]
            found = conditional_log_odds(cell, state, model.index, model.prior_log_odds)
            assert found == approx(expected, abs=1e-4, rel=1e-5)


@given(problem=tiny_problems(max_cells=8))
@settings(REPEATABLE, max_examples=60)
def test_likelihood_and_prior_of_every_map(problem):
    naive, _, model, places = prepared(problem)
    for number in range(2**places.size):
        state = model.start(as_cells(number, places, model.n_cells))
        occupied = naive.map_of(number)
        assert model.log_likelihood(state) == approx(
            naive.log_likelihood(occupied), abs=1e-4, rel=1e-5
        )
        assert model.log_prior(state) == approx(len(occupied) * naive.log_odds_before)


@given(problem=tiny_problems(max_cells=9), number=st.integers(0, 2**9 - 1))
@REPEATABLE
def test_first_hits_by_definition(problem, number):
    naive, _, model, places = prepared(problem)
    number %= 2**places.size
    records = model.start(as_cells(number, places, model.n_cells)).records
    rays = model.index.rays
    occupied = naive.map_of(number)
    for n, (ray, record) in enumerate(zip(naive.rays, records, strict=True)):
        hits = [cell for cell in ray.cells if cell in occupied]
        place = NOTHING
        if hits:
            gone = abs(hits[0][0] - ray.cells[0][0]) + abs(hits[0][1] - ray.cells[0][1])
            place = first_place(rays[n, START], rays[n, SHAPE]) + gone
        assert record[0] == place


@given(problem=tiny_problems(max_cells=12, max_scans=5), seed=st.integers(0, 1000))
@settings(REPEATABLE, max_examples=60)
def test_kept_hits_are_those_of_the_map_after_any_flips(problem, seed):
    """Flips of every kind: hot chains flip all the time, cold ones now and then."""
    _, window, model, _ = prepared(problem)
    rng = np.random.default_rng(seed)
    state = model.start(np.ones(model.n_cells, np.uint8))
    flips = 0
    for _ in range(12):
        ceiling = np.full(model.n_cells, 2.0, np.float32)
        log_odds = rng.uniform(-4.0, 4.0)
        order = rng.permutation(model.touched)
        before = state.cells.copy()
        flipped = draw_cells(rng, order, state, model.index, ceiling, log_odds)
        assert flipped == np.count_nonzero(before != state.cells)
        flips += flipped
        assert_hits_are_those_of_the_map(state, model.index, window.spec.width)
    assert flips > 0


@given(problem=tiny_problems(max_cells=7))
@settings(REPEATABLE, max_examples=60)
def test_ceiling_is_above_the_conditional_of_every_map(problem):
    naive, _, model, places = prepared(problem)
    log_joint = naive.enumerate_log_joint()
    numbers = np.arange(log_joint.size)
    for b, k in enumerate(places):
        log_odds = log_joint[numbers | 1 << b] - log_joint[numbers & ~(1 << b)]
        p = 1.0 / (1.0 + math.exp(-log_odds.max()))
        assert p <= model.ceiling[k] * (1.0 + 1e-5)
        # And some use: no more than all rays together say at best.
        adds = log_odds.max() - naive.log_odds_before
        assert adds <= model.index.gains()[k] * (1.0 + 1e-6) + 2e-5


def test_counting_the_occupied():
    cells = np.array([0, 1, 1, 0, 1], np.uint8)
    counts = np.array([5, 6, 7], np.uint16)
    chances = np.array([NO_CHANCE, NO_CHANCE, 3, 4, 40], np.uint8)
    add_occupied(cells, chances, np.array([0, 1, 4], np.int32), counts)
    assert counts.tolist() == [5, 6 + PARTS, 47]
    # A probability counts once, in place of what was drawn.
    assert chances.tolist() == [NO_CHANCE, NO_CHANCE, 3, 4, NO_CHANCE]


@pytest.mark.jit
@given(problem=tiny_problems(max_cells=6))
@settings(REPEATABLE, max_examples=10)
def test_one_specialization_of_each_kernel(problem):
    rng = np.random.default_rng(1)
    for order in ('fixed', 'random', 'checkerboard'):
        window = problem.indexed()
        window.add(problem.placed)
        model = CellModel(window.index, problem.prior_log_odds, window.spec.width, order)
        state = model.start(np.zeros(model.n_cells, np.uint8))
        model.advance(rng, state)
    for kernel in (sweep_cells, find_first_hits):
        assert len(kernel.signatures) == 1, (kernel.__name__, kernel.signatures)
