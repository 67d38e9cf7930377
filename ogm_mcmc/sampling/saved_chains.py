"""What a file of saved chains holds, checked as it is read; `PosteriorSampler.save` writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.errors import WindowError
from ogm_mcmc.files.npz_files import TEXT, Field, NpzFile, npz_file
from ogm_mcmc.sampling.diagnostics import BatchCounts
from ogm_mcmc.sampling.gibbs_kernels import PARTS

__all__ = ['cells_in', 'check_window', 'counts_in', 'saved_settings']


def saved_settings(path: Path) -> dict[str, Any]:
    """Return the settings of a saved state; raises WindowError for any other file."""
    with npz_file(path, 'a saved sampling state', WindowError) as held:
        settings: dict[str, Any] = json.loads(str(held.read('header', TEXT)))['settings']
        return dict(settings)


def cells_in(held: NpzFile, chain: int, n_cells: int) -> UInt8Array:
    """Return the map (K,) of a chain."""
    packed = held.read(f'cells_{chain}', Field('u', ((n_cells + 7) // 8,)))
    cells: UInt8Array = np.unpackbits(packed, count=n_cells)
    return cells


def counts_in(held: NpzFile, chain: int, n_touched: int, parts: int) -> BatchCounts:
    """Return what a chain counted in C cells; `parts` of a sweep were counted."""
    counts = BatchCounts(n_touched)
    rows = held.read(f'counts_{chain}', Field('u', counts.counts.shape))
    if rows.dtype not in (np.uint16, np.uint32):
        raise ValueError(f'counts_{chain} is {rows.dtype}: expected uint16 or uint32')
    progress = held.read(f'progress_{chain}', Field('iu', (3,)))
    counts.counts = rows if parts == PARTS else rows.astype(np.uint32) * np.uint32(PARTS)
    counts.batch_length, counts.full, counts.in_last = map(int, progress)
    if not (0 <= counts.full < len(rows) and 0 <= counts.in_last < counts.batch_length):
        raise ValueError(f'batches {progress}: expected a row to go on with')
    most = np.zeros(len(rows), np.int64)
    most[: counts.full], most[counts.full] = counts.batch_length, counts.in_last
    most *= parts
    if (rows.max(axis=1, initial=0) > most).any():
        raise ValueError(f'counts_{chain}: expected no more than the sweeps of a batch')
    return counts


def check_window(path: Path, header: dict[str, Any], here: tuple[int, int]) -> None:
    """Raise WindowError unless a state is of so many cells, of which so many are sampled."""
    if header['version'] not in (1, 2):
        raise WindowError(f'{path}: version {header["version"]}: expected 1 or 2')
    saved = header['n_cells'], header['touched']
    if saved != here:
        raise WindowError(
            f'{path}: sampled {saved[1]} of {saved[0]} cells: expected {here[1]} of {here[0]}, '
            'those of this window'
        )
