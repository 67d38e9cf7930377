"""Online mapping methods, all behind `MappingMethod`.

Design note: the two-assumption update
--------------------------------------
Context. The live map must keep up with any lidar in Python, and be right.

Decision. `fusion: per_scan` marks the crossed cells of all beams of a scan in a bit set (one OR
per row and beam, see `ogm_mcmc.geometry`), clears the bits of cells that were hit, and then adds
`l_free` to the marked cells, 32 at a time, which the compiler turns into SIMD. A hit therefore
beats a miss and no cell counts twice, without a visit counter per cell. `per_beam` walks every
beam cell by cell and counts each, as [gibbs] writes it.

A cell is nan until something is measured in it. "Never measured" is thereby kept apart from
"log-odds 0", which one hit and one miss give. Log-odds are float32 and limited to plus and minus
`log_odds_limit`: at the default 100 no probability in double precision can tell, and rounding
stays below 1e-3 nats per hundred updates; below the limit the order of scans does not matter
beyond that rounding.

What was tried for adding the misses, whole call with the run ends of that day, ms on scene /
Intel 5 cm / Intel 2 cm: a test per cell of each word 1.13 / 18.0 / 54; lanes of 16 with a
branch each 1.8 / 30 / 104; **lanes of 32 with a select 1.00 / 14.9 / 38.4**. The same loop inside
the large kernel instead of in a function of its own, or with the test for an empty half around
it instead of `continue`, is not turned into SIMD and takes 2.3 times as long. Of 8.3 us for one
scan of the scene today, marking takes 3.0, planning 1.5, end points 1.0, misses and hits 0.6,
and Python and two kernel calls 2.3: one call for all, and a plan that knows that all rays start
at the same point, are what to try next. `error_model='numpy'` changes nothing.

Design note: evidence averaged over pose samples
------------------------------------------------
Context. [pose] Eq. 9 asks for M scans in place of one: M = 100 must fit between two scans.

Decision. Each sample marks its cells as one scan does. The marks of samples of equal weight are
counted 64 cells at a time, in binary, with a ripple carry through one word per digit: two such
steps on average whatever M is. When the weight changes, a digit worth 2^p adds weight * l_free *
2^p to the marked cells of a float32 window, 32 at a time; hits likewise. Draws from a Gaussian and
PoseArrays have one weight, so that happens once a scan; equal poses of a resampled cloud are
joined first. The window then goes to the map at once, which makes it one update per cell and
scan. With one sample of weight 1 every number is the one the known pose would have added.

The Gaussian model is flat in front of a reading, so a ray is marked up to there; the few cells
around its end are listed and have a value each, of which the highest of a sample counts.

What was tried, M = 100, 360 beams, 5 cm, one thread, best of 3, ms per scan in the office
(28 600 crossed cells per sample) / in a hall of 25 m x 20 m (107 000):

==========================================================  ====  ====
step, weights added to the window sample by sample          4.4   17.1
**step, marks counted in binary first**                     3.4   11.0
the same scan at a known pose, times 100                    3.5   11.1
gaussian, erf                                               16.8
**gaussian, Phi from a table** (binary counts as well)      11.7  19.4
per_beam, cells of each ray listed, then added              18.7
**per_beam, run by run**                                    6.2   18.1
gaussian, per_beam                                          23.9  65.4
==========================================================  ====  ====

(Figures with one column are of another run.) Marking is what is left: see the note on wedges
in `ogm_mcmc.geometry` for what to try next.

Design note: the adaptive map
-----------------------------
Context. [pose] section VI: leaves of a quadtree split where hits, misses and unknowns fit neither
a free nor an occupied leaf, and merge where siblings agree. It should give what a fine regular
grid gives, with fewer cells.

Decision. Nodes are rows of flat arrays (25 bytes: two links, level, log-odds, two counts and a
scratch index), children in groups of four, groups used again after merging; a small table holds
the roots, so the map grows without moving a node. Beams are traced on the finest lattice by the
traversal of all other methods: at forced full depth the map is the regular grid bit for bit.
After a split only the beams that met the leaf are walked again. Five departures from the print,
each because of what happened without it:

- A beam that ends in a leaf is also a miss by the share of the side it crossed (`way_to_hit`). As
  printed it is a hit alone, and a wall at the far side makes the whole leaf occupied.
- Only contradictions beyond the expected ones count in chi-square. The plain test refuses 0 hits
  of 300 where 2 % are expected: every leaf split as soon as it had been seen often enough.
- Siblings merge only if their counts together would not split again. Otherwise a hit on
  something new is spread over an area long known to be free before the next hit comes.
- Children start to count at nothing, since whose the parent's counts were is not known.
- Counts shrink to `count_limit`, or nothing new would ever be noticed in a leaf seen for hours.

Consequence. In memory the tree wins where areas are open or cells fine, and loses where walls
are everywhere; in time it always loses (figures in docs/methods.md). Most of the time goes to
walking beams cell by cell: walking leaf by leaf, and one walk for all rounds, are what to try
next.

Design note: the random field
-----------------------------
Context. [field]: log-odds of all cells are one Gaussian field, observed where the two-assumption
map has a value. Eq. 21 solves it at once; Eq. 24 takes one observation after the other. A map has
1e5 to 1e6 cells, and each changes with every scan.

Decision. The recursion, on demand. D does not depend on what was observed, only on where, so a
cell costs a rank-one update of its surroundings once in its life, and a changed value one row of
D. Scans go to the two-assumption map alone; when the map is read, each cell that changed is
brought up to date with its last value. D is kept for pairs up to R cells apart (`drop`), one half
of it, and only for cells that an observation has reached. More than the variance may not be
dropped (else K would be no covariance, and with R = 1 and l = 2 variances do become negative).

Errata of [field]: Eq. 9 prints odds where log-odds are meant; Eq. 24 shows the first step only,
D_i <- D_i - D_ij / (sigma_j^2 + D_jj) D_j in general; Eq. 11 divides by 2 l, not 2 l^2.

What was tried, Intel at 10 cm (59 348 measured cells, l = 1, sigma^2 = 0.1), one thread:

=================================================  ====  ==========  ============================
formulation                                        s     bytes/cell  error of the mean, rms (of 54)
recursion, R = 4 (drop 1e-4), read once            0.17  410         0.12
recursion, R = 4, read after every 5th of 910      0.8   410         0.4
recursion, R = 5 (drop 1e-6), read once            0.3   620         0.03
conjugate gradients, whole map, tolerance 1e-3     0.12  40          none to speak of; no variance
dense solves in blocks of 8 x 8 with 8 around it   5.8   16          none to speak of
=================================================  ====  ==========  ============================

Conjugate gradients (the covariance as two passes of a filter) are what to try next for one map at
the end of a long log; for a live map every change would mean a solve of the whole.
"""

