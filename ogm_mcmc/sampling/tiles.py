"""Maps that are sampled in tiles: each held by another process, with the rays that cross it.

These are large, a few of them to a building; the 8 x 8 cells of a ray index are something else.

Design note: what a tile depends on
-----------------------------------
Context. The index of a window of rays has to fit on the machine that samples it. A map can be
cut, but rays are long: what a ray says of a cell depends on every cell in front of it, and, if
that cell is free, on the first occupied one behind it.

Decision. A tile is a rectangle, and a ray crosses it in one piece. So, given all cells outside, a
ray says of the cells inside one of two things: nothing, if it is stopped before the tile; else
log p(z | its first hit inside), or, if nothing is hit there, one number: log p(z | its first hit
behind the tile, if any). This number (or nan) for each of its rays is all that a tile needs to
know of the others. With it in the place of log p(z | nothing is hit), the conditional of the tile
given everything else is that of a window of short rays, and the kernels that draw it are those of
whole windows. A tile holds the lines of its rays, cut in the same whole numbers, and the
likelihoods of cells inside; so every line is held as often as it crosses tiles, everything else
once.

Patches overlap the borders: a tile draws those whose lower left cell lies in its `core`, so cores
divide the patches among the tiles, and its `box` holds all of their cells and the ring around
them. Boxes overlap in that rim. A cell of a rim may be drawn by two tiles, one after the other.
For what lies outside of a box, first hits have to be known of pieces of the map that each lie in a
box as a whole or not at all: those that all boxes' edges cut it into. A tile answers a draw with
its cells and the hits of its visits, one for each pair of a ray and a piece.

Invariance. A sweep draws one tile after the other. Drawing tile T replaces its cells by a draw
that leaves p(m_T | all other cells, z) as it is, so it leaves p(m | z) as it is; so does any order
that the map has no say in. Tiles A and B may be drawn at the same time if, given all other cells,
they are independent: then p(m_A, m_B | rest, z) is the product of two factors, neither of which
knows of the other's cells, and it makes no difference whether B is drawn given the A of before or
of after. The likelihood is a product over rays, the prior one over patches and borders. So it is
enough that no ray crosses both boxes and that these do not overlap. Which tiles these are is
decided when rays are cut, before there is a map: tiles are coloured so that no two of a colour
share a ray, and a sweep takes one colour after the other, starting with a random one.

Consequence. `test_tiles` has the transition matrices of enumerated maps: of one tile, and of two
at once that share no ray, pi P = pi to rounding; of two at once that share a ray it is not. All
tiles of an open hall share rays, and take turns: then it takes as many chains as workers to keep
these busy, for chains have nothing to do with each other. What is exchanged, and what it costs, is
in docs/whole_drive.md.

Not done: tiles that share rays could be drawn at once where cells that stay fixed stop all of
these in between; for readings whose walls have been found that would be little more often than
now, as rays are followed no further than a few sigma behind a reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import CellBox, GridSpec

__all__ = ['MapTile', 'Tiling', 'colours', 'tiling_of']


class MapTile(NamedTuple):
    """Patches with their lower left cell in `core` are drawn; their borders lie in `box`, too.

    Single cells need no rim: both boxes, on the lattice, are the same then.
    """

    core: CellBox
    box: CellBox


class Tiling(NamedTuple):
    """A window (`spec`) cut into tiles, row by row; `columns`, `rows`: where cores begin.

    `column_cuts`, `row_cuts`: where pieces end that lie in each box as a whole or not at all.
    """

    spec: GridSpec
    tiles: tuple[MapTile, ...]
    columns: tuple[int, ...]
    rows: tuple[int, ...]
    column_cuts: tuple[int, ...]
    row_cuts: tuple[int, ...]

    def pieces(self, box: CellBox) -> tuple[AnyArray, AnyArray, int]:
        """Return the pieces of each column and row of a box, int32, and how many are in a row."""
        column = np.searchsorted(self.column_cuts, np.arange(box.column0, box.column1), 'right')
        row = np.searchsorted(self.row_cuts, np.arange(box.row0, box.row1), 'right')
        return column.astype(np.int32), row.astype(np.int32), len(self.column_cuts) + 1

    def tile_of(self, cells: AnyArray) -> AnyArray:
        """Return the number of the tile in whose core cells of the window lie."""
        row, column = np.divmod(cells, self.spec.width)
        across = np.searchsorted(self.columns, column + self.spec.column0, 'right') - 1
        up = np.searchsorted(self.rows, row + self.spec.row0, 'right') - 1
        tiles: AnyArray = up * len(self.columns) + across
        return tiles

    def in_box(self, tile: int, cells: AnyArray) -> AnyArray:
        """Return cells of the window as cells of a tile's box, int32."""
        box, spec = self.tiles[tile].box, self.spec
        row, column = np.divmod(cells, spec.width)
        width = box.column1 - box.column0
        inside = (row + (spec.row0 - box.row0)) * width + column + (spec.column0 - box.column0)
        mine: AnyArray = inside.astype(np.int32)
        return mine


def tiling_of(spec: GridSpec, columns: int, rows: int, side: int) -> Tiling:
    """Cut a window into so many tiles across and up, for patches of `side` cells; 0: single cells.

    Raises WindowError where a tile would be smaller than its rim.
    """
    box, left, right = spec.box, 1 if side else 0, side
    least = left + right + 1
    if spec.width < least * columns or spec.height < least * rows:
        raise WindowError(
            f'{columns}x{rows} tiles of {spec.width} x {spec.height} cells: expected at least '
            f'{least} x {least} cells in each'
        )
    across = [box.column0 + spec.width * i // columns for i in range(columns + 1)]
    up = [box.row0 + spec.height * i // rows for i in range(rows + 1)]
    tiles = []
    for row0, row1 in pairwise(up):
        for column0, column1 in pairwise(across):
            core = CellBox(column0, row0, column1, row1)
            grown = CellBox(column0 - left, row0 - left, column1 + right, row1 + right)
            tiles.append(MapTile(core, grown.intersection(box)))
    return Tiling(
        spec,
        tuple(tiles),
        tuple(across[:-1]),
        tuple(up[:-1]),
        _cuts(across, left, right),
        _cuts(up, left, right),
    )


def _cuts(begins: list[int], left: int, right: int) -> tuple[int, ...]:
    return tuple(sorted({cut for at in begins[1:-1] for cut in (at - left, at + right)}))


def colours(tiles: Sequence[MapTile], sharing: BoolArray) -> list[list[int]]:
    """Return tiles in groups of which all may be drawn at the same time.

    sharing  (T, T): whether a ray crosses both
    """
    groups: list[list[int]] = []
    for this, tile in enumerate(tiles):
        for group in groups:
            apart = all(tile.box.intersection(tiles[other].box).empty for other in group)
            if apart and not sharing[this, group].any():
                group.append(this)
                break
        else:
            groups.append([this])
    return groups
