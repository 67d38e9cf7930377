"""How well a scan fits at each of many poses in a map; see `scan_fit`. Lengths in cells.

Common arguments:
poses             (M, 3) x, y in cells of the array, heading in rad; may lie outside
bearings, ranges  (B,) rad and cells; inf: no return
reach             the greatest range of the sensor
log_p             (M,) float64, output, nats
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell
from ogm_mcmc.sensors.peak_kernels import FAR, NOTHING_LEFT, peak


@njit(cache=True, nogil=True)
def field_fits(
    distances, poses, bearings, ranges, reach, hit, clutter, sigma, furthest, product, log_p
):
    """Weights of a likelihood field, p from how far each end is from a wall.

    distances  (height, width) float32: of a cell to the nearest occupied one, up to `furthest`,
               which is also what counts outside
    product    sum of log p; without it log(1 + sum of p^3)
    A range without a return, or of `reach` or more, says nothing.
    """
    height, width = distances.shape
    scale = -0.5 / (sigma * sigma)
    for pose in range(poses.shape[0]):
        cubes, logs = 1.0, 0.0
        for beam in range(bearings.size):
            if not ranges[beam] < reach:
                continue
            angle = poses[pose, 2] + bearings[beam]
            column = math.floor(poses[pose, 0] + ranges[beam] * math.cos(angle))
            row = math.floor(poses[pose, 1] + ranges[beam] * math.sin(angle))
            off = furthest
            if 0 <= column < width and 0 <= row < height:
                off = np.float64(distances[row, column])
            p = hit * math.exp(scale * off * off) + clutter / reach
            if product:
                logs += math.log(p)
            else:
                cubes += p * p * p
        log_p[pose] = logs if product else math.log(cubes)


@njit(cache=True, nogil=True)
def cast_fits(
    blocked, poses, bearings, ranges, reach, hit, short, missing, clutter, sigma, decay, log_p
):
    """Weights of a beam model: log(1 + sum of p^3), p a mixture around the range cast in the map.

    blocked  (height, width) uint8: cells that end a ray, half way through; so does the border
    """
    height, width = blocked.shape
    for pose in range(poses.shape[0]):
        x, y = poses[pose, 0], poses[pose, 1]
        total = 1.0
        for beam in range(bearings.size):
            angle = poses[pose, 2] + bearings[beam]
            next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
                x, y, math.cos(angle), math.sin(angle)
            )
            at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
            column, row = math.floor(x), math.floor(y)
            entered, expected = 0.0, reach
            while entered <= reach:
                leaving = min(at_x, at_y)
                if not (0 <= column < width and 0 <= row < height):
                    expected = entered
                    break
                if blocked[row, column]:
                    expected = min(reach, 0.5 * (entered + leaving))
                    break
                column, row, next_x, next_y, at_x, at_y = next_cell(
                    x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y,
                    at_x, at_y,
                )  # fmt: skip
                entered = leaving
            reading = min(np.float64(ranges[beam]), reach)
            off = (reading - expected) / sigma
            p = hit * math.exp(-0.5 * off * off)
            if off < 0.0:
                p += short * decay * math.exp(-decay * reading)
            p += missing if reading >= reach else clutter / reach
            total += p * p * p
        log_p[pose] = math.log(total)


@njit(cache=True, nogil=True)
def sample_fits(
    words, known, draws, prior, jointly, power, poses, bearings, ranges, reach, depth, hit,
    clutter, missing, sigma, log_p,
):  # fmt: skip
    """Log-likelihood of the mixture over map samples: beam by beam, or of whole scans (`jointly`).

    words  (height, width) uint64: bit s is the cell's value in sample s; draws of them, up to 64
    known  (height, width) bool: sampled cells; others are occupied by a chance `prior` of each
    With l[s] the log-likelihood of all beams in sample s: log (mean over s of exp(power l[s]));
    `power` counts for whole scans only.
    """
    height, width = words.shape
    everyone = ~np.uint64(0) if draws == 64 else (np.uint64(1) << np.uint64(draws)) - np.uint64(1)
    by_sample = np.empty(draws)
    for pose in range(poses.shape[0]):
        x, y = poses[pose, 0], poses[pose, 1]
        total = 0.0
        by_sample[:] = 0.0
        for beam in range(bearings.size):
            reading = np.float64(ranges[beam])
            furthest = min(reach, reading + FAR * sigma)
            nearest = min(reading, reach) - FAR * sigma
            floor = missing if reading > reach else clutter / reach
            angle = poses[pose, 2] + bearings[beam]
            next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
                x, y, math.cos(angle), math.sin(angle)
            )
            at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
            column, row = math.floor(x), math.floor(y)
            # `hits`: what cells that nobody sampled add to every beam that comes by.
            entered, left, hits, density = 0.0, 1.0, 0.0, 0.0
            alive = everyone
            while entered <= furthest and alive != 0 and left > NOTHING_LEFT:
                leaving = min(at_x, at_y)
                distance = entered + depth * (leaving - entered)
                inside = 0 <= column < width and 0 <= row < height
                if inside and known[row, column]:
                    here = words[row, column] & alive
                    if here != 0:
                        alive &= ~here
                        added = (
                            peak(reading, distance, reach, sigma) if distance > nearest else 0.0
                        )
                        here_p = floor + hit * (hits + left * added)
                        log_here = math.log(here_p) if jointly else 0.0
                        while here != 0:
                            lowest = here & (~here + np.uint64(1))
                            here ^= lowest
                            density += here_p
                            if jointly:
                                by_sample[bit_of(lowest)] += log_here
                elif prior > 0.0:
                    if distance > nearest:
                        hits += left * prior * peak(reading, distance, reach, sigma)
                    left *= 1.0 - prior
                column, row, next_x, next_y, at_x, at_y = next_cell(
                    x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y,
                    at_x, at_y,
                )  # fmt: skip
                entered = leaving
            rest = floor + hit * (hits + left if reading > reach else hits)
            log_rest = math.log(rest) if jointly else 0.0
            while alive != 0:
                lowest = alive & (~alive + np.uint64(1))
                alive ^= lowest
                density += rest
                if jointly:
                    by_sample[bit_of(lowest)] += log_rest
            if not jointly:
                total += math.log(density / draws)
        if jointly:
            highest = by_sample.max()
            shares = 0.0
            for s in range(draws):
                shares += math.exp(power * (by_sample[s] - highest))
            total = power * highest + math.log(shares / draws)
        log_p[pose] = total


@njit(cache=True, nogil=True, inline='always')
def bit_of(word):
    """Return which bit a power of two is, 0 to 63."""
    at = 0
    for step in (32, 16, 8, 4, 2, 1):
        if word >> np.uint64(step):
            word >>= np.uint64(step)
            at += step
    return at
