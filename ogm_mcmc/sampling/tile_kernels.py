"""Kernels of maps that are sampled in tiles; note in `ogm_mcmc.sampling.tiles`.

cells, records, index  as in `ogm_mcmc.sampling.gibbs_kernels`, of one tile. A ray that is stopped
         before the tile has STOPPED as the place of its first hit: no draw looks at it then
behind   (n,) float32: log p(z | the first hit of each ray behind the tile), nan where a hit lies
         before the tile
hits     float32, one for each visit of a ray to a piece of the map: log p(z | its first occupied
         cell in that piece), nan without one
"""

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import SHIFT
from ogm_mcmc.sampling.gibbs_kernels import UNTOLD, redirect_rays
from ogm_mcmc.sampling.ray_index_kernels import NOTHING, WIDTH, likelihood_there
from ogm_mcmc.sampling.ray_line_kernels import (
    BORDER,
    LOW_16,
    LOW_32,
    RIGHTWARDS,
    SHAPE,
    SLOPE,
    START,
    UNSEEN,
    UPWARDS,
    first_place,
    next_occupied,
    place_of,
    row_of_ray,
)

# Lies before all places.
STOPPED = np.int32(-(2**31))


@njit(cache=True, nogil=True)
def cut_rays(rays, across, up, column_piece, row_piece, in_row, cut, kept, piece, along, begins):
    """Cut rays to a box that starts `across` columns and `up` rows before theirs; count them.

    column_piece, row_piece  (width,), (height,) int32: pieces of the map the box consists of, in
                   which there are `in_row` of them beside each other
    cut, kept      (N, 5) int64 and (N,) int32, output: the rays in the box, and their numbers
    piece, along   output, as many as visits of a ray to a piece: which one it is, and how many
                   places behind the first one of the whole ray it begins
    begins         (N + 1,) int32, output: the first visit of each kept ray
    """
    width, height = column_piece.size, row_piece.size
    count, visits = 0, 0
    begins[0] = 0
    for ray in range(rays.shape[0]):
        start, shape = rays[ray, START], rays[ray, SHAPE]
        border, slope = rays[ray, BORDER], rays[ray, SLOPE]
        flags, rows = shape >> 48, shape & LOW_16
        right = 1 if flags & RIGHTWARDS else -1
        upwards = 1 if flags & UPWARDS else -1
        first_row = (start >> 32) + up
        origin = np.int64(place_of(flags, (start & LOW_32) + across, first_row))
        # Rows of the ray that lie in the box.
        low = -first_row if upwards > 0 else first_row - (height - 1)
        high = height - 1 - first_row if upwards > 0 else first_row
        before = -1
        first_at = last_at = first_column = last_column = 0
        for at in range(max(low, 0), min(high, rows) + 1):
            row = first_row + upwards * at
            here, ends, _ = row_of_ray(border, slope, start, shape, row - up)
            here, ends = here + across, ends + across
            here = max(here, 0) if right > 0 else min(here, width - 1)
            ends = min(ends, width - 1) if right > 0 else max(ends, 0)
            for column in range(here, ends + right, right):
                this = int(row_piece[row]) * in_row + int(column_piece[column])
                if this != before:
                    if before < 0:
                        first_at, first_column = at, column
                    before = this
                    piece[visits] = this
                    along[visits] = np.int64(place_of(flags, column, row)) - origin
                    visits += 1
                last_at, last_column = at, column
        if before < 0:
            continue
        near = max(((shape >> 32) & LOW_16) - along[begins[count]], 0)
        cut[count, BORDER] = border + first_at * slope + (np.int64(across) << SHIFT)
        cut[count, SLOPE] = slope
        cut[count, START] = first_column | ((first_row + upwards * first_at) << 32)
        cut[count, SHAPE] = (
            (last_at - first_at)
            | (abs(last_column - first_column) << 16)
            | (near << 32)
            | (flags << 48)
        )
        cut[count, 4] = rays[ray, 4]
        kept[count] = ray
        count += 1
        begins[count] = visits
    return count


@njit(cache=True, nogil=True)
def look_again(numbers, behind, cells, index, records):
    """Find the first hits of the rays with these numbers, given what lies outside of the tile."""
    bits, near_bits = records.view(np.float32), index.near.view(np.float32)
    marks, lists, near, rays = index.marks, index.lists, index.near, index.rays
    ray_bits, width = rays.view(np.float32), index.grid[WIDTH]
    for j in range(numbers.size):
        ray = numbers[j]
        value = behind[ray]
        records[ray, 2] = UNTOLD
        if np.isnan(value):
            records[ray, 0], bits[ray, 1] = STOPPED, 0.0
            continue
        ray_bits[ray, UNSEEN] = value
        start, shape = rays[ray, START], rays[ray, SHAPE]
        column, row = start & LOW_32, start >> 32
        cell, place = row * width + column, first_place(start, shape)
        if not cells[cell]:
            cell, place = next_occupied(
                rays[ray, BORDER], rays[ray, SLOPE], start, shape, column, row, width, cells
            )
        if cell >= 0:
            code = (ray << 2) | ((shape >> 48) & 3)
            value = likelihood_there(
                code, cell, place, marks, lists, near, near_bits, rays, ray_bits
            )
        records[ray, 0] = place if cell >= 0 else NOTHING
        bits[ray, 1] = value


