import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, GridSpec
from ogm_mcmc.mapping import LogOddsGrid


def grid(max_cells=10_000_000):
    return LogOddsGrid(0.1, max_cells)


def one_cell(column, row):
    return CellBox(column, row, column + 1, row + 1)


def put(storage, column, row, value):
    storage.log_odds[storage.spec.slices(one_cell(column, row))] = value


def get(storage, column, row):
    return storage.log_odds[storage.spec.slices(one_cell(column, row))].item()


def test_starts_as_one_unknown_block():
    storage = grid()
    assert storage.spec == GridSpec(0.1, 64, 64)
    assert storage.log_odds.shape == (64, 64)
    assert storage.log_odds.dtype == np.float32
    assert np.isnan(storage.log_odds).all()


def test_the_first_box_places_the_window():
    """It need not hold the origin: a robot may start anywhere."""
    storage = grid()
    storage.cover(CellBox(1000, -500, 1010, -490))
    assert storage.spec.box == CellBox(960, -512, 1024, -448)


def test_a_covered_box_changes_nothing():
    storage = grid()
    storage.cover(CellBox(0, 0, 10, 10))
    before = storage.log_odds
    storage.cover(CellBox(5, 5, 64, 64))
    assert storage.log_odds is before


def test_grows_to_the_side_it_must_with_an_eighth_to_spare():
    storage = grid()
    storage.cover(CellBox(0, 0, 640, 64))
    storage.cover(CellBox(640, 0, 641, 64))
    # 641 and 80 to spare, in whole blocks of 64.
    assert storage.spec.box == CellBox(0, 0, 768, 64)
    storage.cover(CellBox(-1, 0, 0, 64))
    # -1 - 769 // 8 = -97
    assert storage.spec.box == CellBox(-128, 0, 768, 64)


def test_spares_nothing_where_max_cells_is_near():
    storage = grid(max_cells=64 * 704)
    storage.cover(CellBox(0, 0, 640, 64))
    storage.cover(CellBox(640, 0, 641, 64))
    assert storage.spec.box == CellBox(0, 0, 704, 64)


def test_growth_keeps_values_in_their_cells():
    storage = grid()
    storage.cover(CellBox(0, 0, 64, 64))
    put(storage, 3, 5, 1.5)
    put(storage, 63, 0, -2.0)
    for box in (CellBox(-1, 0, 5, 5), CellBox(0, 70, 1, 71), CellBox(500, -300, 501, -299)):
        storage.cover(box)
        assert (get(storage, 3, 5), get(storage, 63, 0)) == (1.5, -2.0)
        assert np.isfinite(storage.log_odds).sum() == 2


def test_too_many_cells_are_refused_and_nothing_changes():
    storage = grid(max_cells=64 * 64 * 3)
    storage.cover(CellBox(0, 0, 1, 1))
    put(storage, 0, 0, 1.0)
    spec, values = storage.spec, storage.log_odds
    with pytest.raises(GridError, match=r'would grow to 256 x 64 cells: .* max_cells = 12288'):
        storage.cover(one_cell(200, 0))
    assert storage.spec is spec
    assert storage.log_odds is values
    storage.cover(one_cell(130, 0))
    assert get(storage, 0, 0) == 1.0


def test_the_first_box_may_be_refused_too():
    storage = grid(max_cells=4096)
    with pytest.raises(GridError):
        storage.cover(CellBox(0, 0, 65, 1))
    storage.cover(CellBox(70, 70, 71, 71))
    assert storage.spec.box == CellBox(64, 64, 128, 128)


def test_clear_forgets_values_and_place():
    storage = grid()
    storage.cover(one_cell(1000, 1000))
    put(storage, 1000, 1000, 3.0)
    storage.clear()
    assert storage.spec == GridSpec(0.1, 64, 64)
    assert np.isnan(storage.log_odds).all()
    storage.cover(one_cell(-1000, 0))
    assert storage.spec.width == 64


@given(corners=st.lists(st.tuples(st.integers(-400, 400), st.integers(-400, 400)), max_size=8))
@REPEATABLE
def test_always_whole_words_and_empty_bit_sets(corners):
    """The kernels rely on it: rows of whole words, one bit for each cell, none set."""
    storage = grid()
    for index, (column, row) in enumerate(corners):
        storage.cover(one_cell(column, row))
        put(storage, column, row, float(index))
        assert storage.spec.width % 64 == 0
        assert storage.log_odds.shape == (storage.spec.height, storage.spec.width)
        assert storage.log_odds.flags.c_contiguous
        for bits in (storage.free_bits, storage.hit_bits):
            assert 64 * bits.size == storage.log_odds.size
            assert not bits.any()
    last = {corner: float(index) for index, corner in enumerate(corners)}
    assert all(get(storage, *corner) == value for corner, value in last.items())


def test_no_side_is_longer_than_nav2_reads():
    storage = LogOddsGrid(0.1, 10**8)
    storage.cover(CellBox(0, 0, 10, 10))
    with pytest.raises(GridError, match=r'would grow to 33024 x 64 cells: .* 32767 along a side'):
        storage.cover(CellBox(33_000, 0, 33_010, 10))
    storage.cover(CellBox(29_990, 0, 30_000, 10))  # not with room for more, though
    assert storage.spec.width <= 32_767
