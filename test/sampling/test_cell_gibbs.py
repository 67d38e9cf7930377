"""Sweeps over single cells: the same maps as the slow twin, and the right distribution."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.conditionals import conditional_log_odds
from support.naive_posterior import NaivePosterior
from support.strategies import REPEATABLE, fan
from support.tiny_problems import TinyProblem, cell_numbers, tiny_problems

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow, sweep
from ogm_mcmc.sampling.cell_gibbs import ORDERS, start
from ogm_mcmc.sampling.first_hit_kernels import find_first_hits

approx = pytest.approx

INF = float('inf')
COMPILED = hasattr(find_first_hits, 'signatures')


def model_of(window, prior, order='fixed'):
    log_odds = float(np.log(prior / (1.0 - prior)))
    return CellModel(window.index, log_odds, window.spec.width, order)


def problem(kind='beam', prior=0.2, **settings):
    """Two sensors that look at the same few cells, one of them seeing past what the other sees."""
    model = ForwardModelConfig(kind=kind, **{'sigma': 0.7, 'clutter': 0.1, **settings})
    placed = (
        PlacedScan.at(fan(1.6, 2.3, increment=0.35, range_max_m=3.5), Pose2D(0.3, 0.4, 0.1)),
        PlacedScan.at(fan(INF, 1.1, increment=0.5, range_max_m=3.5), Pose2D(0.6, 1.3, -0.4)),
    )
    return TinyProblem(model, WindowConfig(resolution=1.0, cut_sigma=0.0), prior, placed)


# -- the same draws as the twin -------------------------------------------------------------------


def in_order(model, window, naive, rng):
    """The cells of the next sweep, in the order that is documented; uses up what it needs."""
    cells = naive.touched
    if model.order == 'random':
        places = rng.permutation(model.touched)
        return [
            (
                k % window.spec.width + window.spec.column0,
                k // window.spec.width + window.spec.row0,
            )
            for k in places.tolist()
        ]
    if model.order == 'checkerboard':
        even = [
            c for c in cells if (c[0] + c[1] - window.spec.column0 - window.spec.row0) % 2 == 0
        ]
        return even + [c for c in cells if c not in even]
    return cells


def assert_same_maps(window, naive, model, sweeps, seed=3):
    fast, slow = np.random.default_rng(seed), np.random.default_rng(seed)
    places = np.array(cell_numbers(window.spec, naive.touched))
    occupied = set(naive.touched[::2])
    cells = np.zeros(model.n_cells, np.uint8)
    cells[places[::2]] = 1
    state = model.start(cells)
    flips = 0
    for _ in range(sweeps):
        naive.sweep(slow, occupied, in_order(model, window, naive, slow))
        flips += model.advance(fast, state)
        found = [cell for cell, k in zip(naive.touched, places, strict=True) if state.cells[k]]
        assert found == [cell for cell in naive.touched if cell in occupied]
    assert fast.random() == slow.random()  # as many numbers were used
    return flips


@pytest.mark.parametrize('order', ORDERS)
@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
@pytest.mark.parametrize('prior', [0.5, 0.15, 0.01, 0.9])
def test_same_maps_as_evaluating_everything(kind, prior, order):
    """Neither the ceiling nor the early end ever changes a draw."""
    tiny = problem(kind, prior)
    window, naive = tiny.indexed(), tiny.naive()
    flips = assert_same_maps(window, naive, model_of(window, prior, order), sweeps=150)
    assert flips > 10


@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
@pytest.mark.parametrize('cut', [0.0, 3.0])
def test_same_maps_in_a_larger_window(kind, cut):
    """A hundred cells with up to a dozen rays each, most of them decided."""
    rng = np.random.default_rng(8)
    placed = [
        PlacedScan.at(
            fan(*rng.uniform(0.4, 2.2, 7), bearing=-3.0, increment=0.85, range_max_m=2.5),
            Pose2D(*rng.uniform(-0.6, 0.6, 2), rng.uniform(-3.0, 3.0)),
        )
        for _ in range(5)
    ]
    model = ForwardModelConfig(kind=kind, sigma=0.25)
    config = WindowConfig(resolution=0.4, cut_sigma=cut)
    naive = NaivePosterior(model, config, 0.2, placed)
    assert naive.margin > 1e-9
    window = RayWindow(config, model)
    window.add(placed)
    assert len(naive.touched) > 80
    assert assert_same_maps(window, naive, model_of(window, 0.2), sweeps=25) > 30


@given(tiny=tiny_problems(), order=st.sampled_from(ORDERS), seed=st.integers(0, 99))
@settings(REPEATABLE, max_examples=80)
def test_same_maps_for_any_small_problem(tiny, order, seed):
    window, naive = tiny.indexed(), tiny.naive()
    assert_same_maps(window, naive, model_of(window, tiny.prior, order), sweeps=8, seed=seed)


# -- the right distribution -----------------------------------------------------------------------


def transition_matrix(model, order, conditional):
    """The chance of every map after a sweep, from every map: one draw of each cell in turn."""
    size = 2**model.touched.size
    matrix = np.eye(size)
    for b in order:
        draw = np.zeros((size, size))
        for number in range(size):
            p = 1.0 / (1.0 + np.exp(-conditional(number, b)))
            draw[number, number | 1 << b] = p
            draw[number, number & ~(1 << b)] = 1.0 - p
        matrix = matrix @ draw
    return matrix


@given(tiny=tiny_problems(max_cells=6))
@settings(REPEATABLE, max_examples=40)
def test_a_sweep_leaves_the_posterior_as_it_is(tiny):
    """pi P = pi with the kernel's own conditionals, for the posterior of the twin; and P mixes."""
    window, naive = tiny.indexed(), tiny.naive()
    model = model_of(window, tiny.prior)
    states = []
    for number in range(2**model.touched.size):
        cells = np.zeros(model.n_cells, np.uint8)
        cells[model.touched] = number >> np.arange(model.touched.size) & 1
        states.append(model.start(cells))

    def conditional(number, b):
        state, cell = states[number], model.touched[b]
        return conditional_log_odds(cell, state, model.index, model.prior_log_odds)

    posterior = naive.probabilities()
    matrix = transition_matrix(model, range(model.touched.size), conditional)
    assert matrix.sum(axis=1) == approx(np.ones(posterior.size))
    assert posterior @ matrix == approx(posterior, abs=1e-6)
    # Any map can follow any other: nothing else is invariant.
    assert matrix.min() > 0.0


