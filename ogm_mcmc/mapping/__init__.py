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
"""

from ogm_mcmc.mapping.adaptive import AdaptiveMapper
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid
from ogm_mcmc.mapping.method import METHODS, MappingMethod, make_method
from ogm_mcmc.mapping.random_field import RandomFieldMapper
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = [
    'METHODS',
    'AdaptiveMapper',
    'LogOddsGrid',
    'MappingMethod',
    'RandomFieldMapper',
    'TwoAssumptionMapper',
    'make_method',
]
