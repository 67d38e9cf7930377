"""Small square patches of cells as whole numbers, their borders, and their eight symmetries.

Bit order. Bit i of a pattern of `side` x `side` cells is the cell at row i // side, column
i % side; row 0 has the lowest y, 1 is occupied. The border of a patch is the ring of cells
around it: bit j of a border is the j-th cell of the ring, row-major over the larger square that
holds both, `ring_cells`. For the 16 cells around a 3 x 3 patch (bits of the border):

    11 12 13 14 15      top row, highest y
     9  .  .  . 10
     7  .  .  .  8
     5  .  .  .  6
     0  1  2  3  4      row 0, lowest y
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, Int32Array

__all__ = [
    'SYMMETRIES',
    'canonical',
    'images',
    'join',
    'ring_cells',
    'split',
    'symmetry_permutations',
]

SYMMETRIES = 8
"""Four quarter turns, each with and without a reflection."""


def ring_cells(side: int) -> Int32Array:
    """Row and column of each border cell of a patch, in bit order (4 * side + 4, 2).

    Relative to the lower left cell of the patch: -1 to `side`.
    """
    reach = range(-1, side + 1)
    ring = [
        (row, column)
        for row in reach
        for column in reach
        if row in (-1, side) or column in (-1, side)
    ]
    return np.array(ring, np.int32)


def _places(side: int) -> tuple[AnyArray, AnyArray]:
    """Bits of the larger square (side + 2) that hold the border, and those that hold the patch."""
    larger = side + 2
    ring = (ring_cells(side) + 1) @ (larger, 1)
    return ring, np.setdiff1d(np.arange(larger * larger), ring)


def _gather(patterns: AnyArray, places: AnyArray) -> Int32Array:
    """Patterns whose bit i is bit `places[i]` of the given ones."""
    gathered = np.zeros(np.shape(patterns), np.int32)
    for i, place in enumerate(places.tolist()):
        gathered |= ((patterns >> np.int32(place)) & np.int32(1)) << np.int32(i)
    return gathered


def split(patterns: AnyArray, side: int) -> tuple[Int32Array, Int32Array]:
    """Border and patch (n,) of patterns of side + 2, for patches of `side`."""
    ring, inner = _places(side)
    wide = np.asarray(patterns, np.int32)
    return _gather(wide, ring), _gather(wide, inner)


def join(borders: AnyArray, patches: AnyArray, side: int) -> Int32Array:
    """Pattern of side + 2 for each border and patch of `side`; the inverse of `split`."""
    ring, inner = _places(side)
    whole = np.zeros(np.broadcast(borders, patches).shape, np.int32)
    for parts, places in ((borders, ring), (patches, inner)):
        for i, place in enumerate(places.tolist()):
            whole |= ((np.asarray(parts, np.int32) >> np.int32(i)) & 1) << np.int32(place)
    return whole


def symmetry_permutations(side: int) -> Int32Array:
    """Where each cell of an image comes from (8, side * side): image bit i is bit [s, i]."""
    square = np.arange(side * side, dtype=np.int32).reshape(side, side)
    turned = [np.rot90(square, turns) for turns in range(4)]
    return np.array([image.ravel() for turn in turned for image in (turn, turn[:, ::-1])])


def images(patterns: AnyArray, side: int) -> Int32Array:
    """All eight images of patterns (8, n); an image may be there more than once."""
    wide = np.asarray(patterns, np.int32)
    return np.array([_gather(wide, places) for places in symmetry_permutations(side)])


def canonical(patterns: AnyArray, side: int) -> Int32Array:
    """The smallest image of each pattern (n,): one name for all patterns that are alike."""
    smallest: Int32Array = images(patterns, side).min(axis=0)
    return smallest