@njit(cache=True, nogil=True)
def go_on(
    behind, changed, cells, again, records, bits, marks, lists, full, gain, near, near_bits,
    front, tiles, runs, run_lengths, rays, ray_bits, grid,
):  # fmt: skip
    """Make first hits those of a map in which some cells changed, and of what lies outside now.

    changed  (C,) int32: cells that are another thing now; `cells` and `records` as they were, both
             in and out. Rays that are no longer stopped before the tile are left as they are:
             fills `again` (n,) int64 with their numbers, returns how many; see `look_again`
    """
    count = 0
    for ray in range(behind.size):
        value, first = behind[ray], records[ray, 0]
        if np.isnan(value):
            records[ray, 0], bits[ray, 1] = STOPPED, 0.0
            continue
        ray_bits[ray, UNSEEN] = value
        if first == STOPPED:
            again[count] = ray
            count += 1
        elif first == NOTHING:
            bits[ray, 1] = value
        elif records[ray, 2] == NOTHING:
            bits[ray, 3] = value
    for j in range(changed.size):
        cell = np.int64(changed[j])
        cells[cell] = 1 - cells[cell]
        redirect_rays(
            cell, cells, records, bits, marks, lists, full, near, near_bits, front, tiles, runs,
            run_lengths, rays, ray_bits, grid,
        )  # fmt: skip
    return count


@njit(cache=True, nogil=True)
def find_hits(begins, entered, cells, index, records, hits):
    """Fill `hits` (V,) from the records; rays with hits in front are followed through the tile.

    begins (n + 1,) int32, entered (V,) int32  the visits of each ray, at which place each begins
    """
    bits, near_bits = records.view(np.float32), index.near.view(np.float32)
    marks, lists, near, rays = index.marks, index.lists, index.near, index.rays
    ray_bits, width = rays.view(np.float32), index.grid[WIDTH]
    for ray in range(records.shape[0]):
        visit, last = np.int64(begins[ray]), np.int64(begins[ray + 1]) - 1
        hits[visit : last + 1] = np.nan
        if records[ray, 0] == NOTHING:
            continue
        if records[ray, 0] >= entered[last]:
            hits[last] = bits[ray, 1]
            continue
        start, shape = rays[ray, START], rays[ray, SHAPE]
        flags = shape >> 48
        right = 1 if flags & RIGHTWARDS else -1
        upwards = 1 if flags & UPWARDS else -1
        found = False
        for at in range((shape & LOW_16) + 1):
            row = (start >> 32) + upwards * at
            here, ends, _ = row_of_ray(rays[ray, BORDER], rays[ray, SLOPE], start, shape, row)
            for column in range(here, ends + right, right):
                place = place_of(flags, column, row)
                if visit < last and place >= entered[visit + 1]:
                    visit += 1
                    found = False
                cell = row * width + column
                if cells[cell] and not found:
                    found = True
                    code = (ray << 2) | (flags & 3)
                    hits[visit] = likelihood_there(
                        code, cell, place, marks, lists, near, near_bits, rays, ray_bits
                    )


@njit(cache=True, nogil=True)
def see_outside(first, last, ray_of, hits, unseen, behind):
    """Fill `behind` (n,) of a tile's rays from the hits of all visits.

    first, last  (n,) int32: the visits of each ray to the tile, among those of all rays, which lie
                 ray by ray, in order
    ray_of (V,) int32, hits (V,)  the ray of each visit; unseen (N,) log p(z | nothing on it)
    """
    for i in range(first.size):
        ray = ray_of[first[i]]
        value = unseen[ray]
        at = np.int64(last[i]) + 1
        while at < ray_of.size and ray_of[at] == ray:
            if not np.isnan(hits[at]):
                value = hits[at]
                break
            at += 1
        at = np.int64(first[i]) - 1
        while at >= 0 and ray_of[at] == ray:
            if not np.isnan(hits[at]):
                value = np.float32(np.nan)
                break
            at -= 1
        behind[i] = value


@njit(cache=True, nogil=True)
def sum_of_hits(ray_of, hits, unseen):
    """Log p(z | m) of all rays that visit anything, nats."""
    total, done = 0.0, np.int64(-1)
    for at in range(ray_of.size):
        ray = ray_of[at]
        if done == ray:
            continue
        if not np.isnan(hits[at]):
            total += hits[at]
            done = ray
        elif at + 1 == ray_of.size or ray_of[at + 1] != ray:
            total += unseen[ray]
    return total
