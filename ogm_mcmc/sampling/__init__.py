"""Sampling whole maps from the full posterior p(m | z, x) ([gibbs], [patch]).

Design note: looking at few rays
--------------------------------
Context. A sweep draws every cell from its conditional, a sum over the rays that reach the cell
([gibbs] Eq. 3). There are 12.6 million pairs of a ray and a cell for Intel at 5 cm, and nearly all
say the same: this is free space.

Decision. A cell is occupied if u < p, with u drawn first. What its rays can add at most, whatever
the map (`RayIndex.gain`), bounds p from above before any ray was looked at: where u is not below
that ceiling the cell is free. With `beam`, cells far in front of the readings have a gain of 0, so
their ceiling is the prior, and 85 of 100 of them cost one random number. The others add up rays
until the rest cannot lift the sum above logit(u) any more, in free space after one or two. No draw
changes: a test compares whole runs with a sampler that evaluates everything, on the same numbers.

Each ray's first hit and its log-likelihood share 8 bytes, and so do the ray and the likelihood of
a pair, so that one look fetches both. Next hits are found by walking on along the ray's line.

Consequence. A sweep costs what is in doubt, not what was seen. Full evaluation of every pair is
gone, so conditional probabilities are not at hand, but for cells of patches that are in doubt,
where they are counted (Rao-Blackwell, see `patch_places`); of all others counts of maps are.

What was tried, one thread, best of nine in one process, on a machine busy with other things; scene
(gaussian, cut at 4 sigma, 0.80 million pairs) and Intel 5 cm (beam, 12.6), 2 cm (31.3), ms a
sweep:

=============================================================  =====  =====  =====
reading each pair's record and nothing else                    1.8    17
every pair of every cell in full                               5.0    56
**ceilings and early exit, as it is**                          7.1    33     87
the same in one function without inner ones                    5.5    30     88
... with random numbers from a buffer filled by NumPy          4.7    30
... with a comparison in place of the logarithm                5.3    28
... and counting the rays that reach each cell, so that        15     38     101
hidden cells look at none: flips have to walk every ray
=============================================================  =====  =====  =====

Of the 142 000 cells of the scene that are looked at in a sweep half lie behind walls, where all
rays have to be looked at to see that none arrives; 2.5 pairs each, so the mispredicted branches of
142 000 short loops (28 ns each) are what is left. At the resolution of the scene a ceiling helps
little: half of all pairs lie within four sigma of a reading.

The same code took 24 and 55 ms at first. Numba counts references whenever a function gets a tuple
of arrays, makes a view, or calls another function with arrays for one element: inner functions
take plain arrays, and views are made once.

Index, Intel 5 cm, ns a pair: casting 4, following rays 15 to 20 (of which traversal 5, likelihoods
3, counting 1 to 5), filing them under cells 14 to 18 (scattered stores). Tried without gain: one
8-byte store a pair instead of two of 4 (-2), 32-bit counts, loops of their own. The first touch of
memory costs as much again on virtual machines.

Design note: an index that costs what is informative
----------------------------------------------------
Context. Of the 79 cells of a ray of Intel at 5 cm 62 lie in front of its reading, where `beam`
makes every one as likely as the next: clutter. 15 bytes for each pair were 1 250 a ray.

Decision. A ray is a straight line: its cells, their order and the way on follow from 40 bytes.
A cell's list holds its near pairs, where the likelihood varies, 8 bytes each. Rays in front can
only lower the sum, so near pairs come first, and few cells ask for the others: these are named,
4 bytes each, in lists of cells that can gain more than a nat; elsewhere they are found among the
rays of a tile of 8 x 8 cells, kept as runs of ray numbers. Building follows each ray several times
and stores nothing that is not kept.

Consequence. Intel, 5 cm: 222 bytes a ray (near pairs 139, lines 40, front 25, the rest 18), 269 at
the peak of the build, which takes 1.25 s of processor time; 2 cm: 84 MB. Before: 1 253, and 517
MB. Runs of ray numbers take only 5. The stand-in for Stata (2 051 971 rays, 301 million pairs, 3.3
cm): 615 MB, built in 18 s. All draws of chains of cells and patches, at 2 and 5 cm, with `beam`,
`gaussian` and short returns, were those of the index before, bit for bit. Sweeps, processor time,
side by side on a busy machine: scene cut at 4 sigma 12.2 ms (before 13.3), Intel 5 cm 52 (46).

Tried: inner functions as they were took 25 ms on the scene, because Numba counted references in
them (see `borrowed_arrays`), and one loop for each source of rays took minutes to compile.
Beams that run along together are one ray where that is wanted, see `ray_merging`.

Design note: how far to trust a standard error
----------------------------------------------
Context. The variance of batch means takes batches for independent, which those of a short chain
are not; and a cell that never flipped has a variance of 0, as if it never could.

Decision. The variance is at least that of half chains, the quantity that R-hat looks at, for the
same reason that effective samples take in the variance between chains (Vehtari, Gelman, Simpson,
Carpenter, Buerkner 2021). Two more draws of either kind go into the error of a share (Agresti and
Coull 1998), which leaves sqrt(2) / draws where nothing was seen. Nothing is said of fewer than 16
sweeps.

How often, of 100, the exact probability lies within two standard errors; 1000 seeds, two chains
from empty and full maps, 20 sweeps of burn-in, so many counted. 15 cells that mix well, p above
and below 0.01 apart; two cells that take turns as a wall, correlated over 38 sweeps:

===============  =============  =============  =============
sweeps counted   undecided      decided        taking turns
                 before, now    before, now    before, now
===============  =============  =============  =============
16               84, 94         9, 100         52, 64
64               92, 96         31, 100        62, 78
128              93, 96         49, 100        72, 85
512              93, 96         70, 96         90, 92
===============  =============  =============  =============

Consequence. The larger of two estimates is a little too large: 1.15 times the error there is, and
the median of effective samples 18 % too small, however long chains run. Cells that take turns more
seldom than a chain is long are still overrated, by anything that looks at that chain alone: only
R-hat of chains that began apart knows. That a cell never flipped bounds its probability for draws
that are independent; the error is the least it can be.
"""

from ogm_mcmc.sampling.cell_gibbs import CellModel, GibbsState, SweepInfo, sweep
from ogm_mcmc.sampling.chain_starts import over_dispersed_starts
from ogm_mcmc.sampling.diagnostics import ChainQuality
from ogm_mcmc.sampling.posterior import (
    Estimate,
    PosteriorModel,
    PosteriorSampler,
)
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_window import RayWindow
from ogm_mcmc.sampling.window_scans import WindowSize

__all__ = [
    'CellModel',
    'ChainQuality',
    'Estimate',
    'GibbsState',
    'PosteriorModel',
    'PosteriorSampler',
    'RayIndex',
    'RayWindow',
    'SweepInfo',
    'WindowSize',
    'over_dispersed_starts',
    'sweep',
]
