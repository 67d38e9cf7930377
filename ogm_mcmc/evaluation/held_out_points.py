"""Points of held-out beams as a truth for maps: free along a beam, occupied where it returned.

So are continuous maps judged (Hilbert maps, Gaussian processes): area under the ROC curve,
log-loss, Brier score. Points lie at fixed distances, so every map, of whatever cells, is asked
about the same ones. The last free point of a beam is at least half a step before its end: nearer,
noise decides on which side of a wall it lies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array
from ogm_mcmc.errors import require
from ogm_mcmc.evaluation.calibration import Reliability, reliability
from ogm_mcmc.evaluation.classification import ThresholdCounts, confusion_counts
from ogm_mcmc.evaluation.held_out import HeldOutBeams, Ratio, ratio_of_sums
from ogm_mcmc.geometry import GridMap, Scan

__all__ = ['HeldOutPoints', 'PointScores', 'held_out_points', 'probability_at', 'score_points']

# 73 bytes each while they are judged: 3.7 GB.
MOST_POINTS = 50_000_000


class HeldOutPoints(NamedTuple):
    """Points (P, 2), m; `occupied` (P,) what is there; `scan` (P,) int64 who says so."""

    xy_m: Float64Array
    occupied: BoolArray
    scan: Int64Array


class PointScores(NamedTuple):
    """What a map says of points, judged; standard errors take scans as independent.

    `log_losses` (P,) nats. `clipped`: points whose probability was moved to the floor.
    """

    log_loss: Ratio
    brier: Ratio
    counts: ThresholdCounts
    reliability: Reliability
    log_losses: Float64Array
    clipped: int


def held_out_points(beams: HeldOutBeams, step_m: float, most: int = MOST_POINTS) -> HeldOutPoints:
    """Return the points of beams: free every `step_m` from half a step on, occupied at ends.

    A beam without a return is free all along its range and has no end. Raises ConfigError for a
    step so short that they would be more than `most`.
    """
    require(0.0 < step_m < math.inf, 'step', step_m, 'expected a positive distance, m')
    count = sum(_n_points(scan, step_m) for scan, _ in beams.placed)
    enough = f'{count} points: expected a step with {most} at most'
    require(count <= most, 'point_step', step_m, enough)
    xy, occupied, scans = [np.empty((0, 2))], [np.empty(0, np.bool_)], [np.empty(0, np.int64)]
    for index, (scan, belief) in enumerate(beams.placed):
        lengths, returned = _lengths_m(scan)
        angles = belief.mean.yaw_rad + scan.bearings()[scan.informative()]
        n_free = _n_free(lengths, step_m)
        beam = np.repeat(np.arange(lengths.size), n_free)
        place = np.arange(beam.size) - np.repeat(np.cumsum(n_free) - n_free, n_free)
        distances = np.concatenate(((place + 0.5) * step_m, lengths[returned]))
        along = np.concatenate((angles[beam], angles[returned]))
        directions = np.stack((np.cos(along), np.sin(along)), axis=1)
        sensor = np.array([belief.mean.x_m, belief.mean.y_m])
        xy.append(sensor + distances[:, np.newaxis] * directions)
        occupied.append(np.arange(distances.size) >= beam.size)
        scans.append(np.full(distances.size, index, np.int64))
    return HeldOutPoints(np.concatenate(xy), np.concatenate(occupied), np.concatenate(scans))


def _lengths_m(scan: Scan) -> tuple[Float64Array, BoolArray]:
    """Return how far each informative beam is known to be free, m, and whether it returned."""
    ranges = scan.ranges_m[scan.informative()].astype(np.float64)
    returned = np.isfinite(ranges)
    return np.where(returned, ranges, scan.range_max_m), returned


def _n_free(lengths_m: Float64Array, step_m: float) -> Int64Array:
    # Rounding must not take the point of a beam that is whole steps long.
    return np.floor(lengths_m / step_m + 1e-9).astype(np.int64)


def _n_points(scan: Scan, step_m: float) -> int:
    lengths, returned = _lengths_m(scan)
    return int(_n_free(lengths, step_m).sum() + returned.sum())


def probability_at(grid_map: GridMap, xy_m: AnyArray, prior: float = 0.5) -> Float64Array:
    """Probability (P,) of the cells that hold points (P, 2); `prior` where unknown or outside."""
    spec = grid_map.spec
    origin = np.array([spec.origin_x_m, spec.origin_y_m])
    column, row = np.floor((np.asarray(xy_m, np.float64) - origin) / spec.resolution_m).T
    inside = (column >= 0) & (column < spec.width) & (row >= 0) & (row < spec.height)
    values = np.full(inside.shape, np.nan)
    values[inside] = grid_map.probability[
        row[inside].astype(np.int64), column[inside].astype(np.int64)
    ]
    return np.where(np.isfinite(values), values, prior)


def score_points(
    points: HeldOutPoints, probability: AnyArray, *, floor: float = 1e-6, bins: int = 10
) -> PointScores:
    """Judge probabilities (P,); for the log-loss they are kept `floor` away from 0 and 1."""
    given = np.asarray(probability, np.float64)
    kept = np.clip(given, floor, 1.0 - floor)
    with np.errstate(divide='ignore'):
        losses = -np.log(np.where(points.occupied, kept, 1.0 - kept))
    return PointScores(
        _mean_per_point(points, losses),
        _mean_per_point(points, (given - points.occupied) ** 2),
        confusion_counts(given, points.occupied),
        reliability(given, points.occupied, bins),
        np.asarray(losses, np.float64),
        int((kept != given).sum()),
    )


def _mean_per_point(points: HeldOutPoints, values: AnyArray) -> Ratio:
    counts = np.bincount(points.scan)
    sums = np.bincount(points.scan, values)
    there = counts > 0
    return ratio_of_sums(sums[there], counts[there])
