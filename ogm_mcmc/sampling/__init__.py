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
a pair, so that one look fetches both. Next hits are found by walking on, one byte of direction per
cell. 15 bytes a pair, and 20 to 28 per ray and cell.

Consequence. A sweep costs what is in doubt, not what was seen. Full evaluation of every pair is
gone, so conditional probabilities cannot be averaged (Rao-Blackwell); counts of maps are.

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
"""

from ogm_mcmc.sampling.cell_gibbs import CellModel, GibbsState, SweepInfo, run_chain, sweep
from ogm_mcmc.sampling.diagnostics import ChainQuality
from ogm_mcmc.sampling.posterior import (
    Estimate,
    PosteriorModel,
    PosteriorSampler,
    over_dispersed_starts,
)
from ogm_mcmc.sampling.ray_index import RayIndex, RayWindow, WindowSize

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
    'run_chain',
    'sweep',
]
