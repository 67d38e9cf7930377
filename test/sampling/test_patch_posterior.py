"""What the sweeps of the patch sampler lead to: exact marginals, the published bias, no joint."""

import math

import numpy as np
import pytest
from support import naive_patch_sampler as naive
from support.patch_windows import PLACES, WIDTH, table_of, window_of
from support.strategies import fan

from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.lab.exact import enumerate_maps
from ogm_mcmc.sampling import CellModel, PosteriorSampler
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_patterns import images, join, split
from ogm_mcmc.sampling.patch_prior import make_table


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
    for sampler, burn_in, n_sweeps in (
        (CellModel(index, log_odds, 7), 50, 5_000),
        (PatchModel(index, 7, patches), 50, 20_000),
        (PatchModel(index, 7, patches, order='random'), 50, 20_000),
        (PatchModel(index, 7, single), 50, 5_000),
        # In fewer sweeps some cells never flip: they would be taken for settled and drawn seldom.
        (by_cells, 1_000, 30_000),
    ):
        chains = PosteriorSampler(sampler, [np.zeros(49, np.uint8)] * 2, seed=3, burn_in=burn_in)
        chains.advance(burn_in + n_sweeps)
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


@pytest.mark.jit
def test_likelihoods_to_a_power_have_a_posterior_of_their_own():
    index, free = three_cells()
    plain = PatchModel(index, 5, make_table('uniform', 1, p_occupied=0.3))
    rays, power = naive.rays_of(index), 2.5
    sharp = plain.to_power(power)
    weights = {1.0: [], power: []}
    for cells in naive.maps_of([0] * 15, free):
        said = naive.log_likelihood(rays, cells)
        state = sharp.start(np.array(cells, np.uint8))
        assert sharp.log_likelihood(state) == pytest.approx(power * said, rel=1e-5)
        for one, of_maps in weights.items():
            of_maps.append(math.exp(one * said + sum(cells) * math.log(0.3 / 0.7)))
    exact = {one: np.array(of_maps) / sum(of_maps) for one, of_maps in weights.items()}
    assert naive.total_variation(exact[1.0], exact[power]) > 0.05
    for one, model in ((1.0, plain), (power, sharp)):  # the plain one is as it was
        rng, seen = np.random.default_rng(8), np.zeros(8)
        state = model.start(np.zeros(15, np.uint8))
        for _ in range(20_000):
            model.draw_patches(rng, np.array(free, np.int32), state, 0.0)
            seen[int(state.cells[free] @ (1, 2, 4))] += 1
        assert naive.total_variation(seen / seen.sum(), exact[one]) < 0.015


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
