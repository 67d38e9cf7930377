"""How well a scan fits a pose in a known grid; coordinates in cells."""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell


@njit(cache=True, nogil=True)
def scan_log_likelihoods(
    occupied, poses, bearings, ranges, reach, depth, sigma, clutter, missing, log_likelihoods
):
    """Log-likelihood of a scan at each of many poses, beam by beam.

    occupied  (height, width) uint8; poses (M, 3) x, y in cells, heading in rad
    bearings, ranges  (B,): rad and cells; inf: no return
    A beam that meets something at d measures N(d, sigma^2) with probability
    1 - clutter - missing, anything up to `reach` with `clutter`, and nothing with `missing`;
    one that meets nothing returns something with probability `clutter`.
    log_likelihoods   (M,) float64, output, nats
    """
    height, width = occupied.shape
    hit = (1.0 - clutter - missing) / (sigma * math.sqrt(2.0 * math.pi))
    for pose in range(poses.shape[0]):
        x, y, heading = poses[pose, 0], poses[pose, 1], poses[pose, 2]
        total = 0.0
        for beam in range(bearings.size):
            angle = heading + bearings[beam]
            next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
                x, y, math.cos(angle), math.sin(angle)
            )
            at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
            column, row = math.floor(x), math.floor(y)
            here, distance = 0.0, math.inf
            while here <= reach and 0 <= column < width and 0 <= row < height:
                leaving = min(at_x, at_y)
                if occupied[row, column]:
                    distance = here + depth * (leaving - here)
                    break
                here = leaving
                column, row, next_x, next_y, at_x, at_y = next_cell(
                    x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y,
                    at_x, at_y,
                )  # fmt: skip
            reading = np.float64(ranges[beam])
            if reading == math.inf:
                p = missing if distance < math.inf else 1.0 - clutter
            else:
                p = clutter / reach
                if distance < math.inf:
                    off = (reading - distance) / sigma
                    p += hit * math.exp(-0.5 * off * off)
            total += math.log(p)
        log_likelihoods[pose] = total
