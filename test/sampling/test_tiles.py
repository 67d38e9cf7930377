"""Tiles of a map: what each holds, that it draws as the whole does, that the posterior stays."""

import math

import numpy as np
import pytest
from support import naive_patch_sampler as naive
from support.conditionals import conditional_log_odds
from support.local_tiles import MODEL, PRIOR, WINDOW, inside, room, some_map, tiled
from support.strategies import fan

from ogm_mcmc.config import WindowConfig
from ogm_mcmc.engine.prior_files import default_prior_file, load_prior
from ogm_mcmc.errors import GridError, WindowError
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.lab.exact import enumerate_maps
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow
from ogm_mcmc.sampling.cell_gibbs import draw_cells
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_prior import make_table
from ogm_mcmc.sampling.tiles import MapTile, colours, tiling_of


@pytest.fixture(scope='module')
def buildings():
    return make_table('border', 9, load_prior(default_prior_file(), 0.05).counts)


def place_in_boxes(spec, tile, cells):
    height = spec.height
    return cells.reshape(height, -1)[spec.slices(tile.box)].reshape(-1)


@pytest.mark.parametrize(('columns', 'rows', 'side'), [(2, 1, 0), (3, 3, 0), (2, 2, 3)])
def test_conditionals_are_those_of_the_whole(scans, window, columns, rows, side):
    """Of any map: the likelihood, what lies behind, and the log-odds of every cell of a tile."""
    tiling = tiling_of(window.spec, columns, rows, side)
    model, tiles = tiled(scans, WINDOW, MODEL, tiling, None)
    whole = CellModel(window.index, PRIOR, window.spec.width)
    compared = 0
    for seed, share in enumerate((0.0, 0.03, 0.15, 0.6)):
        state = model.start(some_map(whole.n_cells, seed, share))
        same = whole.start(state.cells)
        assert np.array_equal(same.cells, state.cells)
        assert model.log_likelihood(state) == pytest.approx(whole.log_likelihood(same), abs=1e-4)
        for number, tile in enumerate(tiling.tiles):
            sampler = tiles.samplers[number]
            local = sampler.rays.local
            cells = np.ascontiguousarray(place_in_boxes(window.spec, tile, state.cells))
            records = sampler.first_hits(cells, model.summaries.outside(number, state.records))
            within, there = inside(window.spec, whole.touched, tile.box)
            for cell, mine in zip(whole.touched[within], there[within], strict=True):
                expected = conditional_log_odds(cell, same, window.index, PRIOR)
                found = conditional_log_odds(mine, (cells, records), local, PRIOR)
                assert found == pytest.approx(expected, abs=2e-4)
                compared += 1
    assert compared > 400


def test_a_tile_draws_what_the_whole_would(scans, window):
    tiling = tiling_of(window.spec, 2, 2, 0)
    model, _ = tiled(scans, WINDOW, MODEL, tiling, None, log_odds=PRIOR)
    whole = CellModel(window.index, PRIOR, window.spec.width)
    flips = 0
    state = model.start(some_map(whole.n_cells, 1))
    same = whole.start(state.cells)
    for turn in range(5):
        for number, tile in enumerate(tiling.tiles):
            job = model._job(state, number, turn, None, model._masks[number], PRIOR)
            mine = whole.touched[inside(window.spec, whole.touched, tile.box)[0]]
            flips += model._do(state, {number: job})
            rng = np.random.default_rng(turn)
            draw_cells(rng, mine, same, window.index, whole.ceiling, PRIOR)
            assert np.array_equal(state.cells, same.cells)
    assert flips > 20
    assert np.array_equal(model.start(state.cells).records, state.records, equal_nan=True)


