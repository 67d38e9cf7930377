"""Patches as the numbers that `ogm_mcmc.sampling.patch_patterns` describes, and back."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, UInt8Array

__all__ = ['cells_of', 'pattern_of']


def pattern_of(cells: AnyArray) -> int:
    """Pattern of a square of cells (side, side), row 0 lowest y; anything but 0 is occupied."""
    return sum(1 << i for i, occupied in enumerate(np.asarray(cells).ravel().tolist()) if occupied)


def cells_of(pattern: int, side: int) -> UInt8Array:
    """Cells (side, side) of a pattern, row 0 lowest y: 0 free, 1 occupied."""
    bits = [(int(pattern) >> i) & 1 for i in range(side * side)]
    return np.array(bits, np.uint8).reshape(side, side)
