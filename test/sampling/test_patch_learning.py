"""Counting patches: by hand, against the naive twin, turned maps, other resolutions."""

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from support import naive_patches
from support.patterns import pattern_of
from support.pictures import draw, read
from support.strategies import REPEATABLE

from ogm_mcmc.config import LearningConfig
from ogm_mcmc.errors import PriorError
from ogm_mcmc.sampling.patch_learning import count_map, count_windows, rescaled, total_of


def counter(windows, side):
    patterns, seen = windows.by_pattern(side)
    assert (np.diff(patterns) > 0).all()
    return dict(zip(patterns.tolist(), seen.tolist(), strict=True))


def test_a_wall_counted_by_hand():
    """4 x 4: two windows along the wall, whose eight images are four patterns; two free ones."""
    states = read("""
        #...
        #...
        #...
        #...
    """)
    left, bottom = pattern_of(np.eye(3)[[0]] * np.ones((3, 1))), 0b111
    right, top = left << 2, 0b111 << 6
    windows = count_windows(states, 3)
    assert counter(windows, 3) == {0: 16, left: 4, right: 4, bottom: 4, top: 4}
    assert windows.patterns.tolist() == [0, bottom]
    assert windows.windows.tolist() == [2, 2]
    assert count_windows(states, 1).windows.tolist() == [12, 4]


def test_a_corner_counted_by_hand():
    """4 x 4 with an L. Two of its windows, below left and above right, are their own mirror
    images: eight images are four patterns, two of each. The other two are images of each other
    and have eight different ones, each seen once for either."""
    states = read("""
        ....
        .#..
        .##.
        ....
    """)
    below_left, above_right = '.#.\n.##\n...', '...\n#..\n##.'
    below_right, above_left = '#..\n##.\n...', '...\n.#.\n.##'
    windows = count_windows(states, 3)
    assert sorted(windows.windows.tolist()) == [1, 1, 2]
    seen = counter(windows, 3)
    assert len(seen) == 4 + 4 + 8
    assert set(seen.values()) == {2}
    for picture in (below_left, above_right, below_right, above_left):
        assert pattern_of(read(picture)) in seen


tri_state = arrays.arrays(
    np.int8,
    st.tuples(st.integers(1, 7), st.integers(1, 7)),
    elements=st.sampled_from([-1, -1, 0, 0, 1]),
)


@REPEATABLE
@given(
    states=tri_state,
    side=st.sampled_from([1, 3, 5]),
    unknown=st.sampled_from(['occupied', 'skip']),
    margin=st.integers(0, 3),
)
def test_counts_equal_the_naive_twin(states, side, unknown, margin):
    windows = count_windows(states, side, unknown=unknown, margin_cells=margin)
    assert counter(windows, side) == naive_patches.count_squares(states, side, unknown, margin)


@REPEATABLE
@given(states=tri_state, margin=st.integers(0, 3), turns=st.integers(0, 3), mirror=st.booleans())
def test_a_turned_map_has_the_same_counts(states, margin, turns, mirror):
    other = np.ascontiguousarray(np.rot90(states[::-1] if mirror else states, turns))
    for side in (1, 3, 5):
        here = count_windows(states, side, margin_cells=margin)
        there = count_windows(other, side, margin_cells=margin)
        assert np.array_equal(here.patterns, there.patterns)
        assert np.array_equal(here.windows, there.windows)


def test_unknown_is_solid_or_left_out():
    states = read("""
        ???
        ..#
        ...
    """)
    assert counter(count_windows(states, 1), 1) == {0: 5 * 8, 1: 4 * 8}
    assert counter(count_windows(states, 1, unknown='skip'), 1) == {0: 5 * 8, 1: 8}
    assert counter(count_windows(states, 3, unknown='skip'), 3) == {}


def test_canvas_far_from_anything_known_does_not_count():
    config = LearningConfig(resolution=0.1, margin=0.25)  # two cells, to even
    states = np.full((40, 60), -1, np.int8)
    states[20, 30] = 0
    counts = count_map(states, config)
    assert counts.cells.tolist() == [1, 24]
    assert counts.squares.windows.sum() == 25
    larger = np.pad(states, 50, constant_values=-1)
    assert count_map(larger, config).p_occupied == counts.p_occupied


def test_no_window_fits():
    with pytest.raises(PriorError, match='4 x 9 cells'):
        count_map(np.zeros((9, 4), np.int8), LearningConfig())


def test_maps_add_up():
    rng = np.random.default_rng(4)
    config = LearningConfig()
    maps = [rng.integers(-1, 2, (12, 15)).astype(np.int8) for _ in range(3)]
    every = [count_map(states, config) for states in maps]
    total = total_of(every)
    expected = sum((naive_patches.count_squares(states, 5) for states in maps), start=Counter())
    assert counter(total.squares, 5) == expected
    assert total.patches.sum() == 8 * 3 * 10 * 13
    assert total.cells.sum() == 3 * 12 * 15
    with pytest.raises(PriorError, match=r'\[0.05, 0.1\]'):
        total_of([every[0], count_map(maps[0], LearningConfig(resolution=0.1))])


def test_rare_classes_are_dropped_and_remembered():
    """One occupied cell takes all 25 places of a window: classes of 1, 4, 4, 4, 4 and 8 places."""
    states = np.zeros((20, 20), np.int8)
    states[7, 12] = 1
    counts = count_map(states, LearningConfig())
    assert sorted(counts.squares.windows.tolist()) == [1, 4, 4, 4, 4, 8, 16 * 16 - 25]
    kept = counts.without_rare(5)
    assert sorted(kept.squares.windows.tolist()) == [8, 16 * 16 - 25]
    assert kept.dropped == 17
    assert kept.without_rare(9).dropped == 25
    assert np.array_equal(kept.patches, counts.patches)


def test_coarser_cells_are_occupied_when_anything_in_them_is():
    fine = read("""
        ..????
        .#????
        ....?.
        ......
    """)
    assert draw(rescaled(fine, 0.05, 0.1)) == '#??\n...'


def test_a_thin_wall_stays_closed():
    """Two and a half cells in one: a wall of one cell is one cell thick, and has no gap."""
    fine = np.zeros((40, 40), np.int8)
    fine[np.arange(40), np.arange(40)] = 1
    fine[:, 17] = 1
    coarse = rescaled(fine, 0.02, 0.05)
    assert coarse.shape == (16, 16)
    assert (coarse.diagonal() == 1).all()
    assert (coarse[:, 7] == 1).all()
    assert coarse.sum() == 16 + 16 - 1


@REPEATABLE
@given(states=tri_state, step=st.sampled_from(['1.2', '1.5', '2', '2.5', '4', '13']))
def test_pooling_equals_the_naive_twin(states, step):
    expected = naive_patches.pooled(states, Fraction(step))
    assert np.array_equal(rescaled(states, 0.02, 0.02 * float(step)), expected)


def test_finer_cells_are_cut_from_the_coarser():
    coarse = read("""
        #?
        .#
    """)
    assert draw(rescaled(coarse, 0.1, 0.05)) == '##??\n##??\n..##\n..##'
    # Centres at 0.2, 0.6 | 1.0, 1.4, 1.8 cells.
    assert draw(rescaled(coarse, 0.05, 0.02)) == '##???\n##???\n##???\n..###\n..###'


def test_the_same_resolution_changes_nothing():
    states = read('#.?')
    assert rescaled(states, 0.05, 0.05) is states
    # 0.1 + 0.2 is not 0.3, but it was meant to be.
    assert rescaled(states, 0.1 + 0.2, 0.3) is states
