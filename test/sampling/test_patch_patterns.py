"""Bit order, borders and symmetries of patches."""

import numpy as np
import pytest
from support import naive_patches
from support.patterns import cells_of, pattern_of
from support.pictures import read

from ogm_mcmc.sampling.patch_patterns import (
    canonical,
    images,
    join,
    ring_cells,
    split,
    symmetry_permutations,
)


def test_bit_order_of_a_patch():
    cells = read("""
        ..#
        #..
        .#.
    """)
    assert pattern_of(cells) == 1 << 1 | 1 << 3 | 1 << 8
    assert np.array_equal(cells_of(pattern_of(cells), 3), cells)


def test_bit_order_of_a_border():
    """One border cell after the other, from the lower left row by row."""
    square = read("""
        #.#..
        ....#
        #....
        ....#
        .#...
    """)
    border, patch = split(np.array([pattern_of(square)]), 3)
    assert patch.tolist() == [0]
    assert border.tolist() == [1 << 1 | 1 << 6 | 1 << 7 | 1 << 10 | 1 << 11 | 1 << 13]


@pytest.mark.parametrize('side', [1, 3])
def test_ring_cells_name_the_cells_of_each_border_bit(side):
    for bit, (row, column) in enumerate(ring_cells(side).tolist()):
        square = np.zeros((side + 2, side + 2), int)
        square[row + 1, column + 1] = 1
        border, patch = split(np.array([pattern_of(square)]), side)
        assert (border[0], patch[0]) == (1 << bit, 0)
    assert len(ring_cells(side)) == 4 * side + 4


@pytest.mark.parametrize('side', [1, 3])
def test_split_and_join_undo_each_other(side):
    every = np.random.default_rng(2).integers(0, 2 ** ((side + 2) ** 2), 500)
    border, patch = split(every, side)
    assert np.array_equal(join(border, patch, side), every)
    assert border.max() < 2 ** (4 * side + 4)
    for number in every[:20].tolist():
        ring, inside = naive_patches.ring_and_inside(number, side)
        b, p = split(np.array([number]), side)
        assert (b[0], p[0]) == (sum(bit << i for i, bit in enumerate(ring)), inside)


@pytest.mark.parametrize('side', [1, 3, 5])
def test_images_are_turned_and_mirrored_squares(side):
    for number in np.random.default_rng(3).integers(0, 2 ** (side * side), 30).tolist():
        square = tuple(tuple(row) for row in cells_of(number, side).tolist())
        expected = sorted(map(naive_patches.number_of, naive_patches.eight_images(square)))
        assert sorted(images(np.array([number]), side)[:, 0].tolist()) == expected
        assert canonical(np.array([number]), side).tolist() == [expected[0]]


def test_symmetries_form_a_group():
    """Eight different ones; one after the other is one of them."""
    permutations = symmetry_permutations(3)
    known = {tuple(places) for places in permutations.tolist()}
    assert len(known) == 8
    assert {tuple(a[b]) for a in permutations for b in permutations} == known


def test_classes_of_patches():
    """Burnside: (2**9 + 2**5 + 2 * 2**3 + 4 * 2**6) / 8 classes of 3 x 3 patterns."""
    assert np.unique(canonical(np.arange(512), 3)).size == (512 + 32 + 16 + 256) // 8 == 102
