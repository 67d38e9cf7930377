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

Design note: cells in doubt
---------------------------
Context. Intel, 5 cm, 910 scans, processor time of one chain on a busy machine, after 114 sweeps. A
full sweep takes 121 ms: 22 800 patches, 75 ms for cells one by one (of 192 000 the prior and what
rays can add at most decide 79 000 without a look; the others read 2.1 million near pairs, 35 to 60
ns each, half of which stop in front of the cell), the rest for whole patches. A sweep where doubt
is took 51 ms: 2 900 patches with doubt, 26 000 cells, of which 7 000 are in doubt, 42 ms; 3 700 of
the others, 9 to 17. Nearly all of the 22 000 flips of a full sweep are of cells behind surfaces.

Decision. Patches with doubt are drawn in every sweep, all nine cells, the others in one of
`DULL_TURNS`, as before. The burn-in looks where doubt is from its ninth sweep on; where that is it
decides, once and for all, before a sweep counts (`PosteriorSampler`). Of cells that move, and
those beside one, an early exit saves nothing, so in patches with doubt their log-odds are summed
up in full, and the probability is counted in place of what was drawn with it (Rao-Blackwell: the
same mean, less variance), in parts of 1/64, rounded up or down at random so that the mean is
right. What is drawn is what it was; each cell is drawn by itself once in a sweep, so that holds
whether or not the conditionals of patches agree on one joint distribution.

R-hat and effective samples are computed as before, from these counts: the variance between means
of chains is that of the estimates there are, that within a chain that of a cell that is occupied
with their mean, p (1 - p). Effective samples are what independent draws would have the variance of
the estimate, and still count no more than the draws: it is a bound that half of the cells reach.

Consequence. Intel, 64 counted sweeps from the same starts, both chains, processor time with ten
programs on two cores, informed cells that agree; effective samples are the median:

==============================================  =======  ==========  ======  ====
                                                burn-in  64 sweeps   agree   ess
==============================================  =======  ==========  ======  ====
before, burn-in 50                              13 s     9 s         .9930   60
only moving cells, burn-in 24, draws counted    4.9      5.3         .9887   33
the same and all nine cells                     5.4      7.6         .9908   50
moving cells, probabilities counted             --       6.6         .9913   55
**and those beside these**                      5.4      7.7         .9952   112
and patches with cells beside these             5.7      9.4         .9956   121
==============================================  =======  ==========  ======  ====

The table is of before: where only moving cells, or those beside, were drawn the others of all
patches came in one of eight turns. That is no more: its gain is bought with pockets behind walls
that dissolve slowly. In a thin-walled room (100 sweeps, 22 seeds) 4 maps showed cells beyond the
wall with 1/8, none where all cells of patches with doubt are drawn and none before.

Of before as well, with 1/8 and a focus that followed the counts: `bench refine` had 108 effective
samples and .9949 after 62 counted sweeps; in the same 64 sweeps probabilities had 1.6 times the
effective samples of draws (96, 57). Figures of today: docs/results.md, "Refine".
Tried without gain: patches drawn whole in a tenth of the turns (7.3 s, ess 106, and a burn-in that
ends 300 nats lower); settled ones in one of 16 turns (6.5 s, ess 96, .9944); patches in square
blocks of 8 to 64 cells in place of rows (the same time; in random order 1.4 times). Not done:
places of first hits as 16 bits, apart from likelihoods, which would fit the second cache: 320 KB
in place of 1.3 MB.

Tried later, Intel, from one state after 50 sweeps, 128 sweeps of both chains that count, on a busy
machine: single cells that flip with min(1, odds of the other state) in place of their conditional
(Liu 1996): twice the flips, as many effective samples (209, 205); patches in doubt drawn whole in
.6 of the turns: 228 instead of 205, in 1.25 times the time. It is not the single cell that mixes
slowly. Without gain in time, with the same draws, bit for bit: a loop of its own for near pairs
(0 to 10 %), the next list begun where the last search ended (0), rays numbered by where they end,
so that those of a patch lie together (0 to 10 %, and 2 to 6 bytes a ray). What lies behind rays
that end in the cell took 10 of the 25 ms of single cells: now kept, see `gibbs_kernels`.

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
