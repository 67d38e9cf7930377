"""When the beams of a scan were taken, as what they saw tells.

A scan has one pose, but its beams are not taken at once. Two numbers of a recording say when, in
seconds from the middle of a scan, for beam i of B:

    t_i = turns * (1/2 where i is odd, -1/2 where it is even) + sweep * (i / (B - 1) - 1/2)

`turns`: some lidars read even and odd beams in two turns of their mirror (a SICK LMS in steps of
half a degree: 13.3 ms apart). `sweep`: from the first beam to the last. Logs name neither, and
where a driver does, scans were bent before (`ogm_mcmc.engine.deskew`); this is what is left.

How fast the sensor was at a scan, v, is told by the poses before and after and their stamps
(`velocities`). What beam i saw goes with v t_i, so both numbers enter residuals as poses do, and
are found with them: a step of Gauss and Newton from the poses on, which are eliminated (Schur
complement). A number that is not `CLEAR` of 0 in its deviations is taken for 0.

A deviation has two parts. How points scatter: what the model says of that, or what the numbers
change by where stretches of the recording are left out (jackknife), whichever is more. And how
well speeds are known, as if all were wrong alike: between two steps the speed may be that of
either. So scans that are seconds apart, while the robot turns and stops, tell nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array
from ogm_mcmc.trajectory.curvature import ROUGHLY, widening
from ogm_mcmc.trajectory.normal_equations import NormalEquations
from ogm_mcmc.trajectory.points import ScanPoints, wrapped
from ogm_mcmc.trajectory.surfel_kernels import centre, gather
from ogm_mcmc.trajectory.surfels import SurfelSystem

__all__ = ['BeamTimes', 'Speeds', 'bent_points', 'clear_numbers', 'shown_times', 'velocities']

# So many standard deviations from 0.
CLEAR = 5.0

# Before the data, the numbers are 0 but for so much, s: no lidar takes longer.
PRIOR_S = 0.2

# Speeds come from the nearest scans that are so far away, s: errors of poses count little then.
SHORTEST_STEP_S = 0.08

# Scans further from their neighbours do not tell when beams were taken, s.
LONGEST_STEP_S = 2.0

# Poses so far apart, s, do not even tell by how much to bend a scan.
LONGEST_BENT_S = 5.0

# Times are rounded: limits are kept by those that miss them by less, s.
ROUNDED_S = 1e-6

# No robot goes or turns faster, m/s and rad/s: that was a jump of the localizer.
FASTEST = 10.0

# So many stretches, each of which tells as much as any other, show how well numbers are known.
STRETCHES = 8


class Speeds(NamedTuple):
    """How fast the sensor was at K scans, m/s, m/s, rad/s, as it saw itself.

    `found` (K, 3), 0 where nothing is known; `unsure` (K, 3), what it may be more or less: a
    standard deviation with its direction; `known` (K,): steps before and after were short.
    """

    found: Float64Array
    unsure: Float64Array
    known: BoolArray


class BeamTimes(NamedTuple):
    """`seconds` (2,), turns and sweep, and their standard `deviations` (2,); nan: not known."""

    seconds: Float64Array
    deviations: Float64Array

    @classmethod
    def at_once(cls) -> BeamTimes:
        """Return that of beams which are taken all at once."""
        return cls(np.zeros(2), np.full(2, np.nan))


def velocities(poses: Float64Array, order: AnyArray, times_s: Float64Array) -> Speeds:
    """Return how fast the sensor was at the scans with these poses (K, 3).

    From a scan before to one after, by `order` (K,) and `times_s` (K,), which go up together.
    """
    sorted_, times = poses[order], times_s[order]
    here = np.arange(len(poses))
    before = np.searchsorted(times, times - SHORTEST_STEP_S + ROUNDED_S, 'right') - 1
    after = np.searchsorted(times, times + SHORTEST_STEP_S - ROUNDED_S, 'left')
    inside = (before >= 0) & (after < here.size)
    before, after = before.clip(0), after.clip(0, here.size - 1)
    apart = np.stack((times - times[before], times[after] - times))
    before, after = np.where(apart > LONGEST_BENT_S + ROUNDED_S, here, (before, after))
    sides = [_between(sorted_, times, before, here), _between(sorted_, times, here, after)]
    steps = _between(sorted_, times, before, after)
    possible = np.hypot(steps[:, 0], steps[:, 1]).clip(np.abs(steps[:, 2])) <= FASTEST
    steps[~possible] = 0.0
    found, unsure = np.empty_like(steps), np.empty_like(steps)
    found[order] = _turned(steps, -sorted_[:, 2])
    # As likely that of the step before as that of the one after, or any between.
    unsure[order] = _turned((sides[1] - sides[0]) / np.sqrt(12.0), -sorted_[:, 2])
    known = np.empty(here.size, np.bool_)
    known[order] = possible & inside & (apart <= LONGEST_STEP_S + ROUNDED_S).all(axis=0)
    return Speeds(found, unsure, known)


def _between(
    poses: Float64Array, times: Float64Array, first: AnyArray, last: AnyArray
) -> Float64Array:
    """Return how fast poses went from the first (K,) to the last (K,), 0 where that is no time."""
    seconds = times[last] - times[first]
    steps = wrapped(poses[last] - poses[first])
    steps[seconds <= 0.0] = 0.0
    return np.asarray(steps / np.where(seconds > 0.0, seconds, 1.0)[:, None], np.float64)


def _turned(moves: Float64Array, angle: Float64Array) -> Float64Array:
    """Return moves (K, 3) with their ways turned by the angles (K,)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, yaw = moves.T
    return np.stack((cosine * x - sine * y, sine * x + cosine * y, yaw), axis=1)


