"""Draws from log-odds that are kept are those that look at every ray."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.kept_hits import assert_hits_are_those_of_the_map
from support.strategies import REPEATABLE, fan
from support.tiny_problems import tiny_problems

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.engine.posterior import Grown
from ogm_mcmc.engine.warp import laid_on
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, RayWindow
from ogm_mcmc.sampling.cell_gibbs import draw_cells
from ogm_mcmc.sampling.first_hits import first_hits
from ogm_mcmc.sampling.kept_odds import odds_to_keep, zones_of
from ogm_mcmc.sampling.kept_odds_kernels import (
    ARRIVING,
    AT,
    BEFORE,
    LOG_ODDS,
    NEXT,
    NOBODY,
    least_free,
    least_log_odds,
)
from ogm_mcmc.sampling.ray_index_kernels import NOTHING, WIDTH
from ogm_mcmc.sampling.ray_path_kernels import CELL, ENDS, FAR, OFFSET, SLIP


def assert_same_draws(model, start, seed, sweeps, before=None):
    ours, plain = model.start(start, before), model.start(start)
    rngs = [np.random.default_rng(seed) for _ in range(2)]
    for _ in range(sweeps):
        flips = model.advance(rngs[0], ours)
        expected = draw_cells(
            rngs[1], model.touched, plain, model.index, model.ceiling, model.prior_log_odds
        )
        assert flips == expected
        assert np.array_equal(ours.cells, plain.cells)
        assert np.array_equal(ours.records[:, :2], plain.records[:, :2])
        assert np.array_equal(ours.records[:, :2], first_hits(ours.cells, model.index)[:, :2])


@given(problem=tiny_problems(max_cells=12, max_scans=5), seed=st.integers(0, 1000))
@settings(REPEATABLE, max_examples=25)
def test_draws_of_small_windows(problem, seed):
    window = problem.indexed()
    assume(odds_to_keep(window.index, zones_of(window.index)).odds.size > 0)
    model = CellModel(window.index, problem.prior_log_odds, window.spec.width)
    start = (np.random.default_rng(seed).random(model.n_cells) < 0.5).astype(np.uint8)
    assert_same_draws(model, start, seed, 4)


def room(sigma_m, wrong=0):
    """A model of a square room of 12 m from nine places; the first `wrong` readings are short."""
    places = [Pose2D(x, y, 0.1 * x) for x in (-3.0, 0.1, 2.7) for y in (-2.2, 0.4, 3.1)]
    bearings = np.linspace(-math.pi, math.pi, 60, endpoint=False)
    window = RayWindow(
        WindowConfig(resolution=0.2), ForwardModelConfig(kind='gaussian', sigma=sigma_m)
    )
    for pose in places:
        ux, uy = np.cos(bearings + pose.yaw_rad), np.sin(bearings + pose.yaw_rad)
        along = [(6.0 - np.sign(u) * p) / np.abs(u) for u, p in ((ux, pose.x_m), (uy, pose.y_m))]
        ranges = np.minimum(*along)
        ranges[:wrong] *= 0.5
        scan = fan(*ranges, bearing=bearings[0], increment=bearings[1] - bearings[0])
        window.add([PlacedScan.at(scan, pose)])
    return CellModel(window.index, math.log(0.15 / 0.85), window.spec.width)


@pytest.mark.parametrize(('sigma_m', 'wrong'), [(0.4, 0), (0.15, 0), (0.15, 20)])
@pytest.mark.parametrize('share', [0.0, 0.3, 1.0])
def test_draws_of_a_room_from_any_start(sigma_m, wrong, share):
    """Full and wild starts let most rays end far off, contradicted readings some for good."""
    model = room(sigma_m, wrong)
    start = (np.random.default_rng(1).random(model.n_cells) < share).astype(np.uint8)
    assert_same_draws(model, start, 2, 12)


def test_draws_of_a_window_that_grew_and_shrank():
    """What is kept begins anew on the rays that stayed and those that came."""
    bearings = np.linspace(-math.pi, math.pi, 40, endpoint=False)
    ranges = np.random.default_rng(8).uniform(1.0, 5.0, (6, bearings.size))
    scans = [
        PlacedScan.at(
            fan(*each, bearing=bearings[0], increment=bearings[1] - bearings[0]),
            Pose2D(0.7 * i - 2.0, 0.3 * i, 0.1 * i),
        )
        for i, each in enumerate(ranges)
    ]
    window = RayWindow(
        WindowConfig(resolution=0.2),
        ForwardModelConfig(kind='gaussian', sigma=0.3),
        merge=True,
    )
    window.add(scans[:4])
    rng, sizes = np.random.default_rng(9), [window.index.n_rays]
    for gone, come in (([], scans[4:5]), (scans[:2], []), (scans[2:3], scans[5:])):
        model = CellModel(window.index, -1.7, window.spec.width)
        state, spec = model.start(np.zeros(model.n_cells, np.uint8)), window.spec
        assert sum(model.advance(rng, state) for _ in range(3)) > 10
        dropped = window.drop(gone) if gone else None
        window.add([*(dropped.again if dropped else ()), *come])
        [before] = Grown(model, [state], spec, dropped).hits(window)
        start = laid_on(state.cells, spec, window.spec, 0)
        sizes.append(window.index.n_rays)
        assert_same_draws(CellModel(window.index, -1.7, window.spec.width), start, 10, 4, before)
    assert sizes[0] < sizes[1] > sizes[2] == sizes[3]


def test_nothing_told_of_what_lies_behind_first_hits_is_left_to_grow_old():
    """Plain draws of cells look behind first hits; other sweeps flip what they saw."""
    model = room(0.4)
    state = model.start(np.ones(model.n_cells, np.uint8))
    rng, told = np.random.default_rng(3), 0
    for _ in range(2):
        model.forget(rng, state, model.prior_log_odds, 1)
        width = model.index.grid[WIDTH]
        told += assert_hits_are_those_of_the_map(state, model.index, width)
        assert model.advance(rng, state) > 10
        assert_hits_are_those_of_the_map(state, model.index, width)
    assert told > 100


def by_definition(model, state):
    """Log-odds (K,) of each cell given the others, how many rays arrive, and the slack allowed.

    A ray may count as ending at `SLIP` below its best in cells in front of its zone.
    """
    odds = np.full(model.n_cells, model.prior_log_odds)
    arriving, slack = np.zeros((2, model.n_cells))
    for n in range(model.index.n_rays):
        cells, said, unseen = model.index.ray(n)
        values = np.append(said, unseen).astype(np.float64)
        hits = np.append(np.flatnonzero(state.cells[cells]), cells.size)
        here = np.arange(min(hits[0] + 1, cells.size))
        ends = np.where(here == hits[0], hits[min(1, hits.size - 1)], hits[0])
        odds[cells[here]] += values[here] - values[ends]
        arriving[cells[here]] += 1
        zone = np.flatnonzero(said >= values.max() - FAR)
        far = here[here < (zone[0] if zone.size else cells.size - 1)]
        slack[cells[far]] += np.maximum(values[ends[far]] - (values.max() - SLIP), 0.0)
    return odds, arriving, slack


@pytest.mark.parametrize('sigma_m', [0.15, 0.4])
def test_what_is_kept_is_what_the_map_says(sigma_m):
    """Of every free cell where a ray arrives; what was told of rays that changed, too."""
    model = room(sigma_m, wrong=10)
    state, rng = model.start(np.zeros(model.n_cells, np.uint8)), np.random.default_rng(4)
    for _ in range(3):
        assert model.advance(rng, state) > 10
    odds, arriving, slack = by_definition(model, state)
    kept = state.odds[:, LOG_ODDS].astype(np.float64)
    assert np.array_equal(np.isnan(kept), arriving == 0)
    assert np.isinf(kept[(arriving > 0) & (state.cells != 0)]).all()
    free = (arriving > 0) & (state.cells == 0)
    assert np.array_equal(state.odds.view(np.int32)[free, ARRIVING], arriving[free])
    known = free & np.isfinite(kept)
    assert np.count_nonzero(known) > 0.99 * np.count_nonzero(free) > 1000
    over = kept[known] - odds[known]
    rounding = 1e-6 * (np.abs(odds[known]) + 100.0)
    assert (over > -rounding).all()
    assert (over < slack[known] + 20.0 * rounding).all()


def test_rays_that_end_in_a_cell_hang_together():
    """As told of flips, after sweeps from a wild start, beside what records say."""
    model = room(0.4, wrong=10)
    start = (np.random.default_rng(1).random(model.n_cells) < 0.3).astype(np.uint8)
    state, rng = model.start(start), np.random.default_rng(4)
    for _ in range(3):
        assert model.advance(rng, state) > 10
    paths, ways = model.zones.paths, state.ways
    hit = state.records[:, 0] != NOTHING
    at = np.where(hit, state.records[:, 0] + ways[:, OFFSET], ways[:, ENDS])
    assert np.array_equal(ways[:, AT], at)
    ends = paths[at, CELL]
    met = 0
    for cell in np.unique(ends[hit]):
        ray, last, mine = state.odds.view(np.int32)[cell, ARRIVING], NOBODY, []
        while ray != NOBODY:
            assert ways[ray, BEFORE] == last
            mine.append(ray)
            ray, last = ways[ray, NEXT], ray
        assert sorted(mine) == np.flatnonzero(ends == cell).tolist()
        met += len(mine)
    assert met == np.count_nonzero(hit) > 100


def test_random_numbers_are_compared_without_a_logarithm():
    """What is compared is never above the logit, and seldom far below it."""
    numbers = np.concatenate(
        (
            np.random.default_rng(7).random(1000),
            2.0 ** -np.arange(1, 54),
            1.0 - 2.0 ** -np.arange(1, 54),
        )
    )
    least = np.empty(numbers.size, np.float32)
    least_log_odds(numbers, least)
    low = least.astype(np.float64)
    assert (low <= np.log(numbers / (1.0 - numbers))).all()
    assert (low > np.log(numbers) - 0.061).all()
    least_log_odds(np.zeros(1), least)
    assert least[0] == -np.inf


@pytest.mark.parametrize('prior', [-1.7, 0.0, 2.5])
def test_cells_that_no_ray_reaches_follow_the_same_comparison(prior):
    u = least_free(prior)
    below = u - 2.0**-53
    assert not prior > math.log(u / (1.0 - u))
    assert prior > math.log(below / (1.0 - below))


def test_a_copy_goes_on_with_what_is_kept():
    model = room(0.4)
    state = model.start(np.zeros(model.n_cells, np.uint8))
    model.advance(np.random.default_rng(5), state)
    copy = state.copy()
    assert np.array_equal(copy.odds, state.odds, equal_nan=True)
    assert np.array_equal(copy.ways, state.ways)
    assert copy.odds is not state.odds
    assert copy.ways is not state.ways
    assert model.advance(np.random.default_rng(6), copy) == model.advance(
        np.random.default_rng(6), state
    )
    assert np.array_equal(copy.cells, state.cells)


def test_memory_of_zones_is_counted_where_they_are_kept():
    """At most what was asked of the limit is held, and without zones less would do."""
    scans = [PlacedScan.at(fan(*[9.0] * 60, increment=0.1), Pose2D(x, 0.1)) for x in (0.0, 0.4)]
    given = ForwardModelConfig(kind='gaussian', sigma=0.4)
    config = WindowConfig(resolution=0.02)
    window, without = (RayWindow(config, given, chains=chains) for chains in (2, 0))
    window.add(scans)
    size, less = (one.sum_of_sizes(scans) for one in (window, without))
    zones = zones_of(window.index)
    assert zones.n_bytes == sum(array.nbytes for array in zones) > 0.3 * window.index.near.nbytes
    assert zones.n_bytes <= size.n_bytes - less.n_bytes <= 1.5 * zones.n_bytes
    assert window.index.n_bytes + zones.n_bytes <= size.n_bytes
    ways = odds_to_keep(window.index, zones).ways.nbytes
    one = RayWindow(config, given, chains=1).sum_of_sizes(scans)
    assert size.n_bytes - one.n_bytes == ways > 0
    scarce = replace(config, max_memory_mb=0.5e-6 * (size.n_bytes + less.n_bytes))
    RayWindow(scarce, given).add(scans)
    with pytest.raises(WindowError, match='expected at most max_memory_mb'):
        RayWindow(scarce, given, chains=2).add(scans)
    level = RayWindow(config, ForwardModelConfig(), chains=2).sum_of_sizes(scans)
    assert level.n_bytes == RayWindow(config, ForwardModelConfig()).sum_of_sizes(scans).n_bytes


def test_rays_that_are_level_somewhere_are_drawn_as_ever():
    window = RayWindow(WindowConfig(resolution=0.2), ForwardModelConfig(sigma=0.05))
    window.add([PlacedScan.at(fan(5.0), Pose2D(0.0, 0.0))])
    assert window.index.runs.size > 0
    assert odds_to_keep(window.index, zones_of(window.index)).odds.size == 0
