"""Kernels that add what more beams say to rays of an index; see `ray_merging`."""

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import PLAN_SIZE, plan_ray
from ogm_mcmc.sampling.ray_filing_kernels import (
    TELLING,
    longest_ray,
    most_added,
    near_cells,
    near_from,
    sum_rounded_up,
    with_sigma,
)
from ogm_mcmc.sampling.ray_index_kernels import WIDTH, list_of, near_entry
from ogm_mcmc.sampling.ray_line_kernels import (
    LOW_16,
    RAY_WORDS,
    SHAPE,
    START,
    UNSEEN,
    first_place,
    lay_ray,
    place_of,
    places_of,
)
from ogm_mcmc.sensors.forward_model_kernels import (
    level_log_likelihood,
    range_log_likelihood,
    unseen_log_likelihood,
)


@njit(cache=True, nogil=True)
def add_beams(
    beams, numbers, model, resolution, rays, marks, lists, near, gain, telling, grid
):  # fmt: skip
    """Add the log-likelihoods of beams to those of rays that run along with them; return a sum.

    numbers  (n,) int64: the ray of each beam, near to all cells that the beam is near to
    All of a beam counts from its level, and the levels (nats) are what is returned: sums of
    many beams stay exact where they differ. `gain` and `telling` become those of the sums.
    """
    near_bits, ray_bits = near.view(np.float32), rays.view(np.float32)
    plan, own = np.empty(PLAN_SIZE, np.int64), np.empty(RAY_WORDS, np.int64)
    levels = 0.0
    longest = 0
    for ray in numbers:
        longest = max(longest, places_of(rays[ray, SHAPE]))
    longest = max(longest, longest_ray(beams.length)) + 1
    columns, rows = np.empty(longest, np.int64), np.empty(longest, np.int64)
    distances = np.empty(longest)
    for n in range(numbers.size):
        ray = numbers[n]
        reading, reach, length = beams.reading[n], beams.reach[n], beams.length[n]
        x, y = beams.x[n], beams.y[n]
        end_x, end_y = x + length * beams.ux[n], y + length * beams.uy[n]
        plan_ray(np.int64(beams.column[n]), np.int64(beams.row[n]), x, y, end_x, end_y, plan)
        lay_ray(plan, end_y < y, own)
        of_beam = with_sigma(model, beams.sigma[n])
        level, nearest = near_from(of_beam, reading, reach)
        _, varies = level_log_likelihood(of_beam, reading, reach)
        near_to = min(reading, reach)
        unseen = np.float32(unseen_log_likelihood(of_beam, reading, reach, length * resolution))
        start, shape = rays[ray, START], rays[ray, SHAPE]
        first, behind = first_place(start, shape), places_of(own[SHAPE])
        code = np.int32((ray << 2) | ((shape >> 48) & 3))
        # All near cells of the ray: what lies behind those in front of the beam's changes, too.
        steps = ((shape >> 32) & LOW_16) - 2
        begins = steps / (abs(beams.ux[n]) + abs(beams.uy[n])) * resolution
        count = near_cells(
            beams, n, rays[ray], min(nearest, begins), resolution, model.depth, columns, rows,
            distances,
        )  # fmt: skip
        before = ray_bits[ray, UNSEEN]
        after = np.float32(before + (unseen - np.float32(level)))
        ray_bits[ray, UNSEEN] = after
        tells, last = 0, 0
        for p in range(count - 1, -1, -1):
            place = np.int64(place_of(code, columns[p], rows[p])) - first
            if place < steps + 2:
                break
            last = p
            value = unseen
            if place < behind:
                value = np.float32(level)
                if abs(distances[p] - near_to) < varies:
                    value = np.float32(range_log_likelihood(of_beam, reading, reach, distances[p]))
            if tells == 0 and abs(value - unseen) > TELLING:
                tells = place + 1
            number = list_of(rows[p] * grid[WIDTH] + columns[p], marks)
            entry = near_entry(code, number, lists, near)
            old = near_bits[entry, 1]
            new = np.float32(old + (value - np.float32(level)))
            near_bits[entry, 1] = new
            adds = most_added(new, after) - most_added(old, before)
            if adds != 0.0:
                gain[number] = sum_rounded_up(gain[number], adds)
            before, after = min(before, old), min(after, new)
        if abs(np.float32(level) - unseen) > TELLING:
            in_front = behind
            if count > 0:
                in_front = np.int64(place_of(code, columns[last], rows[last])) - first
            tells = max(tells, min(in_front, behind))
        telling[ray] = max(telling[ray], tells)
        levels += np.float64(np.float32(level))
    return levels