def bent_points(points: ScanPoints, speeds: Float64Array, seconds: Float64Array) -> ScanPoints:
    """Return the points as seen from where the sensor was in the middle of each scan.

    speeds  (K, 3), see `velocities`; `seconds` (2,) as in `BeamTimes`
    """
    if not seconds.any():
        return points
    moves = speeds[points.scan] * (points.part @ seconds)[:, None]
    ends = np.column_stack((points.local, np.zeros(len(moves))))
    return points._replace(local=_turned(ends, moves[:, 2])[:, :2] + moves[:, :2])


def shown_times(
    equations: NormalEquations,
    points: ScanPoints,
    poses: Float64Array,
    speeds: Speeds,
    now: Float64Array,
    held: float,
    order: AnyArray,
) -> BeamTimes:
    """Return what `equations`, points around lines at poses (K, 3), tell of both numbers.

    points  bent by the numbers `now` (2,), s
    held    how firmly points hold poses, see `curvature`
    order   (K,), that in which scans were taken
    """
    system = equations.system
    rate = _rates(system, poses, speeds.found * speeds.known[:, None])
    told = float(system.weight @ rate**2)
    if told == 0.0:
        return BeamTimes.at_once()
    amiss = _rates(system, poses, speeds.unsure * speeds.known[:, None])
    unsure = np.sqrt(float(system.weight @ amiss**2) / told)
    mean = np.empty(system.total.size)
    changes, pulls, answers = [], [], []
    for part in points.part[system.point].T:
        change = rate * part
        centre(change, system.weight, system.surfel, system.total, mean)
        change -= mean[system.surfel]
        pull = np.zeros_like(poses)
        gather(change, system.jacobian, system.weight, system.scan, pull)
        changes.append(change)
        pulls.append(pull)
        answers.append(equations.solve(pull, accuracy=ROUGHLY))
    uphill = equations.gradient
    precision, gradient = np.empty((len(poses), 2, 2)), np.empty((len(poses), 2))
    for a in range(2):
        off = _by_scan(system, changes[a] * system.residual)
        gradient[:, a] = -off - (answers[a] * uphill).sum(axis=1)
        for b in range(2):
            crossed = (answers[a] * pulls[b] + answers[b] * pulls[a]).sum(axis=1)
            precision[:, a, b] = _by_scan(system, changes[a] * changes[b]) - 0.5 * crossed
    pull = precision @ now + gradient
    return clear_numbers(precision[order], pull[order], widening(system, held), unsure)


def _rates(system: SurfelSystem, poses: Float64Array, speeds: Float64Array) -> Float64Array:
    """Return how fast every entry goes off its line, m/s, where sensors go at speeds (K, 3)."""
    along = _turned(speeds, poses[:, 2])
    return np.asarray(np.einsum('ij,ij->i', system.jacobian, along[system.scan]), np.float64)


def _by_scan(system: SurfelSystem, values: Float64Array) -> Float64Array:
    """Return the weighted sum of values (A,) of each scan (K,)."""
    weighed = system.weight * values
    return np.bincount(system.scan, weighed, minlength=len(system.gradient)).astype(np.float64)


def clear_numbers(
    precisions: Float64Array, pulls: Float64Array, wider: float, unsure: float
) -> BeamTimes:
    """Return the numbers that are clear of 0, the least clear left out one by one.

    precisions  (K, 2, 2) and `pulls` (K, 2) of the scans, one after the other
    wider       how many times so wide points scatter; `unsure`: speeds, as a share of them
    """
    prior = np.eye(2) / PRIOR_S**2
    precision, pull = prior + precisions.sum(axis=0), pulls.sum(axis=0)
    stretch = _stretches(np.einsum('kaa,a->k', precisions, 1.0 / np.diagonal(precision)))
    without = [
        (precision - precisions[stretch == b].sum(axis=0), pull - pulls[stretch == b].sum(axis=0))
        for b in np.unique(stretch)
    ]
    found = BeamTimes.at_once()
    kept = [0, 1]
    while kept:
        covariance = np.linalg.inv(precision[np.ix_(kept, kept)])
        seconds = covariance @ pull[kept]
        told = [np.linalg.solve(p[np.ix_(kept, kept)], at[kept]) for p, at in without]
        variance = np.maximum(wider**2 * np.diagonal(covariance), _jackknife(np.array(told)))
        deviations = np.sqrt(variance + (unsure * seconds) ** 2)
        found.deviations[kept] = deviations
        clear = np.abs(seconds) / deviations
        if clear.min() >= CLEAR:
            found.seconds[kept] = seconds
            break
        kept.pop(int(np.argmin(clear)))
    return found


def _stretches(told: Float64Array) -> Int64Array:
    """Return in which stretch each scan (K,) is, by how much it tells: each as much as another."""
    share = np.cumsum(told.clip(0.0))
    middle = (share - 0.5 * told.clip(0.0)) / max(float(share[-1]), 1e-300)
    return np.minimum(STRETCHES * middle, STRETCHES - 1).astype(np.int64)


def _jackknife(told: Float64Array) -> Float64Array:
    """Return the variances (n,) of numbers, given those (B, n) without each of B stretches."""
    count = len(told)
    if count < 2:
        return np.full(told.shape[1], np.inf)
    return np.asarray((count - 1) / count * ((told - told.mean(axis=0)) ** 2).sum(axis=0))
