"""What travels of a chain: the same counts on both sides, in few bytes."""

import numpy as np
import pytest

from ogm_mcmc.lab.chain_parcels import (
    AddedCounts,
    pack_bits,
    pack_counts,
    pack_rows,
    unpack_bits,
    unpack_counts,
    unpack_rows,
)
from ogm_mcmc.sampling.diagnostics import BatchCounts
from ogm_mcmc.sampling.gibbs_kernels import PARTS

N = 50
RNG = np.random.default_rng(3)
OCCUPIED = RNG.random(N) < 0.4


def sweep():
    """What one sweep adds: the cells of the last map, some others, some probabilities."""
    row = OCCUPIED * PARTS
    row[RNG.integers(N, size=5)] = RNG.integers(0, PARTS + 1, 5)
    return row.astype(np.uint16)


@pytest.mark.parametrize('whole', [True, False])
def test_what_is_added_elsewhere_is_what_is_counted_here(whole):
    here, there, home = BatchCounts(N), BatchCounts(N), BatchCounts(N)
    for n_before in range(21):
        row = sweep()
        for counts in (here, there, home):
            counts.add(row, 1)
        del n_before
    added = AddedCounts(there, N, whole=whole)
    for n_sweeps in (1, 2, 7, 30, 64):
        for _ in range(n_sweeps):
            row = sweep()
            here.add(row, 1)
            added.row[:] += row
            added.sweep_added()
        rows = unpack_rows(pack_rows(added.take_added(), OCCUPIED), OCCUPIED)
        assert sum(n for _, n in rows) == n_sweeps
        for row, n in rows:
            home.add(row, n)
        assert added.take_added() == []
        for counts in (home, added):
            assert counts.batch_length == here.batch_length
            assert (counts.full, counts.in_last) == (here.full, here.in_last)
        assert np.array_equal(home.counts, here.counts)
        assert home.counts.dtype == here.counts.dtype
        assert not whole or np.array_equal(added.counts, here.counts)


@pytest.mark.parametrize('n_sweeps', [0, 5, 16, 40, 15 * 1024 + 7])
def test_counts_come_back_as_they_were(n_sweeps):
    """Also where a batch is so long that its counts need four bytes."""
    counts = BatchCounts(N)
    left = n_sweeps
    while left:
        n = min(left, counts.batch_length - counts.in_last)
        counts.add(sweep().astype(np.int32) * n, n)
        left -= n
    back = unpack_counts(pack_counts(counts, OCCUPIED), OCCUPIED)
    assert back.counts.dtype == counts.counts.dtype
    assert np.array_equal(back.counts, counts.counts)
    assert (back.n_sweeps, back.full) == (n_sweeps, counts.full)


def test_what_is_as_in_the_last_map_takes_next_to_nothing():
    occupied = np.random.default_rng(1).random(100_000) < 0.3
    row = (occupied * PARTS * 9).astype(np.uint16)
    row[::1000] = 100
    (packed,) = pack_rows([(row, 9)], occupied)
    assert len(packed.coded) < 2000
    ((back, n),) = unpack_rows([packed], occupied)
    assert n == 9
    assert np.array_equal(back, row)


@pytest.mark.parametrize(('most', 'n_bytes'), [(127, 1), (128, 2), (32_767, 2), (32_768, 4)])
def test_the_narrowest_integers_are_taken(most, n_bytes):
    row = np.array([0, most, 3], np.uint32)
    (packed,) = pack_rows([(row, 1)], np.zeros(3, np.bool_))
    assert packed.n_bytes == n_bytes
    assert np.array_equal(unpack_rows([packed], np.zeros(3, np.bool_))[0][0], row)


def test_bits_come_back():
    bits = RNG.random((2, 13)) < 0.5
    assert np.array_equal(unpack_bits(pack_bits(bits), 26).reshape(2, 13), bits)