from ogm_mcmc.mapping.adaptive import AdaptiveMapper
from ogm_mcmc.mapping.counting import CountingMapper
from ogm_mcmc.mapping.extras import Extras
from ogm_mcmc.mapping.gaussian_field import Prediction
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid
from ogm_mcmc.mapping.method import (
    METHODS,
    MappingMethod,
    add_scans,
    all_tables,
    check_change,
    extras_of,
    live_settings,
    make_method,
    predictor,
    uses_covariance,
)
from ogm_mcmc.mapping.pose_uncertain import PoseUncertainMapper
from ogm_mcmc.mapping.probability_beams import ProbabilityBeams
from ogm_mcmc.mapping.random_field import RandomFieldMapper
from ogm_mcmc.mapping.sonar import SonarMapper
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = [
    'METHODS',
    'AdaptiveMapper',
    'CountingMapper',
    'Extras',
    'LogOddsGrid',
    'MappingMethod',
    'PoseUncertainMapper',
    'ProbabilityBeams',
    'Prediction',
    'RandomFieldMapper',
    'SonarMapper',
    'TwoAssumptionMapper',
    'add_scans',
    'all_tables',
    'check_change',
    'extras_of',
    'live_settings',
    'make_method',
    'predictor',
    'uses_covariance',
]
