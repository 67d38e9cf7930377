"""From counted windows to the probability of a patch beside a border ([patch] III-B).

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
the prior that is shipped (the twelfth, of 10 cm cells, is learned from unless skipped):

=========================================================  =====
`--min-probability` 0 (all are listed) / 0.001 / 0.003     0.555 / 0.568 / 0.577
**`--min-probability` 0.01**                               0.603
-- with 0.003
`--min-windows` 1 / 400                                    0.577 / 0.587
`--backoff-weight` 1 / 3 / 20                              0.578 / 0.576 / 0.591
`--least` 2 / 13 (rare windows dropped from the counts)    0.588 / 0.669
`--coarser` skip / stretch (the map of 10 cm)              0.581 / 0.601
=========================================================  =====

In an earlier form, all patches listed and eight maps: a fixed weight of 16 / 64 / 200 windows on
the unconditioned patch instead of w T 0.613 / 0.605 / 0.607, with 12 and 4 cells between 0.588 at
best, absolute discounting 0.576, as above 0.565. A floor in proportion to the unconditioned patch,
or to patches with as many occupied cells, is worse than an equal one (0.955 and 0.911 instead of
0.886 on the largest map): what is left over is rare patterns, not those common elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.sampling.patch_learning import PatchCounts
from ogm_mcmc.sampling.patch_patterns import ring_cells, split

__all__ = ['BorderLevel', 'border_levels', 'smoothed']


@dataclass(frozen=True)
class BorderLevel:
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


def border_levels(patch_size: int, counts: PatchCounts) -> list[BorderLevel]:
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
            BorderLevel(
                mask,
                keys,
                number,
                np.bincount(at, number, n_borders).astype(np.float64),
                np.bincount(at, minlength=n_borders).astype(np.float64),
            )
        )
    return levels


def smoothed(
    borders: Int64Array,
    depths: Int64Array,
    levels: list[BorderLevel],
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
