"""Tables: distributions in every entry, alike for images, equal to the naive twin."""

import math
from collections import Counter

import numpy as np
import pytest
from support import naive_patches
from support.patterns import pattern_of
from support.pictures import read

from ogm_mcmc.config import LearningConfig, PatchTableConfig
from ogm_mcmc.errors import ConfigError, PriorError
from ogm_mcmc.sampling.patch_learning import PatchCounts, WindowCounts, count_map, total_of
from ogm_mcmc.sampling.patch_patterns import images, join, ring_cells, split
from ogm_mcmc.sampling.patch_prior import log_probabilities, make_table, nats_per_window

LEARNED = [('patch', 1), ('patch', 9), ('patch', 25), ('border', 1), ('border', 9)]


def speckled_rooms(seed=6, width=60, height=50):
    """Rooms with walls two cells thick, doors, specks, and unknown cells around."""
    rng = np.random.default_rng(seed)
    states = np.full((height, width), -1, np.int8)
    for row in range(3, height - 12, 15):
        for column in range(4, width - 14, 16):
            states[row : row + 14, column : column + 15] = 1
            states[row + 2 : row + 12, column + 2 : column + 13] = 0
            states[row + 6 : row + 9, column : column + 3] = 0
    return np.where(rng.random(states.shape) < 0.01, 1 - abs(states), states).astype(np.int8)


@pytest.fixture(scope='module')
def counts():
    return count_map(speckled_rooms(), LearningConfig())


def listed_per_entry(table):
    return np.diff(table.start)


def mass_per_entry(table):
    """Probability of all patterns together, entry by entry."""
    listed = np.add.reduceat(np.exp(table.log_probability), table.start[:-1])
    others = 2 ** (table.side**2) - listed_per_entry(table)
    return listed + others * np.exp(table.floor)


@pytest.mark.parametrize(('prior', 'size'), [*LEARNED, ('uniform', 1), ('uniform', 9)])
@pytest.mark.parametrize('least', [0.0, 0.003, 0.2])
def test_every_entry_is_a_distribution(counts, prior, size, least):
    config = PatchTableConfig(min_probability=least, min_share=least)
    table = make_table(prior, size, counts, config, p_occupied=0.3)
    assert mass_per_entry(table) == pytest.approx(1.0, abs=1e-12)
    assert listed_per_entry(table).min() >= 1
    assert np.isfinite(table.log_probability).all()
    assert np.isfinite(table.floor).all()  # nothing is impossible
    # The most probable first, and none of those not listed above one that is.
    falls = np.diff(table.log_probability)
    falls[table.start[1:-1] - 1] = 0.0
    assert falls.max(initial=0.0) <= 0.0
    assert (table.log_probability[table.start[1:] - 1] >= table.floor - 1e-12).all()
    assert table.entry_of_border.min() == 0
    assert np.unique(table.entry_of_border).size == table.floor.size
    kinds = [array.dtype for array in table[1:]]
    assert kinds == [np.int32, np.int32, np.int32, np.float64, np.float64]


@pytest.mark.parametrize('size', [1, 9])
@pytest.mark.parametrize('least', [0.0, 0.01])
def test_turned_borders_have_turned_patches(counts, size, least):
    """Also which ones are listed, in spite of ties and rounding."""
    side = math.isqrt(size)
    config = PatchTableConfig(min_probability=least)
    table = make_table('border', size, counts, config)
    patches = np.arange(2**size)
    borders = np.random.default_rng(7).integers(0, 2 ** (4 * side + 4), 40)
    borders = [0, 2 ** (4 * side + 4) - 1, 0b111, 0b11111, *borders.tolist()]
    for border in borders:
        here = log_probabilities(table, border, patches)
        for turned in images(join(np.full(2**size, border), patches, side), side + 2):
            there = log_probabilities(table, *split(turned, side))
            assert there == pytest.approx(here, abs=1e-12)


