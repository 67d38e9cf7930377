"""Chains as few bytes: what travels between a command and the workers that advance its chains.

Design note: what sweeps add
----------------------------
Context. The counts of a chain are 64 bytes a cell: 104 MB in a window of two million beams. They
were sent both ways in every round.

Decision. A worker sends what its sweeps added, batch by batch (`AddedCounts`), and whoever has the
counts adds it. What is added is a number of parts, `PARTS` for an occupied cell, so it is whole,
and sums are the same however they are put together. Nearly every cell is in all maps what it is in
the last one: what is sent is the difference to that, in the narrowest integers that hold it, first
all their lowest bytes, and zlib leaves next to nothing of the zeros. Nothing is rounded. Counts
as a whole (`pack_counts`) are coded like that, too.

Consequence. Figures: docs/whole_drive.md.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, UInt8Array
from ogm_mcmc.sampling.diagnostics import BatchCounts
from ogm_mcmc.sampling.gibbs_kernels import PARTS

__all__ = [
    'AddedCounts',
    'PackedCounts',
    'PackedRow',
    'pack_bits',
    'pack_counts',
    'pack_rows',
    'unpack_bits',
    'unpack_counts',
    'unpack_rows',
]

# zlib: more effort takes three times as long, and saves a tenth.
EFFORT = 1


class PackedRow(NamedTuple):
    """What `n_sweeps` sweeps of one batch added to the counts of C cells.

    coded  its difference to what the cells of a map would have added, in integers of `n_bytes`
    """

    n_sweeps: int
    n_bytes: int
    coded: bytes


class PackedCounts(NamedTuple):
    """Counts as a whole: a row for each full batch and the one being filled.

    `batch_length`, `full`, `in_last` as in `BatchCounts`.
    """

    batch_length: int
    full: int
    in_last: int
    rows: list[PackedRow]


class AddedCounts(BatchCounts):
    """Counts of a chain that somebody else has, too: what is added is kept until it is taken.

    It goes on from `before`. With `whole` all counts are here as ever; without it only how long
    batches are, which takes no memory.
    """

    def __init__(self, before: BatchCounts, n_cells: int, *, whole: bool) -> None:
        super().__init__(0)
        self.counts = before.counts if whole else before.counts[:, :0].copy()
        self.batch_length = before.batch_length
        self.full, self.in_last = before.full, before.in_last
        self._whole = whole
        self._sweep = np.zeros(n_cells, np.uint16)
        self._added: list[tuple[AnyArray, int]] = []

    @property
    def row(self) -> AnyArray:
        """Counts (C,) of the next sweep alone; call `sweep_added` afterwards."""
        return self._sweep

    def sweep_added(self) -> None:
        """Note that a sweep was added to `row`."""
        if not self._added or self.in_last == 0:
            self._added.append((np.zeros(self._sweep.size, self.counts.dtype), 0))
        row, n_sweeps = self._added[-1]
        row += self._sweep
        self._added[-1] = row, n_sweeps + 1
        if self._whole:
            self.counts[self.full] += self._sweep
        self._sweep[:] = 0
        super().sweep_added()

    def take_added(self) -> list[tuple[AnyArray, int]]:
        """Return counts (C,) and numbers of sweeps, each of one batch, since this was last asked.

        They are kept no longer.
        """
        added, self._added = self._added, []
        return added


def pack_bits(bits: AnyArray) -> bytes:
    """Return bits of any shape as bytes."""
    return zlib.compress(np.packbits(bits).tobytes(), EFFORT)


def unpack_bits(coded: bytes, count: int) -> UInt8Array:
    """Return so many bits (count,)."""
    bits: UInt8Array = np.unpackbits(np.frombuffer(zlib.decompress(coded), np.uint8), count=count)
    return bits


def pack_rows(rows: Sequence[tuple[AnyArray, int]], occupied: BoolArray) -> list[PackedRow]:
    """Return rows (C,) of so many sweeps each as bytes; most cells are as `occupied` (C,)."""
    return [_packed(row, n_sweeps, occupied) for row, n_sweeps in rows]


def unpack_rows(rows: Sequence[PackedRow], occupied: BoolArray) -> list[tuple[AnyArray, int]]:
    """Return the rows that were packed with the same cells `occupied`."""
    return [(_unpacked(row, occupied), row.n_sweeps) for row in rows]


def pack_counts(counts: BatchCounts, occupied: BoolArray) -> PackedCounts:
    """Return counts of C cells as bytes; see `pack_rows`."""
    rows = [(row, counts.batch_length) for row in counts.batches()]
    if counts.in_last:
        rows.append((counts.row, counts.in_last))
    return PackedCounts(
        counts.batch_length, counts.full, counts.in_last, pack_rows(rows, occupied)
    )


def unpack_counts(packed: PackedCounts, occupied: BoolArray) -> BatchCounts:
    """Return the counts that were packed with the same cells `occupied`."""
    counts = BatchCounts(occupied.size, batch_length=packed.batch_length)
    counts.full, counts.in_last = packed.full, packed.in_last
    for into, (row, _) in zip(counts.counts, unpack_rows(packed.rows, occupied), strict=False):
        into[:] = row
    return counts


def _packed(row: AnyArray, n_sweeps: int, occupied: BoolArray) -> PackedRow:
    other = row.astype(np.int32) - np.int32(PARTS * n_sweeps) * occupied
    most = max(int(other.max(initial=0)), -1 - int(other.min(initial=0)))
    n_bytes = next(n for n in (1, 2, 4) if most < 1 << (8 * n - 1))
    narrow = other.astype(f'<i{n_bytes}')
    by_byte = np.ascontiguousarray(narrow.view(np.uint8).reshape(-1, n_bytes).T)
    return PackedRow(n_sweeps, n_bytes, zlib.compress(by_byte.tobytes(), EFFORT))


def _unpacked(row: PackedRow, occupied: BoolArray) -> AnyArray:
    by_byte = np.frombuffer(zlib.decompress(row.coded), np.uint8).reshape(row.n_bytes, -1)
    other = np.ascontiguousarray(by_byte.T).view(f'<i{row.n_bytes}')[:, 0]
    whole: AnyArray = other.astype(np.int32) + np.int32(PARTS * row.n_sweeps) * occupied
    return whole
