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
"""

from ogm_mcmc.mapping.counting import CountingMapper
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid
from ogm_mcmc.mapping.method import METHODS, MappingMethod, Reconfigurable, make_method
from ogm_mcmc.mapping.pose_uncertain import PoseUncertainMapper
from ogm_mcmc.mapping.sonar import SonarMapper
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = [
    'METHODS',
    'CountingMapper',
    'LogOddsGrid',
    'MappingMethod',
    'PoseUncertainMapper',
    'Reconfigurable',
    'SonarMapper',
    'TwoAssumptionMapper',
    'make_method',
]