@pytest.mark.parametrize('order', ORDERS)
@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
def test_long_runs_converge_to_the_exact_marginals(kind, order):
    """Within 4.5 of their own standard errors, once there are enough effective samples."""
    tiny = problem(kind, prior=0.3)
    window, naive = tiny.indexed(), tiny.naive()
    exact = naive.marginals()
    # An asymmetric target: nothing would be found if all were near one half.
    assert exact.max() - exact.min() > 0.3
    model = model_of(window, 0.3, order)
    starts = [np.zeros(model.n_cells, np.uint8), np.ones(model.n_cells, np.uint8)]
    sampler = PosteriorSampler(model, starts, seed=5, burn_in=100)
    sampler.advance(20_100 if COMPILED else 1_500)
    quality = sampler.quality()
    assert quality.r_hat.max() < (1.02 if COMPILED else 1.2)
    assert np.abs(sampler.estimate().mean - exact).max() < 0.05
    judged = np.minimum(exact, 1.0 - exact) > 0.02
    assert judged.sum() >= 4
    assert quality.ess[judged].min() > (1000 if COMPILED else 50)
    # Of all cells, also those that were never seen occupied.
    assert (np.abs(quality.mean - exact) < 4.5 * quality.mcse).all()


# -- State, Info, orders --------------------------------------------------------------------------


@pytest.mark.parametrize('order', ORDERS)
def test_every_touched_cell_is_drawn_once_a_sweep(order):
    """Seen from outside: as many uniform numbers, and from any start all cells can change."""
    tiny = problem(prior=0.5, clutter=0.5, missing=0.4, sigma=5.0)
    window = tiny.indexed()
    model = model_of(window, 0.5, order)
    rng = np.random.default_rng(1)
    changed = np.zeros(model.n_cells, bool)
    for _ in range(60):
        twin = np.random.default_rng()
        twin.bit_generator.state = rng.bit_generator.state
        state = model.start(np.zeros(model.n_cells, np.uint8))
        model.advance(rng, state)
        changed |= state.cells != 0
        if order == 'random':
            twin.permutation(model.touched)
        twin.random(model.touched.size)
        assert twin.bit_generator.state == rng.bit_generator.state
    assert np.flatnonzero(changed).tolist() == model.touched.tolist()


def test_checkerboard_draws_no_two_neighbours_in_a_row():
    window = problem().indexed()
    model = model_of(window, 0.2, 'checkerboard')
    order = model._checkered
    assert sorted(order.tolist()) == model.touched.tolist()
    rows, columns = np.divmod(order, window.spec.width)
    colour = (rows + columns) % 2
    assert np.count_nonzero(np.diff(colour)) == 1


def test_a_sweep_leaves_its_state_alone_and_says_what_it_did():
    tiny = problem()
    window = tiny.indexed()
    model, naive = model_of(window, 0.2), tiny.naive()
    state = start(np.ones(model.n_cells, np.uint8), model)
    cells, records = state.cells.copy(), state.records.copy()
    after, info = sweep(np.random.default_rng(2), state, model)
    assert np.array_equal(state.cells, cells)
    assert np.array_equal(state.records, records)
    assert info.flips == np.count_nonzero(after.cells != cells) > 0
    assert info.occupied == np.count_nonzero(after.cells)
    places = cell_numbers(window.spec, naive.touched)
    occupied = {cell for cell, k in zip(naive.touched, places, strict=True) if after.cells[k]}
    assert info.log_likelihood == approx(naive.log_likelihood(occupied), abs=1e-4)
    # Up to the same constant for all maps.
    constant = info.log_posterior - naive.log_joint(occupied)
    assert constant == approx(-len(naive.touched) * naive.log_free, abs=1e-4)


def test_cells_no_ray_crosses_stay_free():
    model = model_of(problem().indexed(), 0.2)
    assert model.touched.size < model.n_cells
    state = model.start(np.ones(model.n_cells, np.uint8))
    assert np.flatnonzero(state.cells).tolist() == model.touched.tolist()


def test_what_does_not_fit_is_refused():
    window = problem().indexed()
    with pytest.raises(ConfigError, match="order is 'spiral': one of fixed, random, checkerboard"):
        model_of(window, 0.2, 'spiral')
    model = model_of(window, 0.2)
    with pytest.raises(GridError, match=r'start map of 3 cells: expected the \d+ of the window'):
        model.start(np.zeros(3, np.uint8))
