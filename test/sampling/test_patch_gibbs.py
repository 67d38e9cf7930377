"""The patch sampler against its slow twin: scores, transitions, records, marginals, orders."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import naive_patch_sampler as naive
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.engine.prior_files import default_prior_file, load_prior
from ogm_mcmc.errors import GridError, PriorError, WindowError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.lab.exact import enumerate_maps
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow
from ogm_mcmc.sampling.gibbs_kernels import NO_CHANCE, PARTS
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_gibbs_kernels import add_likelihoods, scratch, sweep_patches
from ogm_mcmc.sampling.patch_patterns import images, join, split
from ogm_mcmc.sampling.patch_prior import PatchTable, make_table

# Two patches of 3 x 3, one beside the other.
WIDTH, HEIGHT = 6, 5
PLACES = ((1, 1), (1, 2))
MODELS = ForwardModelConfig(sigma=0.9), ForwardModelConfig(kind='gaussian', sigma=1.1)


def window_of(scans, width=WIDTH, height=HEIGHT, model=MODELS[0], cut_sigma=0.0):
    """Window of cells of 1 m with its lower left corner at the origin."""
    window = RayWindow(
        WindowConfig(resolution=1.0, cut_sigma=cut_sigma),
        model,
        limits=CellBox(0, 0, width, height),
    )
    for placed in scans:  # one by one, as they come in
        window.add([placed])
    return window


def two_scans():
    """From inside and from the rim, into all directions, with readings of all kinds."""
    around = fan(1.3, 2.2, 2.9, 0.7, math.inf, 1.6, 2.4, increment=0.9, range_max_m=7.0)
    ahead = fan(2.4, 4.6, 3.1, 5.2, 0.4, bearing=-0.5, increment=0.25, range_max_m=7.0)
    return [
        PlacedScan.at(around, Pose2D(3.3, 2.6, 0.1)),
        PlacedScan.at(ahead, Pose2D(0.4, 2.3, 0.05)),
    ]


def handmade_table():
    """Four listed patterns beside every border, the others share a floor of 0.06."""
    listed = np.array([0, 511, 7, 73], np.int32)
    shares = np.array([0.5, 0.2, 0.14, 0.1])
    return PatchTable(
        3,
        np.zeros(1, np.int32),
        np.array([0, 4], np.int32),
        listed,
        np.log(shares),
        np.log(np.array([0.06 / 508])),
    )


@pytest.fixture(scope='module')
def buildings():
    return load_prior(default_prior_file(), 0.05).counts


def table_of(name, buildings):
    if name == 'handmade':
        return handmade_table()
    if name == 'uniform':
        return make_table('uniform', 9, p_occupied=0.3)
    return make_table('border', 9, buildings)


def some_map(rng, share=0.3, width=WIDTH, height=HEIGHT):
    return (rng.random(width * height) < share).astype(np.uint8)


def corner_of(place):
    return np.array([place[0] * WIDTH + place[1]], np.int32)


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
    flips = 0
    for sweep in range(40):
        before = state.cells.copy()
        told = sampler.advance(rng, state, settling=sweep % 2 == 0)
        assert told >= np.count_nonzero(before != state.cells)
        flips += told
        assert np.array_equal(state.records, sampler.start(state.cells).records)
        assert sampler.log_likelihood(state) == pytest.approx(
            naive.log_likelihood(rays, state.cells.tolist()), abs=1e-4
        )
    assert flips > 40
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
        assert np.array_equal(state.records, sampler.start(state.cells).records)


@pytest.mark.jit
def test_patches_and_cells_find_the_exact_marginals():
    # The rays stay inside of what patches can change: 9 cells in the middle of 5 x 5.
    scan = fan(0.9, 1.4, 1.9, 0.6, increment=0.35, bearing=-0.4, range_max_m=2.2)
    index = window_of([PlacedScan.at(scan, Pose2D(1.4, 1.5, 0.3))], 7, 7).index
    log_odds = math.log(0.3 / 0.7)
    exact = enumerate_maps(index, log_odds)
    assert 5 <= exact.touched.size <= 12
    inside = np.zeros((7, 7), bool)
    inside[1:-1, 1:-1] = True
    assert inside.reshape(-1)[exact.touched].all()
    assert np.ptp(exact.marginals) > 0.3
    patches, single = (make_table('uniform', size, p_occupied=0.3) for size in (9, 1))
    # Where cells hold each other as here, it is whole patches that mix.
    by_cells = PatchModel(index, 7, patches, margin=2, flip_cells=True)
    for sampler, n_sweeps in (
        (CellModel(index, log_odds, 7), 5_000),
        (PatchModel(index, 7, patches), 20_000),
        (PatchModel(index, 7, patches, order='random'), 20_000),
        (PatchModel(index, 7, single), 5_000),
        (by_cells, 40_000),
    ):
        chains = PosteriorSampler(sampler, [np.zeros(49, np.uint8)] * 2, seed=3, burn_in=50)
        chains.advance(50 + n_sweeps)
        quality = chains.quality()
        places = np.searchsorted(sampler.touched, exact.touched)
        error = chains.estimate().mean[places] - exact.marginals
        assert quality.ess[places].min() > 1000
        assert (np.abs(error) < 4.5 * quality.mcse[places]).all()


def three_cells():
    """Three cells in a row inside of 5 x 3, seen by two beams along the row."""
    scan = fan(2.4, 1.6, increment=0.01, range_max_m=6.0)
    window = window_of([PlacedScan.at(scan, Pose2D(1.0, 1.5, 0.0))], 5, 3)
    return window.index, [6, 7, 8]


def matrix_of_sweep(rays, free, table, escape, random_share):
    """Transition matrix (8, 8) of drawing the three cells in turn."""
    maps = naive.maps_of([0] * 15, free)
    total = np.eye(8)
    for bit, cell in enumerate(free):
        step = np.zeros((8, 8))
        for number, cells in enumerate(maps):
            draw = naive.PatchDraw(rays, cells, 5, divmod(cell, 5), table)
            to_free, to_occupied = draw.transition(escape, random_share)[number >> bit & 1]
            step[number, number & ~(1 << bit)] += to_free
            step[number, number | (1 << bit)] += to_occupied
        total = total @ step
    return total


def test_published_algorithm_is_biased_and_ours_is_not():
    index, free = three_cells()
    rays = naive.rays_of(index)
    table = make_table('uniform', 1, p_occupied=0.3)
    posterior = np.exp(
        [
            naive.log_likelihood(rays, cells) + sum(cells) * math.log(0.3 / 0.7)
            for cells in naive.maps_of([0] * 15, free)
        ]
    )
    posterior /= posterior.sum()
    bias = {}
    for share in (0.0, 0.001, 0.01, 0.1):
        matrix = matrix_of_sweep(rays, free, table, 0.02, share)
        bias[share] = naive.total_variation(
            naive.stationary(lambda p, matrix=matrix: p @ matrix, 8), posterior
        )
    assert bias[0.0] < 1e-9
    assert bias[0.001] > 1e-4
    assert bias[0.1] > 0.02
    assert bias[0.1] == pytest.approx(10.0 * bias[0.01], rel=0.3)  # grows with the rate


@pytest.mark.jit
def test_kernel_has_the_bias_of_the_published_algorithm():
    index, free = three_cells()
    table = make_table('uniform', 1, p_occupied=0.3)
    matrix = matrix_of_sweep(naive.rays_of(index), free, table, 0.02, 0.3)
    expected = naive.stationary(lambda p: p @ matrix, 8)
    exact = matrix_of_sweep(naive.rays_of(index), free, table, 0.02, 0.0)
    posterior = naive.stationary(lambda p: p @ exact, 8)
    sampler = PatchModel(index, 5, table, random_share=0.3)
    rng = np.random.default_rng(8)
    state = sampler.start(np.zeros(15, np.uint8))
    seen = np.zeros(8)
    for _ in range(30_000):
        sampler.draw_patches(rng, np.array(free, np.int32), state, 0.0)
        seen[int(state.cells[free] @ (1, 2, 4))] += 1
    seen /= seen.sum()
    assert naive.total_variation(seen, expected) < 0.012
    assert naive.total_variation(seen, posterior) > 0.05


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
    assert np.array_equal(state.records, sampler.start(state.cells).records)


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


def draws_in_turn(places, maps, table):
    """Return how a distribution over maps of 6 x 5 changes when patches are drawn from a prior."""
    number = {cells: i for i, cells in enumerate(maps)}
    steps = []
    for place in places:
        groups = {}
        for i, cells in enumerate(maps):
            groups.setdefault(naive.with_pattern(cells, WIDTH, *place, 3, 0), []).append(i)
        members, shares = [], []
        for rest in groups:
            shares.append(naive.PatchDraw([], rest, WIDTH, place, table).conditional())
            members.append(
                [number[naive.with_pattern(rest, WIDTH, *place, 3, p)] for p in range(512)]
            )
        steps.append((np.array(members), np.array(shares)))

    def transition(p):
        for members, shares in steps:
            after = np.zeros_like(p)
            after[members] = p[members].sum(axis=1)[:, None] * shares
            p = after
        return p

    return transition


@pytest.mark.parametrize(
    ('name', 'rim', 'least', 'most'),
    [
        ('uniform', 'stubs', 0.0, 1e-9),
        ('border', 'free', 0.001, 0.02),
        ('border', 'stubs', 0.15, 0.25),
    ],
)
def test_how_far_conditionals_are_from_one_joint(name, rim, least, most, buildings):
    """Were there a joint, the order of the two patches would not matter in the end."""
    cells = [0] * 30
    if rim == 'stubs':  # what is left of a wall on both sides
        cells[2 * WIDTH] = cells[2 * WIDTH + WIDTH - 1] = 1
    free = [r * WIDTH + c for r in (1, 2, 3) for c in (1, 2, 3, 4)]
    maps = naive.maps_of(cells, free)
    table = table_of(name, buildings)
    one, other = (
        naive.stationary(draws_in_turn(order, maps, table), len(maps))
        for order in (PLACES, PLACES[::-1])
    )
    assert least <= naive.total_variation(one, other) <= most
    # Cell by cell it is little.
    occupied = np.array(maps)
    assert one @ occupied == pytest.approx(other @ occupied, abs=0.02)


def test_images_of_borders_have_images_of_conditionals(buildings):
    """What the sampler knows of a wall does not depend on which way it runs."""
    table = make_table('border', 9, buildings)
    draw = naive.PatchDraw([], [1] * WIDTH + [0] * (30 - WIDTH), WIDTH, PLACES[0], table)
    turned = naive.PatchDraw([], ([1] + [0] * 5) * 5, WIDTH, PLACES[0], table)
    border = int(naive.border_of([1] * WIDTH + [0] * 24, WIDTH, 1, 1, 3))
    other = int(naive.border_of(([1] + [0] * 5) * 5, WIDTH, 1, 1, 3))
    whole = images(join(np.array([border]), np.arange(512), 3), 5)
    match = [s for s in range(8) if split(whole[s], 3)[0][0] == other]
    assert match
    patches = split(whole[match[0]], 3)[1]
    assert draw.conditional() == pytest.approx(turned.conditional()[patches], abs=1e-12)


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
