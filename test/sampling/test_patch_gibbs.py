"""The patch sampler: scores against its slow twin, records, sizes, orders and limits."""

import inspect
import math

import numpy as np
import pytest
from support import naive_patch_sampler as naive
from support.kept_hits import assert_hits_are_those_of_the_map
from support.patch_windows import (
    HEIGHT,
    MODELS,
    WIDTH,
    handmade_table,
    some_map,
    table_of,
    two_scans,
    window_of,
)
from support.strategies import fan

from ogm_mcmc.config import WindowConfig
from ogm_mcmc.errors import GridError, PriorError, WindowError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow, patch_gibbs
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_gibbs_kernels import add_likelihoods, scratch, sweep_patches
from ogm_mcmc.sampling.patch_prior import make_table


@pytest.mark.parametrize('model', MODELS, ids=['beam', 'gaussian'])
@pytest.mark.parametrize('side', [1, 3])
def test_scores_are_differences_of_the_likelihood(model, side):
    index = window_of(two_scans(), model=model).index
    rays = naive.rays_of(index)
    assert len(rays) == 12
    rng = np.random.default_rng(3)
    options = np.arange(2 ** (side * side))
    sampler = PatchModel(index, WIDTH, make_table('uniform', side * side, p_occupied=0.3))
    differing = 0
    for share in (0.0, 0.1, 0.2, 0.3, 0.5, 1.0):
        state = sampler.start(some_map(rng, share))
        for row in range(1, HEIGHT - side):
            for column in range(1, WIDTH - side):
                scores = np.zeros(options.size)
                _, *memory = scratch(side, options.size, index.n_rays)
                add_likelihoods(
                    options, scores, options.size, *memory, row * WIDTH + column, side,
                    state.cells, state.records, state.records.view(np.float32),
                    *(array for array in index.arrays() if array is not index.gain),
                )  # fmt: skip
                slow = np.array(
                    [
                        naive.log_likelihood(
                            rays,
                            naive.with_pattern(state.cells, WIDTH, row, column, side, pattern),
                        )
                        for pattern in options.tolist()
                    ]
                )
                assert scores - scores[0] == pytest.approx(slow - slow[0], abs=1e-5)
                differing += np.ptp(slow) > 0.1
    assert differing > 10


@pytest.mark.parametrize('order', ['tiled', 'random'])
@pytest.mark.parametrize('name', ['uniform', 'handmade', 'border'])
@pytest.mark.parametrize(('random_share', 'flip_cells'), [(0.0, False), (0.2, False), (0.0, True)])
def test_records_equal_a_rescan(name, order, random_share, flip_cells, buildings):
    width, height = 13, 11
    scans = [
        PlacedScan.at(scan, Pose2D(at.mean.x_m + 4.0, at.mean.y_m + 3.0, at.mean.yaw_rad))
        for scan, at in two_scans()
    ]
    index = window_of(scans, width, height).index
    rays = naive.rays_of(index)
    sampler = PatchModel(
        index,
        width,
        table_of(name, buildings),
        order=order,
        escape=0.3,
        random_share=random_share,
        flip_cells=flip_cells,
    )
    rng = np.random.default_rng(2)
    state = sampler.start(some_map(rng, 0.2, width, height))
    rim = np.ones((height, width), bool)
    rim[1:-1, 1:-1] = False
    at_rim = state.cells.reshape(height, width)[rim].copy()
    flips = behind = 0
    for sweep in range(40):
        before = state.cells.copy()
        told = sampler.advance(rng, state, settling=sweep % 2 == 0)
        assert told >= np.count_nonzero(before != state.cells)
        flips += told
        behind += assert_hits_are_those_of_the_map(state, index, width)
        assert sampler.log_likelihood(state) == pytest.approx(
            naive.log_likelihood(rays, state.cells.tolist()), abs=1e-4
        )
    assert flips > 40
    assert behind > 40
    assert np.array_equal(state.cells.reshape(height, width)[rim], at_rim)


def test_patches_of_a_stride_need_no_kernel_of_their_own(buildings):
    """Each takes seconds to compile; some turns of a focused sweep are strides."""
    index = window_of(two_scans(), 40, 30).index
    sampler = PatchModel(index, 40, table_of('border', buildings))
    corners = sampler.order_of_sweep(np.random.default_rng(1))[::3]
    assert not corners.flags.c_contiguous
    results, kernels = [], []
    for order in (corners.copy(), corners):
        state = sampler.start(some_map(np.random.default_rng(2), 0.5, 40, 30))
        flips = sampler.draw_patches(np.random.default_rng(2), order, state, 0.3)
        assert flips > 0
        results.append(state.cells)
        kernels.append(len(sweep_patches.signatures))
    assert kernels[0] == kernels[1]
    assert np.array_equal(*results)


def test_what_is_not_sampled_is_solid_and_stays(buildings):
    """Whatever the start: the posterior is that given this surrounding."""
    width, height = 40, 30
    window = window_of(two_scans(), width, height, cut_sigma=1.0)
    sampler = PatchModel(window.index, width, table_of('border', buildings), margin=1)
    outside = np.ones(width * height, bool)
    outside[sampler.touched] = False
    assert 100 < outside.sum() < width * height - 40
    rng = np.random.default_rng(6)
    for share in (0.0, 0.5):
        state = sampler.start(some_map(rng, share, width, height))
        for _ in range(5):
            sampler.advance(rng, state)
        assert state.cells[outside].all()
        assert_hits_are_those_of_the_map(state, sampler.index, width)


