"""Where patches lie in a window, and how often each is drawn.

Design note: only what data can inform is sampled
-------------------------------------------------
Context. Of the cells of a window more than half are never crossed by a ray. Under a learned prior
they form solid or empty blocks that no single patch can turn over: chains from different starts
never agree about them, and they took more than half of the patches of a sweep.

Decision. Cells are sampled within a margin of those that a ray tells something of, in patches
that lie inside of that band. All others are one fixed map: solid. That is what unknown cells
count as where the prior is learned (`LearningConfig.unknown`), so it is the prior's own state of
space without data, and it is no start: the posterior is that given this surrounding.

Far in front of all readings (`gain` 0) a patch is free but for one draw in thousands. Patches of
such cells alone are drawn in one of eight sweeps, chosen at random: fixed probabilities of being
drawn leave the posterior as it is.

Most patches at surfaces are settled: no draw changes them any more, and yet every draw looks at
all their rays. `focused` keeps those in every sweep that hold a cell in doubt, and puts the others
among the dull ones (see `PosteriorSampler` for who says so and when).

Consequence. Intel, 5 cm: 295 000 of 587 000 cells are sampled, 23 000 instead of 65 000 patches a
sweep. With free surroundings instead, held-out beams are 0.011 nats less likely (odd beams of
910 scans), and of a sparsely seen hospital the area under the ROC curve is 0.88 instead of 0.95
(chains that start free; with dispersed starts 0.91 instead of 0.93). One run of each.

Design note: gaps between few beams
-----------------------------------
Context. Where beams are few the likelihood of others that were not mapped depends on the run and
on how long it is, long after informed cells agree. Means after burn-ins of 50 and of 150 sweeps,
96 counted (a hospital seen by 18 beams a scan): of 212 870 informed cells 88 moved by more than
.3, of 308 813 that no ray crosses 26 109, four of five of them up. Walls close between readings
and fill behind them, from seeds at the readings, slowly; each chain has a history of its own.

Tried. Four more rounds in every sweep over the patches that no ray crosses, all drawn whole (or
none), 50 sweeps of burn-in, 96 counted, one run each, nats a beam and F1 at 0.5. In rows with --
64 counted, and rounds only over patches with cells of both kinds in them or around:

=====================================  ==========================  =============
map                                    as it is                    four more
=====================================  ==========================  =============
Intel, every tenth scan                .575, .689                  .510, .611
-- none drawn whole                                                .512, .607
-- all whole, `strength` 1                                         .496, .604
hospital                               .975, .960                  1.070, .964
-- all whole, `strength` 1                                         .778, .967
sparse warehouse                       -1.261, .830                -1.334, .825
-- all whole, `strength` 1                                         -2.022, .800
=====================================  ==========================  =============

After 136 sweeps 52 000 cells are solid in place of 29 000 (Intel), 73 000 in place of 43 000
(hospital), nearly as many as there will be; much the same drawn one by one, or with the other
strength. So chains are slow to leave a state that is better, in two maps of three, than where the
prior takes them.

Decision. No longer burn-in, no moves for blocks: they would be faster at what is worse. A prior
that does not fill what nobody saw would come first. What differs from run to run is the history of
two chains; means of more differ less, and are the default there (docs/results.md, "Start").
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, BoolArray, UInt8Array
from ogm_mcmc.sampling.informed import arrival, near
from ogm_mcmc.sampling.ray_index import RayIndex

__all__ = [
    'DULL_TURNS',
    'PatchPlaces',
    'focused',
    'parts_of_turn',
    'patch_places',
    'places_among',
    'told_cells',
    'turn',
]

DULL_TURNS = 8


class PatchPlaces(NamedTuple):
    """Lower left cells of patches, int32.

    `touched` (C,): the cells that are in a patch, in rising order; `corners` (P,): all patches.
    `active`, `dull`: by offset of the tiling, row by row, patches side by side of which every one
    is drawn in a sweep, and those of which one in `DULL_TURNS` is. `doubted` (K,) uint8: cells
    whose probabilities are counted when an active patch is drawn; None: of none.
    """

    touched: AnyArray
    corners: AnyArray
    active: Sequence[AnyArray]
    dull: Sequence[AnyArray]
    doubted: UInt8Array | None = None


class _Tilings(Sequence[AnyArray]):
    """By offset, the corners of the chosen patches; each found when it is asked for."""

    def __init__(self, corners: AnyArray, chosen: BoolArray, side: int) -> None:
        self._corners, self._chosen, self._side = corners, chosen, side
        self._found: dict[int, AnyArray] = {}

    def __len__(self) -> int:
        return self._side**2

    def __getitem__(self, offset: Any) -> Any:
        if offset not in range(len(self)):
            raise IndexError(offset)
        found = self._found.get(offset)
        if found is None:
            row, column = divmod(offset, self._side)
            place = slice(row, None, self._side), slice(column, None, self._side)
            found = self._found[offset] = self._corners[place][self._chosen[place]]
        return found


def told_cells(index: RayIndex, telling: AnyArray, rays: AnyArray) -> BoolArray:
    """Return which cells (K,) the `rays` with these numbers tell of; `telling`: of all rays."""
    nothing = np.zeros(index.n_cells, np.float32)
    some = index._replace(rays=index.rays[rays])
    told: BoolArray = arrival(some, telling[rays], nothing) > 0.0
    return told


def patch_places(
    index: RayIndex, told: BoolArray, width: int, side: int, margin: int | None
) -> PatchPlaces:
    """Return all patches whose border lies in the window too.

    With a `margin`, cells, only those that lie within it of cells (K,) that are `told` of; of
    these the patches far in front of all readings are drawn more seldom.
    """
    shape = index.n_cells // width, width
    if margin is None:
        everything = np.ones(shape, np.bool_)
        return places_among(everything, ~everything, side)
    level = index.is_touched()
    level[index.listed()[index.gain > 0.0]] = False
    return places_among(near(told.reshape(shape), margin), level.reshape(shape), side)


def places_among(wanted: BoolArray, level: BoolArray, side: int) -> PatchPlaces:
    """Return the patches that lie in the cells (height, width) that are `wanted` as a whole.

    Those in which all cells are `level`, far in front of all readings, are drawn more seldom.
    """
    height, width = wanted.shape
    cells = np.arange(wanted.size, dtype=np.int32).reshape(height, width)
    corners = cells[1:-side, 1:-side]
    inside, dull = _whole(wanted, side), _whole(level, side)
    sampled = np.zeros((height, width), np.bool_)
    for row in range(1, side + 1):
        for column in range(1, side + 1):
            sampled[row : row + len(corners), column : column + corners.shape[1]] |= inside
    return PatchPlaces(
        np.flatnonzero(sampled).astype(np.int32),
        corners[inside],
        _Tilings(corners, inside & ~dull, side),
        _Tilings(corners, inside & dull, side),
    )


def focused(places: PatchPlaces, in_doubt: BoolArray, side: int) -> PatchPlaces:
    """Return places of which all patches without a cell that is `in_doubt` are dull.

    in_doubt  (height, width), of all cells of the window
    """
    some = np.zeros(in_doubt.size, np.bool_)
    corners = np.arange(in_doubt.size).reshape(in_doubt.shape)[1:-side, 1:-side]
    some[corners] = ~_whole(~in_doubt, side)
    active = [tiles[some[tiles]] for tiles in places.active]
    dull = [
        np.concatenate((tiles[~some[tiles]], before))
        for tiles, before in zip(places.active, places.dull, strict=True)
    ]
    return places._replace(active=active, dull=dull)


def turn(rng: Generator, places: PatchPlaces) -> AnyArray:
    """Return the patches (P,) int32 of one sweep, in turn: whatever the map is, these chances."""
    active, dull = parts_of_turn(rng, places)
    return np.concatenate((active, dull)) if dull.size else active


def parts_of_turn(rng: Generator, places: PatchPlaces) -> tuple[AnyArray, AnyArray]:
    """Return those of `turn` that are active, and the dull ones that come after them."""
    offset = int(rng.integers(0, len(places.active)))
    active, dull = places.active[offset], places.dull[offset]
    return active, dull[rng.integers(0, DULL_TURNS) :: DULL_TURNS] if dull.size else dull


def _whole(cells: BoolArray, side: int) -> BoolArray:
    """Which patches, by their lower left cell inside of the rim, have all their cells."""
    height, width = cells.shape[0] - side - 1, cells.shape[1] - side - 1
    whole = np.ones((height, width), np.bool_)
    for row in range(1, side + 1):
        for column in range(1, side + 1):
            whole &= cells[row : row + height, column : column + width]
    return whole
