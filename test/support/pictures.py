"""Small grids as ASCII pictures, to write expected results literally.

The top line is the highest y, as on paper. `#` hit, `.` free, space or `?` unknown:

    read('''
        ..#
        .??
    ''')

An array has row 0 at the bottom, as every grid of this package.
"""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import dedent

import numpy as np

from ogm_mcmc.arrays import AnyArray, Int8Array

__all__ = ['FREE', 'HIT', 'UNKNOWN', 'cells_of', 'draw', 'draw_cells', 'read']

HIT, FREE, UNKNOWN = 1, 0, -1
SYMBOLS = {'#': HIT, '.': FREE, '?': UNKNOWN, ' ': UNKNOWN}


def read(picture: str) -> Int8Array:
    """Array (height, width) of a picture: 1 hit, 0 free, -1 unknown.

    Lines shorter than the longest end in unknown cells; a blank first or last line is dropped.
    """
    lines = dedent(picture).split('\n')
    if not lines[0].strip():
        lines = lines[1:]
    if not lines[-1].strip():
        lines = lines[:-1]
    width = max(len(line) for line in lines)
    rows = [[SYMBOLS[symbol] for symbol in line.ljust(width)] for line in reversed(lines)]
    return np.array(rows, np.int8)


def draw(values: AnyArray) -> str:
    """Picture of an array of log-odds or of -1, 0, 1: above 0 hit, nan or -1 unknown, else free.

    Values below 0 are free, except that an integer -1 is unknown.
    """
    unknown = np.isnan(values) if values.dtype.kind == 'f' else values == UNKNOWN
    symbols = np.where(unknown, '?', np.where(values > 0, '#', '.'))
    return '\n'.join(''.join(row) for row in symbols[::-1])


def cells_of(picture: str, symbols: str = '#.') -> set[tuple[int, int]]:
    """Cells (column, row) of a picture that show one of the symbols."""
    wanted = [SYMBOLS[symbol] for symbol in symbols]
    rows, columns = np.nonzero(np.isin(read(picture), wanted))
    return set(zip(columns.tolist(), rows.tolist(), strict=True))


def draw_cells(cells: Iterable[tuple[int, int]], width: int, height: int) -> str:
    """Picture of a grid where the given cells (column, row) are free and all else unknown."""
    values = np.full((height, width), UNKNOWN, np.int8)
    for column, row in cells:
        values[row, column] = FREE
    return draw(values)
