"""When a burn-in ends, and after which of its sweeps it is decided where to look most.

Design note: a burn-in that ends
--------------------------------
Context. Half of the time until Intel agreed was burn-in, and chains agreed at nearly the first
look afterwards. Ended by the likelihood it would never end: that still rises after 128 sweeps, by
patterns at surfaces and by solid space behind walls that fills, of which no ray tells.

Decision. At the half of the burn-in and each eighth after that R-hat looks at two halves of the
later two thirds of its sweeps, of many chains at those of two groups (`in_groups`); where it is
below 1.05 in 99 % of the informed cells, the burn-in ends with the next focus, two sweeps later.
It is done whole where agreement says nothing: of one chain, of chains from a given map or that go
on, of single cells with a `start` other than `dispersed`. Of patches any start is forgotten first.

Few draws disagree by chance more often than by themselves, so it errs on the long side: of Intel
.990 agree after 23 sweeps, .992 after 30, .993 after 50. The focus is decided after 8 sweeps for
the first time, not 16: a sweep that draws everything takes twice as long.

Consequence. Intel, 910 scans, both chains, processor time, a busy machine, pairs: agreement after
17.1 s and 89 sweeps instead of 22.2 s and 114 (starts included). With a burn-in of 24
sweeps 64 counted ones had 105 effective samples, with 50 126: the first are those that drift, so
per second they are as many. Even beams, judged by every third scan's odd ones, after 64 counted
sweeps: 1.058 nats (43 of burn-in), with 50 1.061.

What it cannot show: of patches starts of all kinds are `forgotten` before the first sweep, in what
readings ask for, so that chains begin nearly alike. There it tells chains that settled in
different places, and halves of one chain that drift apart, not a drift that all have in common and
that is slow beside a third of the burn-in. So means of 64 counted sweeps were compared, Intel, 910
scans, two chains of each seed, burn-ins of 50 that may not end (two seeds) and that may (three,
all ended after 25), in the 7000 cells whose mean is between .01 and .99; z is the difference by
both standard errors:

===================  ==================  ==============  =============  =======================
pairs of burn-ins    difference (rms)    z beyond 2, %   beyond 3, %    mean of the differences
===================  ==================  ==============  =============  =======================
50, 50 (1)           .104                3.2             .66            -.0001
50, 25 (3)           .109, .110, .113    2.9, 2.9, 3.6   .64, .70, .77  .0017, .0030, .0006
25, 25 (3)           .105, .118, .112    2.6, 3.6, 2.9   .47, .88, .65  .0012, -.0005, -.0018
===================  ==================  ==============  =============  =======================

Short and full ones are as far apart as two seeds of either; the log-likelihoods of the last maps,
156 617 and 156 774 nats with 50, 156 653 to 156 685 with 25, are so, too. That few cells are
further off than errors say, as two full ones also are, is not the burn-in's. Every third scan, two
seeds: chains agreed at no look, and the burn-in was done whole.

Design note: a burn-in that begins cold
---------------------------------------
Context. Where beams are few a reading is a single solid cell to begin with, which a learned prior
calls unlikely. The first sweeps take it for clutter, and chains are hundreds of sweeps in coming
back: the log-likelihood of a sparse warehouse's maps rises from 1233 to 1365 nats between 16 and
96 counted sweeps.

Decision. In the first 16 sweeps of a whole burn-in the likelihood has a power, 3 at first, down to
1: walls stand before readings can be doubted. They do not count, so the posterior is what it was;
of a burn-in of 50 the first look at agreement, after 23, still sees the last ten of them. Only of
few rays (`PatchModel.begins_cold`): Intel, even beams, gains nothing. Nothing has to be kept for
it: which power a sweep has follows from how many were done.

Consequence. Of five worlds of 395 to 1961 rays the Brier score falls by 2 to 28 %, the calibration
error, too, for a tenth more processor time. Hot burn-ins, and exchange between chains, are worse:
see "Tempering" in docs/results.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float32Array
from ogm_mcmc.sampling.diagnostics import (
    BatchCounts,
    agreeing_share,
    in_groups,
    later_halves,
    later_mean,
    split_r_hat,
)

__all__ = [
    'FRESH',
    'LEAST_BURN_IN',
    'agreement',
    'decides_after',
    'draws_everything',
    'end_looks',
    'ends_with',
    'power_after',
]

POWERS = (3.0, 3.0, 3.0, 2.5, 2.5, 2.0, 2.0, 1.8, 1.6, 1.5, 1.4, 1.3, 1.2, 1.1, 1.1, 1.05)
"""Of the likelihood in the first sweeps of a burn-in that begins cold."""

LEAST_LOOK = 8
"""What is settled is not told by fewer sweeps."""

FRESH = 2
"""So many sweeps draw everything after the last change of the focus, before any counts."""

END_LOOKS = (4, 5, 6, 7)
"""After so many eighths of a burn-in chains are asked whether it may end."""

LEAST_BURN_IN = 40
"""A shorter one is done whole."""

LEAST_AGREEING = 5
"""The later part of fewer sweeps has no two halves of two each: one draw does not vary."""

AGREEING = 1.05, 0.99
"""R-hat of so many of the informed cells is below this where a burn-in may end."""


def decides_after(burn_in: int, done: int) -> bool:
    """Whether it is decided after so many sweeps where to look most: in the burn-in only."""
    last = burn_in - FRESH
    return LEAST_LOOK <= done == last or (LEAST_LOOK <= done < last and done.bit_count() == 1)


def draws_everything(burn_in: int, done: int) -> bool:
    """Whether the sweep after so many draws everything alike, whatever was decided."""
    return burn_in - FRESH <= done < burn_in


def power_after(burn_in: int, done: int) -> float:
    """Return the power of the likelihood after so many sweeps of a burn-in that begins cold.

    A short burn-in, of chains that go on, has none.
    """
    return POWERS[done] if burn_in >= LEAST_BURN_IN and done < len(POWERS) else 1.0


def end_looks(burn_in: int) -> list[int]:
    """Return after how many sweeps chains are asked whether the burn-in may end."""
    return [burn_in * eighths // 8 - FRESH for eighths in END_LOOKS]


def ends_with(
    settling: Sequence[BatchCounts], informed: Callable[[Float32Array], BoolArray]
) -> bool:
    """Whether chains agree so far that their burn-in may end; see `agreement`."""
    limit, share = AGREEING
    return agreement(settling, informed, limit) >= share


def agreement(
    settling: Sequence[BatchCounts], informed: Callable[[Float32Array], BoolArray], limit: float
) -> float:
    """Return the share of informed cells with R-hat below a limit in the burn-in.

    settling  what each chain drew in it; informed: given a mean (C,), which cells (C,) are that

    Of the later two thirds of its sweeps, of many chains those of two groups, as counted sweeps
    are judged (`in_groups`); 0 while these are fewer than four and once they are let go. It says
    how far chains have come, and is no result: results are of counted sweeps.
    """
    if not settling or settling[0].full < LEAST_AGREEING:
        return 0.0
    halves, length = later_halves(settling, np.flatnonzero(informed(later_mean(settling))))
    means, together = in_groups(halves)
    return agreeing_share(split_r_hat(means, length * together), limit)
