"""How well a scan fits at each of many poses, given the probability of every cell.

Lengths in cells:
poses             (M, 3) x, y in cells of the array, heading in rad; may lie outside
bearings, ranges  (B,) rad and cells; inf: no return
reach             the greatest range of the sensor
log_p             (M,) float64, output, nats
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell, occupied_at
from ogm_mcmc.sensors.peak_kernels import FAR, NOTHING_LEFT, peak


@njit(cache=True, nogil=True)
def probability_fits(
    probability, prior, poses, bearings, ranges, reach, depth, hit, clutter, missing, sigma, log_p
):
    """Log-likelihood of the mixture over where each beam ends first, cells being independent.

    probability  (height, width) float32, nan where unknown; `prior` is taken there and outside
    depth        where in a cell a beam is reflected, as a share of its way through
    """
    for pose in range(poses.shape[0]):
        x, y = poses[pose, 0], poses[pose, 1]
        total = 0.0
        for beam in range(bearings.size):
            reading = np.float64(ranges[beam])
            # Whatever lies further off adds nothing to the density of this reading.
            furthest = min(reach, reading + FAR * sigma)
            nearest = min(reading, reach) - FAR * sigma
            angle = poses[pose, 2] + bearings[beam]
            next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
                x, y, math.cos(angle), math.sin(angle)
            )
            at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
            column, row = math.floor(x), math.floor(y)
            entered, left, hits = 0.0, 1.0, 0.0
            while entered <= furthest and left > NOTHING_LEFT:
                leaving = min(at_x, at_y)
                p = occupied_at(probability, prior, column, row)
                distance = entered + depth * (leaving - entered)
                if p > 0.0 and distance > nearest:
                    hits += left * p * peak(reading, distance, reach, sigma)
                left *= 1.0 - p
                column, row, next_x, next_y, at_x, at_y = next_cell(
                    x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y,
                    at_x, at_y,
                )  # fmt: skip
                entered = leaving
            if reading > reach:
                total += math.log(missing + hit * (hits + left))
            else:
                total += math.log(clutter / reach + hit * hits)
        log_p[pose] = total
