"""Poses as a part of what is estimated: p(map, poses | ranges, what the localizer said).

Design note: poses from surfaces, maps from cells
-------------------------------------------------
Context. A map of 5 cm cells takes poses as exact; on Intel 0.2 to 0.3 nats a held-out beam lie in
the 6 cm that those of the log are off. The obvious posterior has cells and poses as unknowns. But
a cell is 5 cm thick and reflects half way through, so what a pose has to fit is rounded: poses
that fit cells are worse than poses that fit surfaces.

Decision. Two models, each stated with its factors:

`surfels`        p(x | z): beliefs, measured moves, and points that lie on lines whose place is
                 integrated out; all poses are solved for together, coarse to fine. This is the
                 estimator `TrajectoryRefinement`; a map is then sampled at its poses. It is a cut
                 posterior: cells do not act back on poses.
`joint_sampler`  p(m, x | z) of cells and poses, exact: every part of a round leaves it invariant,
                 and an enumerated world pins it. For small problems, and as the reference.

Consequence. Long waves of drift take one solution, not thousands of moves of single scans.
Standard deviations are those of the quadratic model around the poses (perturb and solve), widened
by how much less firmly points hold poses than it says and by how points of one square err together
(`curvature`), times `inflation`.

What was tried. Intel, 910 scans, even beams; judged by the odd ones at the same poses (nats a
beam, traditional map; mean over four offsets of the lattice where marked *) and by 97 relations:

===========================================================  ======  ======  =====
poses                                                        nats    m       deg
===========================================================  ======  ======  =====
as given                                                     0.910*  0.0360  0.558
surfels of 1.6 m alone                                       1.023   0.0312  0.542
surfels of 0.8 m alone                                       1.224   0.0159  0.387
surfels of 0.4 m alone                                       1.242*  0.0147  0.361
0.4 m, then 0.2 m, lines at most 0.1 as wide as long         1.241*  0.0140  0.351
... 0.04 as wide / as wide as they like (variances)          1.224* / 1.247*
**0.4 m, then 0.2 m, 0.3 as wide**                           1.246*  0.0138  0.346
then 0.15 m / 0.1 m                                          1.242* / 1.239*
all beams, odd ones included: what poses could give          1.250*  0.0142  0.346
each scan then climbs the likelihood of a 5 cm map of the    1.189*  0.0191  0.398
others (four folds): fits its own beams better, 1.336
exact sampling from the given poses, 24 rounds in 40 s       -       0.0316  0.524
===========================================================  ======  ======  =====

Exact sampling accepts a third to a half of all moves at first and 14 of 100 against a sharp map.
After 24 rounds, two sweeps and two tries each, chains from the given and from the refined poses
have not met (median R-hat of x 14), and those from the refined ones have left them for worse
(relations 0.0138 to 0.0162) while fitting their own beams better: what is said above of cells.

From other starts (relations, m, before and after): 5 cm and
1 degree of noise 0.098, 0.0137; drift to 0.3 m and 3 degrees 0.136, 0.0145; the rough start of
Occupancy-SLAM (0.5 m, 6 degrees) 0.934, 0.0138, with a search. Without that 0.216: it is what
`search` is for. Looking scans up a second time puts the 15 back that went astray.

Coverage of intervals of 95 %, a copy of Intel with known poses, 2 cm of noise, beliefs of 5 cm and
1 degree, x, y, yaw: walls met where cells begin 0.95 to 0.98; met half way through, so that every
wall is a staircase no line fits, 0.83 to 0.92. With `inflation` 1: 0.90 to 0.95, 0.75 to 0.85.
Wild bootstraps over squares of the map were worse: 0.75 between neighbours. All this was before
`curvature`. The reason it came from: in buildings of 10 cm cells the gradient of points changes by
0.39 to 0.46 of what the model says when poses move (0.87 would be right), so real refits of noisy
copies scatter 1.5 to 1.8 times as far as it. Residuals of neighbouring beams are not correlated
(lag one: 0.00 to -0.05 at true poses), so a smaller number of effective beams is not the reason.
Integrating out how a line runs as well as where it lies: coverage 0.02 to 0.06 higher, poses 0.1
to 1 cm worse, 20 % slower. Scans' weight lowered to (held / slope)^2, poses estimated anew: errors
2.7 to 2.6 cm and 3.0 to 3.3 cm in two buildings, coverage no better.

Where intervals were wrong, with dense matrices of buildings 1, 3, 5, 9 and the copy of Intel: in
directions that the model holds least, without the rigid motions, errors were 1.4 to 1.7 times as
wide as it said, in those held most 0.7 to 1. There the gradient of points at the truth has 2 to 3
times the variance of independent points, which sums over squares show from scans alone, and in
buildings it changes less (0.33 to 0.39 of what the model says for 0.45 to 0.48, in the copy 0.65
for 0.71). Only the first is in: the second, measured along `in_common`, gained nothing (k 0.93 in
building 5, 1.13 in 1). Sums over squares drawn as the noise itself (signs at random, divided by
the freedom): 0.70, 0.75, 0.62 hold in building 1, for residuals shrink where few squares hold a
scan. Firmness in the precision, held H + F, not in the noise: 0.83, 0.88, 0.83 in building 1 and
0.97 in 9, no nearer to each other for a wider noise.

Few beams. With 4 or 5 beams a scan (Intel, 5 %) relations were 0.152 m, 0.036 before refining:
each pose of a log may move by itself, and a few beams settle wherever lines can be laid through
them. Moves that the localizer itself tells (`moves`) leave 0.035; raw odometry alone 0.053, both
0.032. More points on a line (6, 10, 20): 0.073, 0.045, 0.036, but 0.031 to 0.049 with 25 % of the
beams (with moves: 0.021). Scales of moves below 1 are not believed: with 5 % points claimed 0.23
of a move's covariance, and with 25 % relations were 0.023 then. Numbers of poses that points
decide count in their freedom (`curvature.numbers_fitted`): without that four beams a scan claimed
an error of 0.0055 m, with it 0.022 m.

Beliefs that err together (`alike`). A look-alike with a drift, taken for independent and for one
first-order process: 5 % of the beams 0.131, 0.024 m; 25 % 0.022, 0.0127 m; all 0.010, 0.0098 m.
The localizer's steps stay beside it: without them 5 % never finds the correlation (relations
0.131 m, 0.035 with). With all beams either alone is better than both (0.0142, 0.0143, 0.0151 m);
steps of four times the covariance: 0.0145 m, but 0.042 with 5 %.
"""

from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.moves import Moves
from ogm_mcmc.trajectory.points import ScanPoints
from ogm_mcmc.trajectory.refinement import TrajectoryProgress, TrajectoryRefinement

__all__ = [
    'Moves',
    'PoseFactors',
    'ScanPoints',
    'TrajectoryProgress',
    'TrajectoryRefinement',
]
