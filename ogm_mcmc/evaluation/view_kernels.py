"""Where the beams of many views probably end, in bins of distance; lengths in cells.

Common arguments:
views   (V, 2) x, y of the sensor, cells of the array; headings (B,) rad, the same from each view
reach   cells entered up to here can be hit; bin n holds distances from n on, in cells
hits    (V * B, F + 1) float64, output: probability to end in each bin, last: to hit nothing
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell, occupied_at

NOTHING_LEFT = 1e-9


@njit(cache=True, nogil=True)
def bin_hits(probability, prior, views, headings, reach, depth, hits):
    """Of independent cells: probability (height, width) float32, `prior` where nan and outside."""
    bins = hits.shape[1] - 1
    hits[:] = 0.0
    for view in range(views.shape[0]):
        x, y = views[view, 0], views[view, 1]
        for beam in range(headings.size):
            out = hits[view * headings.size + beam]
            next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
                x, y, math.cos(headings[beam]), math.sin(headings[beam])
            )
            at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
            column, row = math.floor(x), math.floor(y)
            entered, left = 0.0, 1.0
            while entered <= reach and left > NOTHING_LEFT:
                leaving = min(at_x, at_y)
                p = occupied_at(probability, prior, column, row)
                distance = entered + depth * (leaving - entered)
                out[min(math.floor(distance), bins - 1)] += left * p
                left *= 1.0 - p
                column, row, next_x, next_y, at_x, at_y = next_cell(
                    x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y,
                    at_x, at_y,
                )  # fmt: skip
                entered = leaving
            out[bins] = left


@njit(cache=True, nogil=True)
def bin_sample_hits(words, known, draws, prior, views, headings, reach, depth, hits):
    """Of map samples: bit s of words (height, width) uint64 is a cell's value in sample s.

    known  (height, width) bool: sampled cells; the others are occupied by a chance of each
    """
    height, width = words.shape
    everyone = ~np.uint64(0) if draws == 64 else (np.uint64(1) << np.uint64(draws)) - np.uint64(1)
    bins = hits.shape[1] - 1
    hits[:] = 0.0
    for view in range(views.shape[0]):
        x, y = views[view, 0], views[view, 1]
        for beam in range(headings.size):
            out = hits[view * headings.size + beam]
            next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
                x, y, math.cos(headings[beam]), math.sin(headings[beam])
            )
            at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
            column, row = math.floor(x), math.floor(y)
            entered, left = 0.0, 1.0
            alive, share = everyone, 1.0
            while entered <= reach and alive != 0 and left > NOTHING_LEFT:
                leaving = min(at_x, at_y)
                distance = entered + depth * (leaving - entered)
                at = min(math.floor(distance), bins - 1)
                inside = 0 <= column < width and 0 <= row < height
                if inside and known[row, column]:
                    here = words[row, column] & alive
                    if here != 0:
                        alive &= ~here
                        count = 0
                        while here != 0:
                            here &= here - np.uint64(1)
                            count += 1
                        out[at] += left * count / draws
                        share -= count / draws
                else:
                    out[at] += left * share * prior
                    left *= 1.0 - prior
                column, row, next_x, next_y, at_x, at_y = next_cell(
                    x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y,
                    at_x, at_y,
                )  # fmt: skip
                entered = leaving
            out[bins] = left * share if alive != 0 else 0.0
