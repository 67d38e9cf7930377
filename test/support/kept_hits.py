"""Slow twin of what a state keeps of each ray: its first hit, and what is behind that."""

import numpy as np

from ogm_mcmc.sampling.gibbs_kernels import UNTOLD
from ogm_mcmc.sampling.ray_index_kernels import NOTHING
from ogm_mcmc.sampling.ray_line_kernels import SHAPE, START, first_place
from ogm_mcmc.sampling.tile_kernels import STOPPED

__all__ = ['assert_hits_are_those_of_the_map']


def assert_hits_are_those_of_the_map(state, index, width):
    """Compare the records of a state with all cells of all rays; return how many seconds told."""
    bits, told = state.records.view(np.float32), 0
    for n in np.flatnonzero(state.records[:, 0] != STOPPED):
        cells, values, nothing = index.ray(n)
        rows, columns = np.divmod(cells, width)
        gone = abs(rows - rows[0]) + abs(columns - columns[0])
        places = gone + first_place(index.rays[n, START], index.rays[n, SHAPE])
        occupied = np.flatnonzero(state.cells[cells])
        hits = [(places[i], values[i]) for i in occupied[:2]] + 2 * [(NOTHING, nothing)]
        assert (state.records[n, 0], bits[n, 1]) == hits[0]
        # Of a ray that hits nothing there is nothing behind either.
        if occupied.size and state.records[n, 2] != UNTOLD:
            assert (state.records[n, 2], bits[n, 3]) == hits[1]
            told += 1
    return told
