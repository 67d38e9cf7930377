"""Prior probabilities of patches as flat tables for a sampler ([patch] section III).

Design note: from counts to probabilities
-----------------------------------------
Context. [patch] counts clean drawings: 865 borders, at most 13 patches beside one, and what was
never seen is impossible. Maps made by robots are speckled. Nearly every border occurs, most of
them a few times, with up to 400 patches; such counts are large, and say little about the next
map when they are taken at their word.

Decision. What a border says is mixed with what fewer of its cells say: all 16, the 12 that are no
corners, the 4 in the middle of a side, none. From one to the next

    p(patch | border) = (n + w T p(patch | fewer cells)) / (N + w T)

where N windows show the border, n of them with the patch, and T is the number of different
patches among them (Witten and Bell's back-off, with a weight). A border seen with many patches
will show new ones, too; one always seen with the same will not. A border seen less than
`min_windows` times has no entry of its own and shares that of its fewer cells. Patches from
`min_probability` on are listed; the others of an entry share what is left, equally.

Consequence. Every entry is a distribution over all patterns; nothing is impossible, so a sampler
is ergodic without the random patches of [patch]; images of a border have images of its entry,
since every window is counted in its eight images. The entries are still conditionals estimated
one by one: those of overlapping patches need not belong to one joint distribution.

A sampler that only ever chooses among the listed ones is not ergodic. Cheap and invariant: with a
small probability that does not depend on the state draw from all 2**L patterns, floor included;
else, if the patch at hand is listed, draw from the listed ones, and if it is not, leave it.

What was tried, by `learn-prior --held-out`: maps left out in turn and predicted by the others,
-log p(patch | border) in nats per window, the mean over the eleven maps with cells up to 5 cm of
the prior that is shipped (the twelfth, of 10 cm cells, is always among those learned from):

=========================================================  =====
`--min-probability` 0 (all are listed) / 0.001 / 0.003     0.555 / 0.568 / 0.577
**`--min-probability` 0.01**                               0.603
-- with 0.003
`--min-windows` 1 / 400                                    0.577 / 0.587
`--backoff-weight` 1 / 3 / 20                              0.578 / 0.576 / 0.591
`--least` 2 / 13 (rare windows dropped from the counts)    0.588 / 0.669
`--coarser` skip / stretch (the map of 10 cm)              0.581 / 0.601
=========================================================  =====

Listing less costs little where it counts. In three maps cells were hidden at random (80 to 95 %)
and sampled from the table of the other maps, given what was not hidden: F1 near walls is the same
within 0.005 with 0.003 and with 0.01, at half the candidates a sampler looks at (4.4 to 9.2 a
patch against 2.4 to 4.6). A floor cut to 0.001 (`max_floor`) is as good with 80 % hidden and worse
with 95 % (F1 at 0.5 of 0.49 instead of 0.66 on one of the maps): without it walls hardly begin.

In an earlier form, all patches listed and eight maps: a fixed weight of 16 / 64 / 200 windows on
the unconditioned patch instead of w T 0.613 / 0.605 / 0.607, with 12 and 4 cells between 0.588 at
best, absolute discounting 0.576, as above 0.565. A floor in proportion to the unconditioned patch,
or to patches with as many occupied cells, is worse than an equal one (0.955 and 0.911 instead of
0.886 on the largest map): what is left over is rare patterns, not those common elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int32Array, Int64Array
from ogm_mcmc.config import PatchTableConfig
from ogm_mcmc.errors import PriorError, require
from ogm_mcmc.sampling.patch_learning import PatchCounts
from ogm_mcmc.sampling.patch_patterns import ring_cells, split

__all__ = [
    'PATCH_SIZES',
    'PRIORS',
    'PatchTable',
    'log_probabilities',
    'make_table',
    'nats_per_window',
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
        return _unconditioned(patch_size, counts, config)
    if patch_size == 25:
        raise PriorError(
            'prior border with patch_size 25 needs windows of 7 x 7 cells, which are not counted: '
            'expected patch_size 1 or 9, or prior patch'
        )
    return _bordered(patch_size, counts, config)


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


@dataclass(frozen=True)
class _Level:
    """What windows say about the patch when only some border cells (`mask`) are looked at.

    keys     (n,) int64, ascending: masked border * 2**L + patch; `seen` (n,) windows
    windows  (2**B,) by masked border; `patches` (2**B,) how many different ones it was seen with
    """

    mask: int
    keys: Int64Array
    seen: Float64Array
    windows: Float64Array
    patches: Float64Array

    def dense(self, borders: Int64Array, n_patterns: int) -> Float64Array:
        """Windows by border and patch (len(borders), n_patterns)."""
        masked = borders & self.mask
        first = np.searchsorted(self.keys, masked * n_patterns)
        last = np.searchsorted(self.keys, (masked + 1) * n_patterns)
        rows = np.repeat(np.arange(borders.size), last - first)
        # Each border owns one run of keys; all runs one after the other.
        runs = [np.arange(low, high) for low, high in zip(first, last, strict=True)]
        places = np.concatenate(runs)
        counts = np.zeros((borders.size, n_patterns))
        counts[rows, self.keys[places] % n_patterns] = self.seen[places]
        return counts


def _levels(patch_size: int, counts: PatchCounts) -> list[_Level]:
    """Fewer border cells first: the middle of each side, all but the corners, all."""
    side = 1 if patch_size == 1 else 3
    if side == 3:
        patterns, seen = counts.squares.by_pattern(5)
    else:
        patterns = np.flatnonzero(counts.patches).astype(np.int32)
        seen = counts.patches[patterns]
    borders, patches = split(patterns, side)
    ring = ring_cells(side)
    outside = (ring < 0) | (ring >= side)
    middle = side // 2
    chosen = [(ring == middle).any(axis=1), ~outside.all(axis=1), np.ones(len(ring), np.bool_)]
    masks = sorted({int((1 << np.flatnonzero(cells)).sum()) for cells in chosen})
    levels = []
    for mask in sorted(masks, key=int.bit_count):
        every = (borders.astype(np.int64) & mask) << patch_size | patches
        keys, index = np.unique(every, return_inverse=True)
        number = np.bincount(index, seen).astype(np.float64)
        at = keys >> patch_size
        n_borders = 2 ** len(ring)
        levels.append(
            _Level(
                mask,
                keys,
                number,
                np.bincount(at, number, n_borders).astype(np.float64),
                np.bincount(at, minlength=n_borders).astype(np.float64),
            )
        )
    return levels


def _bordered(patch_size: int, counts: PatchCounts, config: PatchTableConfig) -> PatchTable:
    """The patch given the cells around it ([patch] III-B), where they were seen often enough."""
    levels = _levels(patch_size, counts)
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
        rows = _smoothed(chunk & 0xFFFFFFFF, chunk >> 32, levels, base, config.backoff_weight)
        parts.append(_listed(rows, config.min_probability, config.max_floor))
    return _table(patch_size, entry_of_border.astype(np.int32), parts)


def _smoothed(
    borders: Int64Array,
    depths: Int64Array,
    levels: list[_Level],
    base: Float64Array,
    weight: float,
) -> Float64Array:
    """Probability of each patch (len(borders), 2**L), looking at `depths` levels.

    p <- (n + w T p) / (N + w T) from level to level (Witten and Bell's back-off): N windows show
    the border, n of them with this patch, T different patches in all. Borders with many
    different patches will show new ones, too; those always seen with the same will not.
    """
    rows = np.tile(base, (borders.size, 1))
    for number, level in enumerate(levels, 1):
        used = np.flatnonzero(depths >= number)
        if used.size == 0:
            break
        masked = borders[used] & level.mask
        prior_weight = (weight * level.patches[masked])[:, None]
        seen = level.dense(masked, base.size)
        rows[used] = (seen + prior_weight * rows[used]) / (
            level.windows[masked][:, None] + prior_weight
        )
    return rows


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
