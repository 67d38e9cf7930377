"""Where a ray probably ends, given the probability of every cell.

With independent cells p(f = i) = p_i * prod over j before i of (1 - p_j), and what is left over
is the probability that nothing is hit.
"""

import math

from numba import njit

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell, occupied_at

# No cell can take more than what is left, so later ones matter less than rounding.
NOTHING_LEFT = 1e-15


@njit(cache=True, nogil=True)
def scan_first_hits(
    probability, prior, x, y, directions, reach, depth, distances, masses, starts, survival
):
    """First-hit distribution of every ray of a scan; returns the number of entries.

    probability  (height, width) float32, nan where unknown; `prior` is taken there and outside
    x, y         sensor, cells of the array; may lie outside
    directions   (2, N) unit vectors; reach: cells entered up to here can be hit
    depth        where inside a cell a beam is reflected, as a share of its way through
    distances, masses  (M,) float64, output, cells: of ray n from starts[n] to starts[n + 1];
                 M at least N * (1.5 * reach + 4)
    survival     (N,) float64, output: probability that nothing is hit
    """
    count = 0
    for ray in range(directions.shape[1]):
        starts[ray] = count
        next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
            x, y, directions[0, ray], directions[1, ray]
        )
        at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
        column, row = math.floor(x), math.floor(y)
        entered, left = 0.0, 1.0
        while entered <= reach and left > NOTHING_LEFT:
            leaving = min(at_x, at_y)
            p = occupied_at(probability, prior, column, row)
            if p > 0.0:
                distances[count] = entered + depth * (leaving - entered)
                masses[count] = left * p
                count += 1
                left *= 1.0 - p
            column, row, next_x, next_y, at_x, at_y = next_cell(
                x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y, at_x, at_y
            )
            entered = leaving
        survival[ray] = left
    starts[directions.shape[1]] = count
    return count


@njit(cache=True, nogil=True)
def segment_log_sums(log_terms, starts, log_rest, sums):
    """sums[n] = log(exp(log_rest[n]) + sum of exp(log_terms) of segment n), without overflow."""
    for n in range(sums.size):
        highest = log_rest[n]
        for k in range(starts[n], starts[n + 1]):
            highest = max(highest, log_terms[k])
        if highest == -math.inf:
            sums[n] = -math.inf
            continue
        total = math.exp(log_rest[n] - highest)
        for k in range(starts[n], starts[n + 1]):
            total += math.exp(log_terms[k] - highest)
        sums[n] = highest + math.log(total)