@pytest.mark.jit
def test_a_tile_draws_the_patches_that_the_whole_would(scans, window, buildings):
    tiling = tiling_of(window.spec, 2, 2, 3)
    model, _ = tiled(scans, WINDOW, MODEL, tiling, buildings, margin=5, escape=0.1)
    whole = PatchModel(
        window.index, window.spec.width, buildings, margin=5, flip_cells=True, escape=0.1
    )
    assert np.array_equal(model.touched, whole.touched)
    assert all(map(np.array_equal, model._places.active, whole._places.active))
    assert all(map(np.array_equal, model._places.dull, whole._places.dull))
    state = model.start(some_map(whole.n_cells, 1))
    same = whole.start(state.cells)
    assert np.array_equal(same.cells, state.cells)
    flips, drawn = 0, 0
    for turn in range(6):
        corners = whole.order_of_sweep(np.random.default_rng(turn))
        for number in range(4):
            mine = corners[tiling.tile_of(corners) == number]
            drawn += mine.size
            there = tiling.in_box(number, mine)
            job = model._job(state, number, turn, there, np.empty(0, np.uint8), 0.1)
            flips += model._do(state, {number: job})
            whole.draw_patches(np.random.default_rng(turn), mine, same, 0.1)
            assert np.array_equal(state.cells, same.cells)
    assert flips > 50
    assert drawn > 6 * whole.touched.size / 9 * 0.3
    assert np.array_equal(model.start(state.cells).records, state.records, equal_nan=True)
    assert model.log_likelihood(state) == pytest.approx(whole.log_likelihood(same), abs=1e-3)


# -- the transition matrix on all maps of a small world ------------------------------------------


def corridor(readings):
    """Beams along single rows of cells: the rows do not share a ray."""
    return [
        PlacedScan.at(fan(reading, range_max_m=8.0), Pose2D(0.5, row + 0.5, 0.0))
        for row, reading in readings
    ]


def matrix_of_tile(model, tiles, number, touched):
    """Transition matrix (2^C, 2^C) of one draw of a tile, from what it says of each cell."""
    spec, tile = model.tiling.spec, model.tiling.tiles[number]
    within, there = inside(spec, touched, tile.box)
    maps = naive.maps_of([0] * model.n_cells, list(touched))
    total = np.eye(len(maps))
    for bit in np.flatnonzero(within):
        step = np.zeros_like(total)
        for at, cells in enumerate(maps):
            state = model.start(np.array(cells, np.uint8))
            mine = np.ascontiguousarray(place_in_boxes(spec, tile, state.cells))
            sampler = tiles.samplers[number]
            records = sampler.first_hits(mine, model.summaries.outside(number, state.records))
            log_odds = conditional_log_odds(there[bit], (mine, records), sampler.rays.local, PRIOR)
            occupied = 1.0 / (1.0 + math.exp(-log_odds))
            step[at, at & ~(1 << bit)] += 1.0 - occupied
            step[at, at | (1 << bit)] += occupied
        total = total @ step
    return total


def at_once(first, second, mine):
    """Draw two tiles given the same map; `mine`: the bits of the first."""
    n = len(first)
    numbers = np.arange(n)
    one, other = numbers & mine, numbers & ~mine & (n - 1)
    # From m, the first leaves the cells of the second as they are, and the other way round.
    return np.array(
        [first[m, one | (m & ~mine)] * second[m, other | (m & mine)] for m in range(n)]
    )


@pytest.fixture(scope='module')
def small_world():
    """Two rows of cells, seen by two beams and one, cut into 2 x 2 tiles."""
    scans = corridor([(0, 1.3), (0, 2.1), (2, 1.3)])
    window = WindowConfig(resolution=1.0, cut_sigma=1.0)
    whole = RayWindow(window, MODEL)
    whole.add(scans)
    tiling = tiling_of(whole.spec, 2, 2, 0)
    model, tiles = tiled(scans, window, MODEL, tiling, None, log_odds=PRIOR)
    exact = enumerate_maps(whole.index, PRIOR)
    assert exact.touched.size == 7
    matrices = [matrix_of_tile(model, tiles, n, exact.touched) for n in range(4)]
    bits = [
        int((inside(whole.spec, exact.touched, tile.box)[0] << np.arange(7)).sum())
        for tile in tiling.tiles
    ]
    return model, exact, matrices, bits


def test_a_tile_leaves_the_posterior_as_it_is(small_world):
    _, exact, matrices, bits = small_world
    posterior = exact.probabilities()
    assert sum(bits) == 127
    for matrix in matrices:
        assert np.abs(posterior @ matrix - posterior).max() < 1e-6
    assert np.abs(matrices[0] - np.eye(128)).max() > 0.1


