"""What training maps look like in patches, beside what [patch] section III reports."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Int64Array
from ogm_mcmc.sampling.patch_learning import PatchCounts
from ogm_mcmc.sampling.patch_patterns import split

__all__ = ['PUBLISHED', 'patch_statistics']

COVERED = 0.999

PUBLISHED: dict[str, float] = {
    'p_occupied': 0.234,
    'patches_seen': 124,
    'patches_for_99.9_percent': 50,
    'patch_free': 0.743,
    'patch_occupied': 0.211,
    'squares_seen': 2329,
    'squares_for_99.9_percent': 436,
    'square_free': 0.7198,
    'square_occupied': 0.1892,
    'borders_seen': 865,
    'most_patches_per_border': 13,
    'likeliest_patch': 0.865,
    'likeliest_four': 0.997,
    'cell_borders_seen': 84,
    'cell_borders_undecided': 40,
}
"""[patch] section III, ten drawn maps: 3 x 3 patches, 5 x 5 squares, borders of 16 and 8 cells."""


def patch_statistics(counts: PatchCounts) -> dict[str, float]:
    """The figures of `PUBLISHED` for counted maps, and how many windows they rest on.

    `likeliest_patch` and `likeliest_four` are means over borders of how often the most frequent
    patch, or one of the four most frequent, was seen with a border (Fig. 4 of [patch]).
    """
    squares, seen = counts.squares.by_pattern(5)
    shares = {
        int(pattern): int(n) for pattern, n in zip(squares[[0, -1]], seen[[0, -1]], strict=True)
    }
    borders, _ = split(squares, 3)
    _, first, per_border = np.unique(np.sort(borders), return_index=True, return_counts=True)
    order = np.lexsort((-seen, borders))
    ranked = seen[order]
    rank = np.arange(ranked.size) - np.repeat(first, per_border)
    of_border = np.add.reduceat(ranked, first)
    best = [
        float((np.add.reduceat(np.where(rank < few, ranked, 0), first) / of_border).mean())
        for few in (1, 4)
    ]
    cell_borders, cells = split(np.arange(512, dtype=np.int32), 1)
    by_cell = np.zeros((256, 2), np.int64)
    np.add.at(by_cell, (cell_borders, cells), counts.patches)
    return {
        'windows': int(counts.squares.windows.sum()) + counts.dropped,
        'p_occupied': counts.p_occupied,
        'patches_seen': int((counts.patches > 0).sum()),
        'patches_for_99.9_percent': _needed(counts.patches),
        'patch_free': float(counts.patches[0] / counts.patches.sum()),
        'patch_occupied': float(counts.patches[511] / counts.patches.sum()),
        'squares_seen': int(squares.size),
        'squares_for_99.9_percent': _needed(seen),
        'square_free': float(shares.get(0, 0) / seen.sum()),
        'square_occupied': float(shares.get(2**25 - 1, 0) / seen.sum()),
        'borders_seen': int(first.size),
        'most_patches_per_border': int(per_border.max()),
        'likeliest_patch': best[0],
        'likeliest_four': best[1],
        'cell_borders_seen': int((by_cell.sum(axis=1) > 0).sum()),
        'cell_borders_undecided': int((by_cell > 0).all(axis=1).sum()),
    }


def _needed(seen: Int64Array) -> int:
    """How many of the most frequent patterns make up 99.9 % of the windows."""
    covered = np.cumsum(np.sort(seen)[::-1])
    return int(np.searchsorted(covered, COVERED * covered[-1]) + 1)