@pytest.mark.parametrize(('prior', 'size'), [('border', 1), ('patch', 1), ('patch', 25)])
def test_other_sizes_run_and_keep_their_records(prior, size, buildings):
    width, height = 16, 14
    scans = [
        PlacedScan.at(scan, Pose2D(at.mean.x_m + 5.0, at.mean.y_m + 4.0, at.mean.yaw_rad))
        for scan, at in two_scans()
    ]
    index = window_of(scans, width, height).index
    sampler = PatchModel(index, width, make_table(prior, size, buildings), escape=0.2)
    rng = np.random.default_rng(4)
    state = sampler.start(some_map(rng, 0.3, width, height))
    before = state.cells.copy()
    for _ in range(20):
        sampler.advance(rng, state)
    assert (before != state.cells).any()
    assert_hits_are_those_of_the_map(state, sampler.index, width)


@pytest.mark.parametrize(
    ('prior', 'message'), [('uniform', 'intractable'), ('border', '7 x 7 cells')]
)
def test_25_cells_are_refused_where_they_cannot_be_had(prior, message, buildings):
    with pytest.raises(PriorError, match=message) as caught:
        make_table(prior, 25, buildings)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('side', [1, 3, 5])
def test_tiles_cover_every_cell_once(side):
    width, height = 17, 14
    index = window_of(two_scans(), width, height).index
    table = make_table('uniform', side * side) if side < 5 else handmade_table()._replace(side=5)
    sampler = PatchModel(index, width, table)
    rng = np.random.default_rng(1)
    ever = np.zeros((height, width), int)
    for _ in range(120):
        covered = np.zeros((height, width), int)
        for corner in sampler.order_of_sweep(rng).tolist():
            row, column = divmod(corner, width)
            covered[row : row + side, column : column + side] += 1
        assert covered.max() == 1
        rows, columns = np.nonzero(covered)
        block = covered[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        assert block.all()  # no gaps
        # What is left beside the rim of the window is narrower than a patch.
        assert max(rows.min() - 1, height - 2 - rows.max()) < side
        assert max(columns.min() - 1, width - 2 - columns.max()) < side
        ever += covered
    assert (ever[1:-1, 1:-1] > 0).all()
    assert ever[0].sum() + ever[-1].sum() + ever[:, 0].sum() + ever[:, -1].sum() == 0


def test_random_order_draws_as_many_patches_anywhere():
    index = window_of(two_scans(), 17, 14).index
    sampler = PatchModel(index, 17, make_table('uniform', 9), order='random')
    rng = np.random.default_rng(1)
    drawn = [sampler.order_of_sweep(rng) for _ in range(200)]
    assert {corners.size for corners in drawn} == {13 * 10 // 9}
    rows, columns = np.divmod(np.unique(np.concatenate(drawn)), 17)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (1, 10, 1, 13)


@pytest.mark.parametrize(
    ('flip_cells', 'settling', 'looking', 'expected'),
    [
        (True, True, True, 0.25),
        (True, False, False, 0.25),
        (True, False, True, 1.0 / 16.0),
        # Where cells are not drawn by themselves the patch is all that a turn draws.
        (False, False, True, 1.0),
    ],
)
def test_patches_are_drawn_whole_more_seldom_where_sweeps_count(
    flip_cells, settling, looking, expected, monkeypatch, buildings
):
    width = 40
    index = window_of(two_scans(), width, 30, cut_sigma=1.0).index
    table = table_of('border', buildings)
    sampler = PatchModel(index, width, table, margin=3, flip_cells=flip_cells)
    shares = []
    kernel = getattr(sweep_patches, 'py_func', sweep_patches)
    at = list(inspect.signature(kernel).parameters).index('whole_share')
    monkeypatch.setattr(
        patch_gibbs, 'sweep_patches',
        lambda *given: shares.append(given[at]) or 0,
    )  # fmt: skip
    doubt = np.zeros(index.n_cells, np.bool_)
    doubt[sampler.touched[:9]] = True
    state = sampler.start(np.zeros(index.n_cells, np.uint8))
    focus = sampler.focus(doubt, doubt) if looking else None
    sampler.advance(np.random.default_rng(1), state, settling=settling, focus=focus)
    assert set(shares) == {expected}


def test_windows_and_maps_of_the_wrong_size():
    index = window_of(two_scans(), 4, 5).index
    with pytest.raises(WindowError, match='4 x 5 cells: expected at least 5 x 5'):
        PatchModel(index, 4, make_table('uniform', 9))
    sampler = PatchModel(window_of(two_scans()).index, WIDTH, make_table('uniform', 9))
    with pytest.raises(GridError, match='start map of 4 cells: expected the 30'):
        sampler.start(np.zeros(4, np.uint8))


def test_limits_cut_rays_as_a_shorter_reach_does():
    """A beam that leaves the window says that nothing is in its way; sensors outside do not."""
    scan = fan(1.5, 4.5, math.inf, range_max_m=9.0)
    limits = CellBox(0, 0, 4, 1)
    config = WindowConfig(resolution=1.0, cut_sigma=0.0)
    limited = RayWindow(config, MODELS[0], limits=limits)
    added = limited.add(
        [PlacedScan.at(scan, Pose2D(0.25, 0.5)), PlacedScan.at(scan, Pose2D(-0.5, 0.5))]
    )
    assert added == 3
    assert limited.spec.box == limits
    reached = RayWindow(WindowConfig(resolution=1.0, cut_sigma=0.0, max_range=3.75), MODELS[0])
    reached.add([PlacedScan.at(scan, Pose2D(0.25, 0.5))])
    for ray, other in zip(naive.rays_of(limited.index), naive.rays_of(reached.index), strict=True):
        assert ray.cells == [0, 1, 2, 3] == other.cells[:4]
        assert ray.values == pytest.approx(other.values[:4], abs=1e-4)
        assert ray.nothing == pytest.approx(other.nothing, abs=1e-4)