@pytest.mark.parametrize('size', [1, 9])
@pytest.mark.parametrize('windows', [1, 40])
def test_border_table_equals_the_naive_twin(size, windows):
    side = math.isqrt(size)
    config = PatchTableConfig(min_windows=windows, min_probability=0.0, backoff_weight=2.5)
    states = speckled_rooms(width=24, height=20)
    table = make_table('border', size, count_map(states, LearningConfig()), config)
    # Everything in this small map is within the default margin of ten cells.
    wide, small = (naive_patches.count_squares(states, each) for each in (side + 2, side))
    if side == 1:  # cells are counted once, as they have no images
        small = Counter({state: seen // 8 for state, seen in small.items()})
    seen = [naive_patches.ring_and_inside(number, side)[0] for number in sorted(wide)]
    any_other = np.random.default_rng(8).integers(0, 2, (3, 4 * side + 4)).tolist()
    few = [*seen[:: len(seen) // 9], (1,) * len(seen[0]), *map(tuple, any_other)]
    for ring in few:
        expected = naive_patches.smoothed(wide, small, side, ring, weight=2.5, min_windows=windows)
        border = sum(bit << i for i, bit in enumerate(ring))
        got = np.exp(log_probabilities(table, border, np.arange(2**size)))
        assert got == pytest.approx(expected, rel=1e-12)


def test_pruning_keeps_what_is_likely_and_shares_the_rest(counts):
    every = make_table('border', 9, counts, PatchTableConfig(min_probability=0.0))
    table = make_table('border', 9, counts, PatchTableConfig(min_probability=0.02))
    assert np.array_equal(every.entry_of_border, table.entry_of_border)
    patches = np.arange(512)
    for border in (0, 0b11111, 0b1111111111111111):
        full = np.exp(log_probabilities(every, border, patches))
        pruned = np.exp(log_probabilities(table, border, patches))
        kept = full >= 0.02
        assert pruned[kept] == pytest.approx(full[kept], rel=1e-12)
        assert pruned[~kept] == pytest.approx(full[~kept].mean(), rel=1e-12)


def test_the_floor_can_be_bounded(counts):
    config = PatchTableConfig(min_probability=0.02, max_floor=1e-3)
    table = make_table('border', 9, counts, config)
    others = 512 - listed_per_entry(table)
    assert (others * np.exp(table.floor)).max() <= 1e-3 * (1.0 + 1e-12)
    assert mass_per_entry(table) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(('prior', 'size'), LEARNED)
def test_a_stronger_prior_is_the_counted_one_to_a_power(counts, prior, size):
    """Of all patterns, the floor of those that are not listed too."""
    counted = make_table(prior, size, counts)
    stronger = make_table(prior, size, counts, PatchTableConfig(strength=1.7))
    others = 2**size - listed_per_entry(counted)
    powers = np.exp(1.7 * counted.log_probability)
    whole = np.add.reduceat(powers, counted.start[:-1]) + others * np.exp(1.7 * counted.floor)
    listed = powers / np.repeat(whole, listed_per_entry(counted))
    assert np.exp(stronger.log_probability) == pytest.approx(listed, rel=1e-9)
    assert np.exp(stronger.floor) == pytest.approx(np.exp(1.7 * counted.floor) / whole, rel=1e-9)
    assert mass_per_entry(stronger) == pytest.approx(1.0, abs=1e-9)
    assert np.array_equal(stronger.candidates, counted.candidates)


def test_one_border_by_hand():
    """A map of two windows: free around free, and a wall of five cells beside it."""
    free, wall = 0, pattern_of(read('.....\n.....\n.....\n.....\n#####'))
    squares = WindowCounts(np.array([free, wall], np.int32), np.array([30, 10]))
    patches = np.zeros(512, np.int64)
    patches[0] = 8 * 30 + 8 * 10
    counts = PatchCounts(0.05, np.array([100, 10]), patches, squares)
    config = PatchTableConfig(backoff_weight=2.0, min_windows=1, min_probability=0.0)
    table = make_table('border', 9, counts, config)
    base = (320 + 1) / (320 + 512)
    # Free around: 8 * 30 windows, always with the free patch. The same to the 12 and 4 cells.
    p = base
    for _ in range(3):
        p = (240 + 2 * p) / (240 + 2)
    assert math.exp(log_probabilities(table, 0, 0)) == pytest.approx(p, rel=1e-12)
    # A wall along one side: four images, so 8 * 10 / 4 windows of each.
    p = base
    for _ in range(3):
        p = (20 + 2 * p) / (20 + 2)
    assert math.exp(log_probabilities(table, 0b11111, 0)) == pytest.approx(p, rel=1e-12)
    # A border that differs in a corner only: what its 12 cells say.
    p = base
    for _ in range(2):
        p = (240 + 2 * p) / (240 + 2)
    assert math.exp(log_probabilities(table, 1, 0)) == pytest.approx(p, rel=1e-12)
    # One never seen in any way: the patch without a border.
    assert math.exp(log_probabilities(table, 0xFFFF, 0)) == pytest.approx(base, rel=1e-12)


def test_borders_seldom_seen_share_an_entry(counts):
    many = make_table('border', 9, counts, PatchTableConfig(min_windows=1))
    few = make_table('border', 9, counts, PatchTableConfig(min_windows=100))
    assert few.floor.size < many.floor.size / 3
    corners = (np.abs(ring_cells(3) - 1) == 2).all(axis=1)
    mask = sum(1 << j for j in np.flatnonzero(~corners).tolist())
    seen = np.zeros(2**16, np.int64)
    patterns, number = counts.squares.by_pattern(5)
    np.add.at(seen, split(patterns, 3)[0], number)
    rare = np.flatnonzero(seen < 100)
    by_look = {}
    for border in rare[seen[rare & mask] < 100].tolist():
        by_look.setdefault(border & mask, set()).add(int(few.entry_of_border[border]))
    assert all(len(entries) == 1 for entries in by_look.values())


def test_uniform_cells_are_independent():
    table = make_table('uniform', 9, p_occupied=0.2)
    for pattern in (0, 1, 0b111, 511):
        occupied = pattern.bit_count()
        expected = occupied * math.log(0.2) + (9 - occupied) * math.log(0.8)
        assert log_probabilities(table, 0, pattern) == pytest.approx(expected, rel=1e-12)
    assert np.ptp(make_table('uniform', 9).log_probability) < 1e-12


def test_unconditioned_shares(counts):
    cells = np.exp(log_probabilities(make_table('patch', 1, counts), 0, np.arange(2)))
    assert cells == pytest.approx((counts.cells + 1) / (counts.cells.sum() + 2), rel=1e-12)
    config = PatchTableConfig(min_share=0.0)
    patches = np.exp(log_probabilities(make_table('patch', 9, counts, config), 0, np.arange(512)))
    assert patches == pytest.approx((counts.patches + 1) / (counts.patches.sum() + 512), rel=1e-12)


def test_patches_of_25_cells_are_listed_sparsely(counts):
    patterns, seen = counts.squares.by_pattern(5)
    table = make_table('patch', 25, counts, PatchTableConfig(min_share=0.0))
    assert np.array_equal(np.sort(table.candidates), patterns)
    p = np.exp(log_probabilities(table, 0, patterns))
    assert p == pytest.approx(seen / (seen.sum() + seen.size), rel=1e-12)
    never = 0b1010101010101010101010101
    assert never not in patterns
    floor = seen.size / (seen.sum() + seen.size) / (2**25 - seen.size)
    assert math.exp(log_probabilities(table, 0, never)) == pytest.approx(floor, rel=1e-6)


@pytest.mark.parametrize(('prior', 'size'), LEARNED)
def test_prediction_of_another_map(counts, prior, size):
    """The mean over all windows, one by one; better than knowing nothing."""
    states = speckled_rooms(seed=9, width=40, height=33)
    table = make_table(prior, size, counts)
    side = math.isqrt(size)
    other = count_map(states, LearningConfig())
    wide = naive_patches.count_squares(states, 5 if size > 1 else 3)
    total = 0.0
    for number, seen in wide.items():
        if size == 25:
            ring, inside = (), number
        else:
            ring, inside = naive_patches.ring_and_inside(number, side)
        border = sum(bit << i for i, bit in enumerate(ring))
        total -= seen * float(log_probabilities(table, border, inside))
    expected = total / sum(wide.values())
    assert nats_per_window(table, other) == pytest.approx(expected, rel=1e-9)
    assert expected < size * math.log(2.0)


def test_borders_predict_better_than_patches_than_nothing(counts):
    other = count_map(speckled_rooms(seed=10), LearningConfig())
    border, patch, nothing = (
        nats_per_window(make_table(prior, 9, counts), other)
        for prior in ('border', 'patch', 'uniform')
    )
    assert border < 0.5 * patch < 0.5 * nothing
    assert nothing == pytest.approx(9 * math.log(2.0))


def test_more_maps_change_the_table():
    config = LearningConfig()
    one, two = (count_map(speckled_rooms(seed), config) for seed in (11, 12))
    tables = [make_table('border', 9, each) for each in (one, total_of([one, two]))]
    assert tables[1].floor.size > tables[0].floor.size


@pytest.mark.parametrize(
    ('arguments', 'error', 'reason'),
    [
        (('uniform', 25), PriorError, 'intractable.* 33554432'),
        (('border', 9), PriorError, 'prior border is learned: expected a prior file'),
        (('magic', 9), ConfigError, "prior is 'magic': one of uniform, patch, border"),
        (('patch', 16), ConfigError, 'patch_size is 16: one of 1, 9, 25'),
    ],
)
def test_what_cannot_be_had(arguments, error, reason):
    with pytest.raises(error, match=reason):
        make_table(*arguments)


def test_what_cannot_be_had_from_counts(counts):
    with pytest.raises(PriorError, match='needs windows of 7 x 7 cells'):
        make_table('border', 25, counts)
    with pytest.raises(ConfigError, match='p_occupied is 1'):
        make_table('uniform', 9, p_occupied=1.0)
