"""Kernel of the sonar method: one cone into a log-odds array ([slides])."""

import math

import numpy as np
from numba import njit

from ogm_mcmc.mapping.two_assumption_kernels import updated
from ogm_mcmc.sensors.inverse_model_kernels import sonar_log_odds


@njit(cache=True, nogil=True)
def add_cone(
    log_odds, left, bottom, right, top, x, y, cosine, sine, reading, hit, half_angle,
    strength, sigma, thickness, metres, prior, limit,
):  # fmt: skip
    """Update the cells whose centre lies in a cone; return how many.

    log_odds  (height, width) float32, nan where never measured
    left, bottom, right, top  block of the array to look at, upper ends excluded
    x, y  sensor, cells in the array; cosine, sine  direction of the axis
    reading, thickness  m; half_angle, sigma  rad; metres  side of a cell
    A cell that the axis passes closer than half a cell counts as inside, so that a cone
    narrower than a cell leaves no holes.
    """
    changed = 0
    furthest = (reading + thickness) / metres if hit else reading / metres
    for row in range(bottom, top):
        for column in range(left, right):
            dx, dy = column + 0.5 - x, row + 0.5 - y
            along, across = dx * cosine + dy * sine, abs(dy * cosine - dx * sine)
            if along < -0.5:
                continue
            distance = math.sqrt(dx * dx + dy * dy)
            if distance > furthest:
                continue
            angle = math.atan2(across, along)
            if angle > half_angle:
                if across > 0.5:
                    continue
                angle = half_angle
            change = sonar_log_odds(
                distance * metres, angle, reading, hit, strength, sigma, thickness
            )
            old = log_odds[row, column]
            log_odds[row, column] = updated(old, np.float32(change), prior, limit)
            changed += 1
    return changed
