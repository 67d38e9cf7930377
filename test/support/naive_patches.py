"""Slow, obvious twins of patch counting and patch tables, written from the definitions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache

import numpy as np

from ogm_mcmc.arrays import Int8Array

__all__ = [
    'Square',
    'count_squares',
    'eight_images',
    'number_of',
    'pooled',
    'ring_and_inside',
    'smoothed',
]

Square = tuple[tuple[int, ...], ...]
"""Rows of a square of cells, lowest y first: 0 free, 1 occupied."""


def eight_images(square: Square) -> list[Square]:
    """Four quarter turns, each as it is and mirrored."""
    turned = []
    for _ in range(4):
        square = tuple(zip(*square[::-1], strict=True))
        turned += [square, tuple(row[::-1] for row in square)]
    return turned


def number_of(square: Square) -> int:
    """Bit i is the cell at row i // side, column i % side."""
    flat = [cell for row in square for cell in row]
    return sum(2**i for i, cell in enumerate(flat) if cell)


def _windows(states: Int8Array, side: int, unknown: str, margin: int | None) -> Iterator[Square]:
    height, width = states.shape
    for row in range(height - side + 1):
        for column in range(width - side + 1):
            window = states[row : row + side, column : column + side]
            if unknown == 'skip' and (window == -1).any():
                continue
            if unknown == 'occupied' and margin is not None:
                middle_row, middle_column = row + side // 2, column + side // 2
                around = [
                    states[r, c]
                    for r in range(middle_row - margin, middle_row + margin + 1)
                    for c in range(middle_column - margin, middle_column + margin + 1)
                    if 0 <= r < height and 0 <= c < width
                ]
                if all(state == -1 for state in around):
                    continue
            yield tuple(tuple(int(state != 0) for state in line) for line in window)


def count_squares(
    states: Int8Array, side: int, unknown: str = 'occupied', margin: int | None = None
) -> Counter[int]:
    """How often each pattern is seen in a map, each window in all eight images."""
    return Counter(
        number_of(image)
        for window in _windows(states, side, unknown, margin)
        for image in eight_images(window)
    )


def pooled(states: Int8Array, step: Fraction) -> Int8Array:
    """Each cell of the map speaks for the `step` times larger cell that holds its centre."""
    held: dict[tuple[int, int], list[int]] = {}
    for (row, column), state in np.ndenumerate(states):
        key = tuple(math.floor((Fraction(i) + Fraction(1, 2)) / step) for i in (row, column))
        held.setdefault((key[0], key[1]), []).append(int(state))
    height, width = (max(key[axis] for key in held) + 1 for axis in (0, 1))
    result = np.empty((height, width), np.int8)
    for key, inside in held.items():
        result[key] = 1 if 1 in inside else 0 if 0 in inside else -1
    return result


@lru_cache(maxsize=100_000)
def ring_and_inside(number: int, side: int) -> tuple[tuple[int, ...], int]:
    """Border cells of a pattern of side + 2, row by row, and the number of what is inside."""
    wide = side + 2
    bits = [number >> i & 1 for i in range(wide * wide)]
    edge = [
        i for i in range(wide * wide) if i // wide in (0, wide - 1) or i % wide in (0, wide - 1)
    ]
    inner = [bits[i] for i in range(wide * wide) if i not in edge]
    return tuple(bits[i] for i in edge), sum(2**i for i, bit in enumerate(inner) if bit)


def smoothed(
    wide: Counter[int],
    small: Counter[int],
    side: int,
    border: tuple[int, ...],
    *,
    weight: float,
    min_windows: int,
) -> list[float]:
    """p(patch | border) for every patch, from counts of patterns of side + 2 and of side.

    Which border cells are looked at: none, the middle of each side, all but the corners, all.
    """
    n_patches = 2 ** (side * side)
    total = sum(small.values())
    p = [(small[patch] + 1) / (total + n_patches) for patch in range(n_patches)]
    last = side + 1
    places = [(r, c) for r in range(side + 2) for c in range(side + 2) if {r, c} & {0, last}]
    middle = (side + 1) // 2
    looks = [
        [i for i, place in enumerate(places) if middle in place],
        [i for i, place in enumerate(places) if set(place) - {0, last}],
        list(range(len(places))),
    ]
    if side == 1:
        looks = looks[1:]  # the only cell of a side is its middle
    for look in looks:
        seen: Counter[int] = Counter()
        for number, count in wide.items():
            ring, inside = ring_and_inside(number, side)
            if all(ring[i] == border[i] for i in look):
                seen[inside] += count
        n_windows = sum(seen.values())
        if n_windows >= min_windows:
            extra = weight * len(seen)
            p = [(seen[i] + extra * p[i]) / (n_windows + extra) for i in range(n_patches)]
    return p
