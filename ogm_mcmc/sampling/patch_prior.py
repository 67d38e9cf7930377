"""Prior probabilities of patches as flat tables for a sampler ([patch] section III).

`ogm_mcmc.sampling.border_backoff` says how counts of borders become probabilities.

Design note: specks in sparsely measured space
----------------------------------------------
Context. Far from data chains under the counts of real maps end in noise: half of the cells
occupied, at random. No map looks like that. Where beams are sparse the noise grows from the rim of
unknown space inwards, and beams that cross it are disbelieved: they have no clutter to speak of,
but there are few of them. It grows slowly, so a short run hides it. Two things feed it. Each
conditional is right (a speckled border has a speckled patch inside, in SLAM maps as well), but
they belong to no joint distribution that would say how rare speckled borders are. And beside a
speckled border hundreds of patches are possible, each below 0.01: cut off there, they share what
is left equally, the most ragged as much as the smoothest.

Decision. `refine_server` and `sample` tell patches apart from 0.003 on (`min_probability`, three
times as many candidates), leave 0.02 at most to all others (`max_floor`), and raise the table to
the power 1.15 (`strength`), floors too, after the unlikely patches were cut off. The experiments
of [patch] have 0.01, no bound and 1.

Consequence. F1 at 0.5, Brier score and calibration error of building 9, one of 20 beams, 400
sweeps, seed 1, on the cells that the live map measured (live: 0.953, 0.035, 0.178); nats a beam of
Intel, 5 % of the beams mapped, 120 sweeps, judged by the odd beams of every third scan (live, all
odd beams: -3.3). Building 9, office, hospital, Intel and buildings 1 and 5 are what was tuned on:

========  ===============  =========  ======================  =====
strength  min_probability  max_floor  building 9              Intel
========  ===============  =========  ======================  =====
1.3       0.01             1          0.853, 0.0096, 0.035    0.395
1.6       0.01             1          0.866, 0.0045, 0.013
2         0.01             1          0.878, 0.0039, 0.010
1.3       0.01             0.02       0.792, 0.0105, 0.037
1.2       0.003            1          0.967, 0.0011, 0.003
1.15      0.003            1          0.970, 0.0012, 0.003    0.719
1         0.003            0.02       0.949, 0.0019, 0.006    0.650
1.15      0.003            0.02       0.976, 0.0010, 0.003    0.755
1.3       0.003            0.02       0.933, 0.0014, 0.003    0.716
1.15      0.001            0.02                               0.744
1.2       0.001            0.02       0.951, 0.0011, 0.003
========  ===============  =========  ======================  =====

The first line after 120, 400 and 1200 sweeps: calibration error 0.018, 0.035, 0.117; with all
sweeps alike, instead of most where doubt is, 0.195 after 400. What was taken after 100 sweeps
before, and looked good, was noise that had not grown yet. A sweep takes no longer with three
times the candidates, as there is less in doubt.

Tried beside that: every pair of neighbours that differ in a patch or across its rim costs J. With
patches from 0.01 on it does harm (strength 1.3, J 0.2: 0.698, J 0.4: 0.397), since what it tells
apart is cut off; from 0.003 on, with 0.02 at most for the others, strength 1 and J 0.2 it is as
good as the power (0.981, 0.0011, 0.004), so it was left out. Earlier, at 100 sweeps: specks of
fewer than 12 cells removed from the training maps, independent cells of 0.15 mixed in, cells up
to 30 instead of 5 from a ray sampled, counts of the generated buildings: all worse. Taken window
by window other SLAM maps are predicted best with 1 (`learn-prior --held-out --strength`): the
power mends the chain of conditionals, not each of them. The power under which windows of sampled
maps are likeliest given their borders was 1.2 to 1.5 whatever chains had.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int32Array, Int64Array
from ogm_mcmc.config import PatchTableConfig
from ogm_mcmc.errors import PriorError, require
from ogm_mcmc.sampling.border_backoff import border_levels, smoothed
from ogm_mcmc.sampling.patch_learning import PatchCounts
from ogm_mcmc.sampling.patch_patterns import split

__all__ = [
    'PATCH_SIZES',
    'PRIORS',
    'PatchTable',
    'log_probabilities',
    'make_table',
    'nats_per_window',
    'to_power',
]

PRIORS = ('uniform', 'patch', 'border')
PATCH_SIZES = (1, 9, 25)

# Rows of 2**L probabilities that are worked on at once.
CHUNK = 2048


class PatchTable(NamedTuple):
    """Log-probabilities of patches, ready for a kernel.

    side             1, 3 or 5: a patch has L = side * side cells
    entry_of_border  (2**B,) int32, the entry that belongs to a border of B = 4 * side + 4 cells;
                     (1,) where the border does not matter: `border & (entry_of_border.size - 1)`
                     finds the entry in both cases
    start            (E + 1,) int32, entry e lists `start[e]` to `start[e + 1]`, at least one
    candidates       (C,) int32, patterns, within an entry the most probable first
    log_probability  (C,) float64, nats
    floor            (E,) float64, nats: log-probability of each pattern that is not listed

    Bit order: `ogm_mcmc.sampling.patch_patterns`. Every entry is one distribution over all 2**L
    patterns: sum of exp(log_probability) + (2**L - listed) exp(floor) is 1, and nothing is
    impossible.
    """

    side: int
    entry_of_border: Int32Array
    start: Int32Array
    candidates: Int32Array
    log_probability: Float64Array
    floor: Float64Array


def make_table(
    prior: str,
    patch_size: int,
    counts: PatchCounts | None = None,
    config: PatchTableConfig | None = None,
    *,
    p_occupied: float = 0.5,
) -> PatchTable:
    """Table of a prior by name, `uniform`, `patch` or `border`, for patches of 1, 9 or 25 cells.

    `uniform` needs no counts: its cells are independent and occupied with `p_occupied`.
    Raises PriorError for what cannot be had.
    """
    require(prior in PRIORS, 'prior', prior, f'one of {", ".join(PRIORS)}')
    require(patch_size in PATCH_SIZES, 'patch_size', patch_size, 'one of 1, 9, 25')
    config = config or PatchTableConfig()
    if prior == 'uniform':
        return _uniform(patch_size, p_occupied)
    if counts is None:
        raise PriorError(f'prior {prior} is learned: expected a prior file')
    if prior == 'patch':
        return to_power(_unconditioned(patch_size, counts, config), config.strength)
    if patch_size == 25:
        raise PriorError(
            'prior border with patch_size 25 needs windows of 7 x 7 cells, which are not counted: '
            'expected patch_size 1 or 9, or prior patch'
        )
    return to_power(_bordered(patch_size, counts, config), config.strength)


def log_probabilities(table: PatchTable, borders: AnyArray, patches: AnyArray) -> Float64Array:
    """Log-probability, nats, of each patch beside each border (broadcast together)."""
    entry = table.entry_of_border[np.asarray(borders) & (table.entry_of_border.size - 1)]
    owner = np.repeat(np.arange(table.floor.size), np.diff(table.start))
    shift = table.side**2
    keys = owner.astype(np.int64) << shift | table.candidates
    order = np.argsort(keys)
    wanted = entry.astype(np.int64) << shift | np.asarray(patches)
    place = order[np.searchsorted(keys, wanted, sorter=order).clip(max=keys.size - 1)]
    listed: Float64Array = np.where(
        keys[place] == wanted, table.log_probability[place], table.floor[entry]
    )
    return listed


def nats_per_window(table: PatchTable, counts: PatchCounts) -> float:
    """How well a table predicts counted windows: mean of -log p(patch | border), nats.

    Of maps that the table was not learned from; lower is better.
    """
    if table.side == 5:
        patches, seen = counts.squares.by_pattern(5)
        borders = np.zeros_like(patches)
    elif table.side == 3:
        patterns, seen = counts.squares.by_pattern(5)
        borders, patches = split(patterns, 3)
    else:
        patterns = np.arange(512, dtype=np.int32)
        seen = counts.patches
        borders, patches = split(patterns, 1)
    return float(-(seen @ log_probabilities(table, borders, patches)) / seen.sum())


def _uniform(patch_size: int, p_occupied: float) -> PatchTable:
    if patch_size == 25:
        raise PriorError(
            'prior uniform with patch_size 25 is intractable: every patch has '
            f'{2**25} equally likely configurations; expected prior patch'
        )
    require(0.0 < p_occupied < 1.0, 'p_occupied', p_occupied, 'must be between 0 and 1')
    occupied = np.array([pattern.bit_count() for pattern in range(2**patch_size)], np.float64)
    rows = p_occupied**occupied * (1.0 - p_occupied) ** (patch_size - occupied)
    return _table(patch_size, np.zeros(1, np.int32), [_listed(rows[None], 0.0, 1.0)])


def _unconditioned(patch_size: int, counts: PatchCounts, config: PatchTableConfig) -> PatchTable:
    """The share of each pattern among all windows; what none shows has the floor."""
    single = np.zeros(1, np.int32)
    if patch_size < 25:
        shares = _shares(counts.cells if patch_size == 1 else counts.patches)
        return _table(
            patch_size, single, [_listed(shares[None], config.min_share, config.max_floor)]
        )
    patterns, seen = counts.squares.by_pattern(5)
    # 2**25 rows of nothing: the floor is worked out, not filled in. As many windows as there are
    # different patterns stand for those never seen, as of the dropped ones (Witten and Bell).
    total = float(seen.sum() + 8 * counts.dropped + seen.size)
    shares = seen / total
    listed = shares >= min(config.min_share, float(shares.max()))
    patterns, shares = patterns[listed], shares[listed]
    order = np.lexsort((patterns, -shares))
    floor = min(1.0 - float(shares.sum()), config.max_floor)
    scale = (1.0 - floor) / float(shares.sum())
    return PatchTable(
        5,
        single,
        np.array([0, patterns.size], np.int32),
        patterns[order],
        np.log(shares[order] * scale),
        np.log(np.array([floor / (2**25 - patterns.size)])),
    )


def _shares(seen: Int64Array) -> Float64Array:
    """Share of each pattern, one window more for each so that none is impossible."""
    shares: Float64Array = (seen + 1.0) / (seen.sum() + seen.size)
    return shares


def _bordered(patch_size: int, counts: PatchCounts, config: PatchTableConfig) -> PatchTable:
    """The patch given the cells around it ([patch] III-B), where they were seen often enough."""
    levels = border_levels(patch_size, counts)
    base = _shares(counts.cells if patch_size == 1 else counts.patches)
    depth = np.zeros(levels[0].windows.size, np.int64)  # how many levels a border may use
    for number, level in enumerate(levels, 1):
        often = level.windows[np.arange(depth.size) & level.mask] >= config.min_windows
        depth[often] = number
    masks = np.array([0, *(level.mask for level in levels)])
    # One entry for all borders that look the same as far as they are looked at.
    names = depth << 32 | (np.arange(depth.size) & masks[depth])
    entries, entry_of_border = np.unique(names, return_inverse=True)
    parts = []
    for first in range(0, entries.size, CHUNK):
        chunk = entries[first : first + CHUNK]
        rows = smoothed(chunk & 0xFFFFFFFF, chunk >> 32, levels, base, config.backoff_weight)
        parts.append(_listed(rows, config.min_probability, config.max_floor))
    return _table(patch_size, entry_of_border.astype(np.int32), parts)


def to_power(table: PatchTable, strength: float) -> PatchTable:
    """Return the table with every probability, floors too, raised to a power and normalised."""
    if strength == 1.0:
        return table
    listed = np.diff(table.start)
    powers, floor = strength * table.log_probability, strength * table.floor
    total = np.add.reduceat(np.exp(powers), table.start[:-1])
    norm = np.log(total + (2.0 ** (table.side**2) - listed) * np.exp(floor))
    return table._replace(log_probability=powers - np.repeat(norm, listed), floor=floor - norm)


class _Listed(NamedTuple):
    """Entries of a table in the making; `listed` (n,) says how many candidates each has."""

    listed: Int64Array
    candidates: Int32Array
    log_probability: Float64Array
    floor: Float64Array


def _listed(rows: Float64Array, least: float, max_floor: float) -> _Listed:
    """List the patterns of each row that are likely enough; the others share what they have.

    An equal share for each serves better than shares as without a border: what is left over is
    spread over many rare patterns, not over the few that are common elsewhere.
    """
    # The most likely ones are always listed; all of them, so that images are treated alike.
    keep = rows >= np.minimum(least, rows.max(axis=1))[:, None]
    listed = keep.sum(axis=1)
    others = rows.shape[1] - listed
    left = np.where(keep, 0.0, rows).sum(axis=1)
    allowed = np.minimum(left, max_floor)
    entry, pattern = np.nonzero(keep)
    scale = (1.0 - allowed) / np.where(keep, rows, 0.0).sum(axis=1)
    probability = rows[entry, pattern] * scale[entry]
    order = np.lexsort((pattern, -rows[entry, pattern], entry))
    # Where all are listed the floor is the least of them, and no pattern has it.
    spread = np.where(others > 0, allowed / np.maximum(others, 1), rows.min(axis=1))
    return _Listed(
        listed, pattern[order].astype(np.int32), np.log(probability[order]), np.log(spread)
    )


def _table(patch_size: int, entry_of_border: Int32Array, parts: list[_Listed]) -> PatchTable:
    listed = np.concatenate([part.listed for part in parts])
    return PatchTable(
        round(patch_size**0.5),
        entry_of_border,
        np.concatenate(([0], np.cumsum(listed))).astype(np.int32),
        np.concatenate([part.candidates for part in parts]),
        np.concatenate([part.log_probability for part in parts]),
        np.concatenate([part.floor for part in parts]),
    )
