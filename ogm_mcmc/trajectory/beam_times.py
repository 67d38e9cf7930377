"""When the beams of a scan were taken, as what they saw tells.

A scan has one pose, but its beams are not taken at once. Two numbers of a recording say when, in
seconds from the middle of a scan, for beam i of B:

    t_i = turns * (1/2 where i is odd, -1/2 where it is even) + sweep * (i / (B - 1) - 1/2)

`turns`: some lidars read even and odd beams in two turns of their mirror (a SICK LMS in steps of
half a degree: 13.3 ms apart). `sweep`: from the first beam to the last. Logs name neither, and
where a driver does, scans were bent before (`ogm_mcmc.engine.deskew`); this is what is left.

How fast the sensor was at a scan, v, is told by the poses before and after and their stamps. What
beam i saw goes with v t_i, so both numbers enter residuals as poses do, and are found with them:
a step of Gauss and Newton from the poses on, which are eliminated (Schur complement). A number
that is not `CLEAR` of 0 in its standard deviations is taken for 0.

Belgioioso (361 beams in half degrees): points lie 10.7 mm off their lines instead of 16.1, and
the sweep is 0.56 of what lies between two turns; half a turn would be 0.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.trajectory.curvature import ROUGHLY, widening
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints, wrapped
from ogm_mcmc.trajectory.surfel_kernels import centre, gather
from ogm_mcmc.trajectory.surfels import SurfelSystem, solve

__all__ = ['BeamTimes', 'bent_points', 'shown_times', 'velocities']

# So many standard deviations from 0.
CLEAR = 5.0

# Before the data, the numbers are 0 but for so much, s: no lidar takes longer.
PRIOR_S = 0.2

# Poses so far apart do not tell how fast the sensor was between them.
LONGEST_STEP_S = 10.0

# Nobody goes so many times as fast as usual: that was a jump of the localizer.
FASTEST = 10.0


class BeamTimes(NamedTuple):
    """`seconds` (2,), turns and sweep, and their standard `deviations` (2,); nan: not known."""

    seconds: Float64Array
    deviations: Float64Array

    @classmethod
    def at_once(cls) -> BeamTimes:
        """Return that of beams which are taken all at once."""
        return cls(np.zeros(2), np.full(2, np.nan))


def velocities(poses: Float64Array, order: AnyArray, times_s: Float64Array) -> Float64Array:
    """Return how fast the sensor was at each scan (K, 3), m/s, m/s, rad/s, as it saw itself.

    From the scan before to the one after, by `order` (K,) and `times_s` (K,); 0 where these are
    the same or too far apart.
    """
    last = len(poses) - 1
    before, after = np.arange(-1, last).clip(0), np.arange(1, last + 2).clip(0, last)
    sorted_, times = poses[order], times_s[order]
    steps, seconds = wrapped(sorted_[after] - sorted_[before]), times[after] - times[before]
    known = (seconds > 0.0) & (seconds <= 2.0 * LONGEST_STEP_S)
    steps[~known] = 0.0
    steps /= np.where(known, seconds, 1.0)[:, None]
    for axis in steps.T:
        moving = np.abs(axis[axis != 0.0])
        usual = float(np.median(moving)) if moving.size else 0.0
        axis.clip(-FASTEST * usual, FASTEST * usual, out=axis)
    found = np.empty_like(steps)
    found[order] = _turned(steps, -sorted_[:, 2])
    return found


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
    system: SurfelSystem,
    points: ScanPoints,
    factors: PoseFactors,
    poses: Float64Array,
    speeds: Float64Array,
    now: Float64Array,
    held: float,
) -> BeamTimes:
    """Return what `system`, points around lines at poses (K, 3), tells of both numbers.

    points  bent by the numbers `now` (2,), s; `speeds` (K, 3) see `velocities`
    held    how firmly points hold poses, see `curvature`
    """
    at = factors.linearised(poses)
    along = _turned(speeds, poses[:, 2])
    rate = np.einsum('ij,ij->i', system.jacobian, along[system.scan])
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
        answers.append(solve(system, factors, at, pull, accuracy=ROUGHLY))
    uphill = system.gradient + at.gradient
    precision, gradient = np.eye(2) / PRIOR_S**2, -now / PRIOR_S**2
    for a in range(2):
        gradient[a] -= float(system.weight @ (changes[a] * system.residual))
        gradient[a] -= float((answers[a] * uphill).sum())
        for b in range(2):
            precision[a, b] += float(system.weight @ (changes[a] * changes[b]))
            precision[a, b] -= 0.5 * float((answers[a] * pulls[b] + answers[b] * pulls[a]).sum())
    return _clear(precision, precision @ now + gradient, widening(system, held))


def _clear(precision: Float64Array, pull: Float64Array, wider: float) -> BeamTimes:
    """Return the numbers that are clear of 0, the least clear left out one by one."""
    found = BeamTimes.at_once()
    kept = [0, 1]
    while kept:
        covariance = np.linalg.inv(precision[np.ix_(kept, kept)])
        seconds = covariance @ pull[kept]
        deviations = wider * np.sqrt(np.diagonal(covariance))
        found.deviations[kept] = deviations
        clear = np.abs(seconds) / deviations
        if clear.min() >= CLEAR:
            found.seconds[kept] = seconds
            break
        kept.pop(int(np.argmin(clear)))
    return found
