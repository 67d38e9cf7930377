"""Chains in a file, from which sampling goes on as if nothing had happened.

An NPZ of the map and counts of each chain, and of where it looks most, and a header in JSON: the
version, numbers of chains and sweeps, generators, the size of the window, the log-likelihood of
each map, and the settings.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.errors import WindowError
from ogm_mcmc.files.npz_files import TEXT, Field, NpzFile, npz_file
from ogm_mcmc.sampling import PosteriorModel, PosteriorSampler
from ogm_mcmc.sampling.burn_in import decides_after
from ogm_mcmc.sampling.diagnostics import BatchCounts
from ogm_mcmc.sampling.gibbs_kernels import PARTS

__all__ = [
    'FINGERPRINT',
    'FOUND',
    'load_chains',
    'require_saved',
    'save_chains',
    'saved_settings',
]

# Among the settings, that of the scans: the first of them.
FINGERPRINT = 'fingerprint'

# The setting that holds what was found of the beams.
FOUND = 'found'

# Of 1 sweeps were counted, not parts of them; up to 2 where chains look most followed from counts;
# up to 3 it was decided later, and a burn-in never ended early; up to 4 nothing was said of
# sigma, nor of how many scans told of the beams, and sweeps drew other numbers; up to 5 nothing
# was said of grazing.
VERSION = 6


def save_chains(sampler: PosteriorSampler, path: Path, settings: dict[str, Any]) -> None:
    """Write everything that `load_chains` needs to go on as if nothing had happened."""
    arrays: dict[str, Any] = {}
    for j, cells in enumerate(sampler.maps()):
        arrays[f'cells_{j}'] = np.packbits(cells)
    for number, counts in enumerate((*sampler.counts, *sampler.settling)):
        arrays[f'counts_{number}'] = counts.counts
        arrays[f'progress_{number}'] = (counts.batch_length, counts.full, counts.in_last)
    for j, focus in sampler.focus.items():
        arrays[f'focus_{j}'] = np.packbits(focus.cells)
    header = {
        'version': VERSION,
        'chains': sampler.n_chains,
        'settling': len(sampler.settling),
        'sweeps': sampler.sweeps,
        'focus_after': [focus.after for _, focus in sorted(sampler.focus.items())],
        'burn_in': sampler.burn_in,
        'may_end': sampler.may_end,
        'n_cells': sampler.model.n_cells,
        'touched': int(sampler.model.touched.size),
        'log_likelihoods': sampler.log_likelihoods(),
        'generators': [rng.bit_generator.state for rng in sampler.rngs],
        'settings': settings,
    }
    with path.open('wb') as stream:
        np.savez_compressed(stream, header=np.array(json.dumps(header)), **arrays)


def load_chains(
    path: Path,
    model: PosteriorModel,
    accept: Callable[[dict[str, Any]], object] = lambda settings: None,
) -> tuple[PosteriorSampler, dict[str, Any]]:
    """Return the sampler that was saved, and its settings.

    `accept` sees the settings first, and raises WindowError when they are not those wanted.
    Raises WindowError, too, when the file is no such file or is of another window.
    """
    with npz_file(path, 'a saved sampling state', WindowError) as held:
        header = _header_in(held, path)
        accept(header['settings'])
        _check_window(path, header, (model.n_cells, model.touched.size))
        sampler = PosteriorSampler(model, [], seed=0, burn_in=int(header['burn_in']))
        sampler.sweeps = int(header['sweeps'])
        for j in range(min(int(header['chains']), len(header['generators']))):
            sampler.states.append(model.start(_cells_in(held, j, model.n_cells)))
            sampler.counts.append(_counts_in(held, j, model.touched.size))
            rng = np.random.default_rng()
            rng.bit_generator.state = header['generators'][j]
            sampler.rngs.append(rng)
        chains = len(sampler.states)
        settling = int(header['settling'])
        if settling not in (0, chains):
            raise ValueError(f'burn-in of {settling} chains: expected 0 or {chains}')
        sampler.settling = [
            _counts_in(held, chains + j, model.touched.size) for j in range(settling)
        ]
        if len({counts.n_sweeps for counts in sampler.settling}) > 1:
            raise ValueError('burn-in of other lengths: expected the same of every chain')
        sampler.may_end = bool(header['may_end']) and settling > 0
        _take_focus(held, sampler, header['focus_after'])
        if chains != header['chains']:
            raise ValueError(f'{header["chains"]} chains: expected as many generators')
        _check_chains(sampler, path, header['log_likelihoods'])
    return sampler, header['settings']


def saved_settings(path: Path) -> dict[str, Any]:
    """Return the settings of a saved state; raises WindowError for any other file."""
    with npz_file(path, 'a saved sampling state', WindowError) as held:
        settings: dict[str, Any] = _header_in(held, path)['settings']
        return dict(settings)


def require_saved(path: Path, wanted: dict[str, Any], saved: dict[str, Any]) -> None:
    """Raise WindowError unless a state was saved with these settings; says the first that differs.

    Other scans are said before settings that follow from them (`window.no_return`, found).
    """
    for key, value in wanted.items():
        if key not in saved or saved[key] != value:
            if key == FINGERPRINT:
                raise WindowError(
                    f'{path}: a state of other scans: expected one of those of this window'
                )
            if key not in saved:
                raise WindowError(
                    f'{path}: a state saved by a version without {key}: it cannot be taken up '
                    f'with {key} {value!r}; sample anew'
                )
            raise WindowError(
                f'{path}: expected {key} {saved[key]!r}, as it was saved with, not {value!r}'
            )


def _header_in(held: NpzFile, path: Path) -> dict[str, Any]:
    """Return the header; raises WindowError when it is of another version."""
    header: dict[str, Any] = json.loads(str(held.read('header', TEXT)))
    if header['version'] != VERSION:
        raise WindowError(
            f'{path}: a sampling state of version {header["version"]}: expected {VERSION}, '
            'others cannot be taken up; sample anew'
        )
    return header


def _cells_in(held: NpzFile, chain: int, n_cells: int) -> UInt8Array:
    """Return the map (K,) of a chain."""
    packed = held.read(f'cells_{chain}', Field('u', ((n_cells + 7) // 8,)))
    cells: UInt8Array = np.unpackbits(packed, count=n_cells)
    return cells


def _take_focus(held: NpzFile, sampler: PosteriorSampler, after: list[int]) -> None:
    """Let chains look most where they did; `after` so many sweeps each, none: nowhere yet."""
    if len(after) not in (0, len(sampler.states)):
        raise ValueError(f'decided in {len(after)} chains: expected all or none')
    for j, decided in enumerate(after):
        if decided >= sampler.sweeps or not decides_after(sampler.burn_in, decided):
            raise ValueError(f'decided after {decided} sweeps: expected the burn-in')
        n = 2 * sampler.model.touched.size
        packed = held.read(f'focus_{j}', Field('u', ((n + 7) // 8,)))
        cells = np.unpackbits(packed, count=n).reshape(2, -1).view(np.bool_)
        sampler.look_at(j, decided, cells)


def _counts_in(held: NpzFile, chain: int, n_touched: int) -> BatchCounts:
    """Return what a chain counted in C cells."""
    counts = BatchCounts(n_touched)
    rows = held.read(f'counts_{chain}', Field('u', counts.counts.shape))
    if rows.dtype not in (np.uint16, np.uint32):
        raise ValueError(f'counts_{chain} is {rows.dtype}: expected uint16 or uint32')
    progress = held.read(f'progress_{chain}', Field('iu', (3,)))
    counts.counts = rows
    counts.batch_length, counts.full, counts.in_last = map(int, progress)
    if not (0 <= counts.full < len(rows) and 0 <= counts.in_last < counts.batch_length):
        raise ValueError(f'batches {progress}: expected a row to go on with')
    most = np.zeros(len(rows), np.int64)
    most[: counts.full], most[counts.full] = counts.batch_length, counts.in_last
    most *= PARTS
    if (rows.max(axis=1, initial=0) > most).any():
        raise ValueError(f'counts_{chain}: expected no more than the sweeps of a batch')
    return counts


def _check_window(path: Path, header: dict[str, Any], here: tuple[int, int]) -> None:
    """Raise WindowError unless a state is of so many cells, of which so many are sampled."""
    saved = header['n_cells'], header['touched']
    if saved != here:
        raise WindowError(
            f'{path}: sampled {saved[1]} of {saved[0]} cells: expected {here[1]} of {here[0]}, '
            'those of this window'
        )


def _check_chains(sampler: PosteriorSampler, path: Path, log_likelihoods: list[float]) -> None:
    """Refuse counts of other lengths, and maps that other readings make as likely as this."""
    counted = max(sampler.sweeps - sampler.burn_in, 0)
    if any(counts.n_sweeps != counted for counts in sampler.counts) or not sampler.counts:
        raise ValueError(f'expected {counted} counted sweeps of every chain')
    if not np.allclose(sampler.log_likelihoods(), log_likelihoods, rtol=1e-6, atol=1e-4):
        raise WindowError(
            f'{path}: its maps had log-likelihood {log_likelihoods[0]:.6g}: expected '
            f'{sampler.log_likelihoods()[0]:.6g}, as they have with the rays of this window'
        )
