"""Kernels for rays whose cells and likelihoods lie side by side; why: `kept_odds`.

paths  (V, 2) int32: the cells of a ray in order, one for each place (NO_CELL where it has none),
       and END; as `said`, the same memory as float32, log p(z | each is its first hit), and
       log p(z | none is)
zones  (N, 4) int32, or the first columns of more: ZONE, where on its path ending begins to be less
       than `FAR` below a ray's best; OFFSET, what is to be added to a place for where it is on the
       path; ENDS, where END is. As `lowest`, the same memory as float32, LOWEST: in cells in front
       of its zone a ray counts as ending no better
"""

import numpy as np

from ogm_mcmc.sampling.kernel_options import inlined, kernel
from ogm_mcmc.sampling.ray_index_kernels import list_of, near_entry
from ogm_mcmc.sampling.ray_line_kernels import SHAPE, UNSEEN, cells_of_ray, place_of, places_of

# Columns of `paths` and `zones`.
CELL, SAID = range(2)
ZONE, LOWEST, OFFSET, ENDS = range(4)

# In place of a cell: behind the last one, and where no cell has that place.
END, NO_CELL = np.int32(-1), np.int32(-2)

# Nats below the best that a ray can be: where its zone begins, and LOWEST.
FAR, SLIP = 5.0, 4.0


@kernel
def find_paths(marks, lists, near, near_bits, rays, ray_bits, width, zones, lowest, paths, said):
    """Fill `zones` (N, 4) and `paths` (V, 2); V: one more than places for each ray."""
    total = np.int64(0)
    for ray in range(rays.shape[0]):
        shape = rays[ray, SHAPE]
        columns, rows = np.empty((2, places_of(shape)), np.int64)
        count = cells_of_ray(rays[ray], columns, rows)
        code = (ray << 2) | ((shape >> 48) & 3)
        offset = total - place_of(code, columns[0], rows[0])
        best = ray_bits[ray, UNSEEN]
        for k in range(total, total + places_of(shape) + 1):
            paths[k, CELL] = NO_CELL
        for i in range(count):
            cell = rows[i] * width + columns[i]
            value = near_bits[near_entry(code, list_of(cell, marks), lists, near), 1]
            k = offset + place_of(code, columns[i], rows[i])
            paths[k, CELL], said[k, SAID] = cell, value
            best = max(best, value)
        end = total + places_of(shape)
        paths[end, CELL], said[end, SAID] = END, ray_bits[ray, UNSEEN]
        first = total
        while first < end - 1:
            if paths[first, CELL] >= 0 and said[first, SAID] >= best - FAR:
                break
            first += 1
        zones[ray, OFFSET], zones[ray, ENDS], zones[ray, ZONE] = offset, end, first
        lowest[ray, LOWEST] = np.float32(best - SLIP)
        total = end + 1


@inlined
def begin_of(ray, zones):
    """Return where the path of a ray begins."""
    begin = np.int64(0)
    if ray > 0:
        begin = np.int64(zones[ray - 1, ENDS]) + 1
    return begin


@inlined
def next_on_path(k, cells, paths):
    """Return where on its path a ray ends that goes on behind `k`: there may be END."""
    while True:
        k += 1
        cell = paths[k, CELL]
        if cell >= 0:
            if cells[cell]:
                break
        elif cell == END:
            break
    return k
