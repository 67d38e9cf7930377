"""Gibbs sampling of patches of cells, with a prior learned from maps ([patch] Algorithm 1).

Where patches lie, how often each is drawn and of which cells probabilities are counted is in
`patch_places`, how long a burn-in is in `burn_in`.

Design note: sampling with a table that lists a few patterns
------------------------------------------------------------
Context. Given its border, a patch has one or a few probable patterns; the table gives all others
one small probability each, the floor. Looking at all 512 at every draw would cost more than
everything else; leaving them out would make them impossible, and [patch] gets around that with
patches set at random (p_randPatch), which does not leave the posterior invariant.

Decision. A draw comes from the listed patterns alone, if the present one is among them, and
leaves the patch as it is otherwise: that is Gibbs sampling of a block, given that it is (or is
not) in the list. A share `escape` of these draws looks at one pattern more: with r drawn evenly
from the M unlisted ones while the present pattern is listed, and r the present pattern while it
is not, (pattern, r) has the joint distribution in which, given r, a listed pattern x weighs
p(x | border) p(z | x) and r weighs M p(r | border) p(z | r). Drawing from these is exact, and
reaches everything. `escape` is at least 0.1 during burn-in, so that a bad start is left soon (with
1 every draw would look at its rays: 20 times as long on Intel).
A patch with one candidate touches no ray in all other draws.

Consequence. For priors that are one joint distribution (uniform) the posterior is invariant;
tests show it for the whole transition matrix of a draw. With p_randPatch the stationary
distribution of three cells is 0.0010, 0.010 and 0.091 in total variation from the posterior at
rates of 0.001, 0.01 and 0.1. Conditionals of overlapping patches that were counted one by one
(border, patch) need not agree on one joint distribution; there the result is that of the
procedure. How far they are from one: of two patches one cell apart, drawn in turn without any ray,
the joint distributions that the two orders end in differ by 0.007 in total variation inside of a
free rim, and by 0.20 between the ends of a wall (shipped prior), but no cell by more than 0.015
(`test_how_far_conditionals_are_from_one_joint`).

Design note: cell by cell
-------------------------
Context. Readings ask for patterns that no training map shows: a chair leg, a person, a wall that
the pose error smears. Of the patches near surfaces of Intel (5 cm) 31 % are in a pattern that is
not listed, and stay there, were they drawn as a whole only, until `escape` finds one pattern out
of 500 in two of a hundred draws.

Decision. With `flip_cells` each cell of a patch is drawn by itself, too, in turn from a random
one on, given the other eight and the border, listed or not: blocks of the same conditional, so the
posterior stays as it is. An early exit (see `ogm_mcmc.sampling`) leaves most of them without a
look at a ray. And most patches at surfaces are settled: sweeps that count look most at those with
a cell in doubt (`PosteriorSampler`), which makes room for it.

Consequence. Intel, 5 cm, 910 scans, two chains, processor time of both after about 30 s (a busy
machine, the same for all), of which the burn-in took 11 to 19; in one run each:

=============================================  ======  =========  =================
sweeps that look at everything, one cell each  107     ess 33     98.5 % agree
where doubt is, one cell each                  170     48         98.8 %
where doubt is, three cells each               220     73         99.3 %
**where doubt is, all nine**                   160     99         99.6 %
=============================================  ======  =========  =================

It is the cells that mix, and the patch that costs: all rays of nine cells. So a patch is drawn as
a whole in a quarter of its turns, `WHOLE_SHARE`, chosen at random, and cell by cell in all. Intel,
5 cm, every third scan, two chains, 50 sweeps of burn-in and 64 that count, processor time of both
(a busy machine, one run each; the first burn-in includes 9 s of compiling):

================  ==========  =============  ==========================  ==============
share (burn-in)   burn-in, s  64 sweeps, s   effective samples a second  agree
================  ==========  =============  ==========================  ==============
1 (1)             18.8        7.5            8.8                         99.2 %
**1/4 (1/4)**     6.2         4.9            12.8                        99.0 %
1/10 (1)          9.0         4.8            12.9                        99.0 %
================  ==========  =============  ==========================  ==============

It can cost, too: seven cells that four beams hold together, a prior of independent cells, 20 000
sweeps: the least of them has 475 effective samples, and 1545 with a share of 1.

Where sweeps look most where doubt is, those that count draw a patch as a whole in 1/16 of its
turns. Intel, from one state, 128 sweeps of both chains, processor time, busy: 16.2 s with 1/4
(effective samples 13, 68, 172 at 5 %, 25 %, the median, .9957 agree), 12.2 s with 1/10 (12, 63,
157, .9954), 10.2 s with 1/20 (11, 63, 159, .9955).

Conditionals of patches need not agree, so the share might change what maps are drawn: it does not.
Means of 128 sweeps of two runs with 1/4, two with 1/16, 7250 cells: differences of .078 and .077
(rms) within, .074 to .083 between the shares; |z| above 3 in .34 and .43, .29 to .50 %.

Design note: what a sweep costs
-------------------------------
Intel, experiment 1 of [patch], cells of 2 cm: 248 502 patches a sweep. Of them 80 % have one
candidate. Looking all borders up takes 3 ms; nearly all the time goes to the other 50 000 patches
with 10 candidates on average, 1.4 million pairs of ray and cell, half a million of them reached.
Tried on one state of the chain after 60 sweeps (processor time, ms, best of seven, on a machine
busy with other things; first patches with several candidates, then those with one, of which
`escape` looks at one in fifty):

====================================================================================  ==  ==
every ray followed through the patch by its steps; a score per option and ray         62  25
-- options as bits, those without a hit cost nothing; memory made once; inlined       63  26
**rays merged from the cells of the patch, likelihoods as they lie there**            63  16
pairs that are reached sorted by ray, others left out first                           66  19
====================================================================================  ==  ==

The work is in getting at the rays, not in the scores: scores of 10 options are a quarter of it,
what is behind a hit another, and a table with fewer candidates pays by fewer patches to look at.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, BoolArray, UInt8Array
from ogm_mcmc.errors import GridError, WindowError, require
from ogm_mcmc.sampling.cell_gibbs import GibbsState, IndexedModel
from ogm_mcmc.sampling.first_hits import HitsBefore, first_hits
from ogm_mcmc.sampling.informed import near
from ogm_mcmc.sampling.patch_gibbs_kernels import sweep_patches
from ogm_mcmc.sampling.patch_patterns import ring_cells
from ogm_mcmc.sampling.patch_places import (
    PatchPlaces,
    focused,
    parts_of_turn,
    patch_places,
    told_cells,
    turn,
)
from ogm_mcmc.sampling.patch_prior import PatchTable
from ogm_mcmc.sampling.ray_index import RayIndex

__all__ = ['PATCH_ORDERS', 'PatchModel']

SETTLING_ESCAPE = 0.1

SURROUNDING = 1
"""What cells are that are not sampled: solid; see `patch_places`."""

WHOLE_SHARE = 0.25
"""Share of patches that are drawn as a whole where cells are drawn by themselves, too."""

SETTLED_WHOLE_SHARE = 1.0 / 16.0
"""The same in sweeps that count and look most where doubt is."""

FEW_RAYS = 2_000
"""Of so many rays or more walls are where readings are from the first sweep on."""

PATCH_ORDERS = ('tiled', 'random')


class PatchModel(IndexedModel):
    """A window of rays and a prior over patches; the cells at its rim stay as they start.

    One sweep draws K / L patches: `tiled`, side by side from a random offset, so that every cell
    comes once; `random`, anywhere, as [patch] has it. With a `margin` only cells within it of what
    a ray tells of are sampled, the others are solid (see `ogm_mcmc.sampling.patch_places`).
    `known`: the cells (K,) that the first rays tell of, and of how many places each of them does.
    """

    def __init__(
        self,
        index: RayIndex,
        width: int,
        table: PatchTable,
        *,
        order: str = 'tiled',
        escape: float = 0.02,
        random_share: float = 0.0,
        margin: int | None = None,
        flip_cells: bool = False,
        known: tuple[BoolArray, AnyArray] | None = None,
    ) -> None:
        require(order in PATCH_ORDERS, 'order', order, f'one of {", ".join(PATCH_ORDERS)}')
        self.index, self.width, self.table = index, width, table
        self.order, self.escape, self.random_share = order, escape, random_share
        self.flip_cells = flip_cells
        self.whole_share = WHOLE_SHARE if flip_cells else 1.0
        self.height = index.n_cells // width
        side = table.side
        if min(self.height, width) < side + 2:
            raise WindowError(
                f'window of {width} x {self.height} cells: expected at least {side + 2} x '
                f'{side + 2} for patches of {side} x {side} and their border'
            )
        # A window that grows looks at the rays that are new or tell more, only.
        told, telling = known or (np.zeros(index.n_cells, np.bool_), np.empty(0, np.int32))
        self.telling = index.telling.copy()  # that of the index may change
        self.told = told
        if margin is not None:
            more = self.telling > 0
            more[: telling.size] = self.telling[: telling.size] > telling
            self.told = told | told_cells(index, self.telling, np.flatnonzero(more))
        self._places = patch_places(index, self.told, width, side, margin)
        self.touched = self._places.touched
        if self.touched.size == 0:
            raise WindowError(
                f'no patch of {side} x {side} cells within {margin} cells of what a beam tells '
                'of: expected a larger margin'
            )
        self._surrounded = margin is not None
        self._no_doubt, self._unread = np.zeros((2, index.n_cells), np.uint8)
        places = np.indices((side, side)).reshape(2, -1)
        self._inner = (places[0] * width + places[1]).astype(np.int64)
        ring = ring_cells(side).astype(np.int64)
        self._ring = ring[:, 0] * width + ring[:, 1]

    def to_power(self, power: float) -> PatchModel:
        """Return the model with the likelihood, not the prior, raised to a power."""
        model = copy(self)
        model.index = self.index.to_power(power)
        return model

    @property
    def begins_cold(self) -> bool:
        """Whether a burn-in begins with likelihoods to a power above 1, see `burn_in.POWERS`."""
        return self._surrounded and self.index.n_rays < FEW_RAYS

    def found(self) -> tuple[BoolArray, AnyArray] | None:
        """Return which cells (K,) rays tell of, and `telling` (N,): `known` of the next model."""
        return self.told, self.telling

    def start(self, cells: UInt8Array, before: HitsBefore | None = None) -> GibbsState:
        """Return the state of a map (K,), what rays hit kept from `before`.

        Raises GridError when it is of another size.
        """
        if cells.shape != (self.n_cells,):
            raise GridError(
                f'start map of {cells.size} cells: expected the {self.n_cells} of the window'
            )
        mine = (cells != 0).astype(np.uint8)
        if self._surrounded:
            mine[:] = SURROUNDING
            mine[self.touched] = cells[self.touched] != 0
        return GibbsState(mine, first_hits(mine, self.index, before))

    def advance(
        self,
        rng: Generator,
        state: GibbsState,
        *,
        settling: bool = False,
        focus: PatchPlaces | None = None,
        chances: UInt8Array | None = None,
        power: float = 1.0,
    ) -> int:
        """Draw K / L patches in place; return the number of flipped cells.

        `power`: of the likelihood, in sweeps that do not count.
        """
        if power == 1.0:
            return self._sweep(rng, state, settling, focus, chances)
        sharp = self.to_power(power)
        drawn = sharp.start(state.cells)
        flips = sharp._sweep(rng, drawn, settling, focus, chances)
        state.cells[:] = drawn.cells
        state.records[:] = first_hits(drawn.cells, self.index)
        return flips

    def _sweep(
        self,
        rng: Generator,
        state: GibbsState,
        settling: bool,
        focus: PatchPlaces | None,
        chances: UInt8Array | None,
    ) -> int:
        escape = self._escape(settling)
        if focus is None:
            return self.draw_patches(rng, self.order_of_sweep(rng), state, escape)
        seldom = self.flip_cells and not settling
        whole = SETTLED_WHOLE_SHARE if seldom else None
        active, dull = parts_of_turn(rng, focus)
        flips = self.draw_patches(rng, active, state, escape, focus.doubted, chances, whole)
        if dull.size:
            flips += self.draw_patches(rng, dull, state, escape, whole_share=whole)
        return flips

    def focus(self, in_doubt: BoolArray, moving: BoolArray) -> PatchPlaces | None:
        """Return where sweeps go that seldom come by patches without such a cell (K,).

        Of cells that are `moving` (K,), and those beside, probabilities are told in the others.
        """
        if self.order == 'random' or not self._surrounded:
            return None
        shape = self.height, self.width
        places = focused(self._places, in_doubt.reshape(shape), self.table.side)
        doubted = near(moving.reshape(shape), 1).reshape(-1).view(np.uint8)
        return places._replace(doubted=doubted)

    def draw_patches(
        self,
        rng: Generator,
        corners: AnyArray,
        state: GibbsState,
        escape: float,
        doubted: UInt8Array | None = None,
        chances: UInt8Array | None = None,
        whole_share: float | None = None,
    ) -> int:
        """Draw the patches with these lower left cells (P,) int32 in turn, in place.

        `chances` (K,), of cells that are `doubted` (K,), are filled with what these are drawn
        with by themselves, in `PARTS`. `whole_share`: `self.whole_share`, or another.
        """
        index, table = self.index, self.table
        return int(
            sweep_patches(
                rng,
                np.ascontiguousarray(corners),  # a turn may be a stride: one kernel for both
                table.side,
                self._inner,
                self._ring,
                escape,
                self.random_share,
                table.side**2 if self.flip_cells else 0,
                self.whole_share if whole_share is None else whole_share,
                self._no_doubt if doubted is None else doubted,
                self._unread if chances is None else chances,
                table.entry_of_border,
                table.start,
                table.candidates,
                table.log_probability,
                table.floor,
                state.cells,
                state.records,
                state.records.view(np.float32),
                *index.arrays(),
            )
        )

    def _escape(self, settling: bool) -> float:
        if self.random_share > 0.0:
            return 0.0
        return max(self.escape, SETTLING_ESCAPE) if settling else self.escape

    def order_of_sweep(self, rng: Generator) -> AnyArray:
        """Return the lower left cells (P,) int32 of the patches of one sweep, in turn."""
        places = self._places
        if self.order == 'random':
            count = max(1, places.corners.size // self.table.side**2)
            return rng.choice(places.corners, count)
        return turn(rng, places)