def test_tiles_that_share_no_ray_may_be_drawn_at_once_and_others_may_not(small_world):
    model, exact, matrices, bits = small_world
    posterior = exact.probabilities()
    apart = at_once(matrices[0], matrices[2], bits[0])
    assert np.abs(posterior @ apart - posterior).max() < 1e-6
    sharing = at_once(matrices[0], matrices[1], bits[0])
    assert np.abs(posterior @ sharing - posterior).max() > 1e-3
    groups = model.summaries.groups
    assert sorted(number for group in groups for number in group) == [0, 1, 2, 3]
    assert all({0, 1} - set(group) and {2, 3} - set(group) for group in groups)
    assert len(groups) == 2


def test_samples_of_tiles_are_of_the_posterior(small_world):
    model, exact, *_ = small_world
    sampler = PosteriorSampler(model, [np.zeros(model.n_cells, np.uint8)] * 2, seed=2, burn_in=50)
    sampler.advance(300)
    quality = sampler.quality()
    error = quality.mean - exact.marginals
    assert (np.abs(error) < 4.5 * quality.mcse + 1e-3).all()
    assert sampler.log_likelihoods()[0] < 0.0


# -- tilings --------------------------------------------------------------------------------------


@pytest.mark.parametrize('side', [0, 3, 5])
def test_cores_divide_a_window_and_boxes_hold_its_patches(side):
    spec = GridSpec(0.1, 53, 41, -7, 11)
    tiling = tiling_of(spec, 4, 3, side)
    count = np.zeros((41, 53), int)
    for number, tile in enumerate(tiling.tiles):
        count[spec.slices(tile.core)] += 1
        cells = np.arange(41 * 53).reshape(41, 53)[spec.slices(tile.core)].reshape(-1)
        assert (tiling.tile_of(cells) == number).all()
        assert tile.box.covers(tile.core)
        rim = CellBox(
            tile.core.column0 - (side > 0),
            tile.core.row0 - (side > 0),
            tile.core.column1 + side,
            tile.core.row1 + side,
        )
        assert tile.box == rim.intersection(spec.box)
        assert tiling.in_box(number, cells).min() >= 0
        columns, _, in_row = tiling.pieces(tile.box)
        assert in_row > columns.max()
        # No piece lies in a box in part.
        for other in tiling.tiles:
            theirs, _, _ = tiling.pieces(other.box)
            shared = np.intersect1d(columns, theirs)
            overlap = range(
                max(tile.box.column0, other.box.column0), min(tile.box.column1, other.box.column1)
            )
            assert np.isin(columns, shared).sum() == len(overlap)
    assert (count == 1).all()


def test_colours_keep_apart_what_shares_a_ray_or_overlaps():
    boxes = [CellBox(5 * i, 0, 5 * i + 4, 4) for i in range(4)]
    tiles = [MapTile(box, box) for box in boxes]
    sharing = np.eye(4, dtype=bool)
    assert colours(tiles, sharing) == [[0, 1, 2, 3]]
    sharing[0, 2] = sharing[2, 0] = True
    assert colours(tiles, sharing) == [[0, 1, 3], [2]]
    tiles[3] = MapTile(boxes[3], CellBox(8, 0, 19, 4))
    assert colours(tiles, sharing) == [[0, 1], [2], [3]]


def test_tiles_that_cannot_be(scans, window):
    with pytest.raises(WindowError, match='9x1 tiles of 20 x 12 cells: expected at least 5 x 5'):
        tiling_of(GridSpec(0.1, 20, 12), 9, 1, 3)
    tiling = tiling_of(window.spec, 2, 1, 0)
    model, _ = tiled(scans, WINDOW, MODEL, tiling, None)
    with pytest.raises(GridError, match='expected the'):
        model.start(np.zeros(5, np.uint8))
    few = WindowConfig(resolution=1.0, max_memory_mb=1.0)
    with pytest.raises(WindowError, match='tile 1 of 2 needs more than max_memory_mb'):
        tiled(room(n_scans=2, n_beams=9000), few, MODEL, tiling, None)
