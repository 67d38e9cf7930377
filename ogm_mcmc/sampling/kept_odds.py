"""Single cells drawn from log-odds that are kept, where rays vary all along, as Gaussian ones do.

Design note: what a flip changes is told
----------------------------------------
Context. With `beam` what a ray can add to the log-odds of a cell is bounded, and nothing far in
front of a reading: sums end early. A Gaussian likelihood falls without end, so a ray that ends
nowhere near its reading can add hundreds of nats to any cell: no bound that holds for all maps
ends a sum. Of the recorded scene (100 x 180 beams, sigma of two cells) 7 300 of 181 000 cells
where a ray arrives flip in a sweep, and 11 400 rays change their first hit.

Decision. The log-odds of a free cell follow from the first hits of its rays, so they are kept,
with how many rays arrive, and a ray whose first hit changes tells its cells: what those in front
gain or lose, what it adds to those that it reaches now, or no longer. A free cell with u above
what is kept takes no look at a ray; one where no ray arrives (half of all) is the prior's.
Occupied cells are summed up, in full: what lies behind them changes all the time. To spare the
way through free space a ray tells cells in front of its zone, where ending is `FAR` below its
best, nothing while it fits: there it counts as ending at `SLIP` below its best or lower, which is
an upper bound. Draws are those of `draw_cells`, bit for bit, and the tests say so.

Consequence. The scene, after 20 sweeps, beside a plain loop that sums up all pairs of each cell
from one flat list, the same draws, in one run, ratio of processor times, on a busy machine (load
5 to 22; the plain loop takes 12 to 17 ns a pair there):

=================================================  =====================  ====================
..                                                 whole rays             cut 4 sigma behind
pairs, cells                                       1 737 000, 347 000     804 000, 236 000
=================================================  =====================  ====================
bounds by rays that fit, marked in each sweep      1.13                   1.41
log-odds kept, rays tell all of their cells        .82                    1.14 to 1.22
... and zones, random numbers drawn at once        .72 to .76             .98 to 1.01
**... and likelihoods side by side along rays**    .63 to .72             .89 to 1.02
=================================================  =====================  ====================

With nothing else running the last row is .63 to .65 and .81 to .94 (two programs, one run each).

The goal of .4 is not met. `bench sample` takes the last row (`plain_loop`): .62 to .67 and .85 to
.98 in eight runs on a busy machine. Parts of the scene, scans from its beginning, one run each,
and what a sweep touches (ours; next, of a permuted list, a cache line after the other takes 5 ns
in 0.3 MB, 15 in 0.7, 23 in 1.3, 110 in 3, 140 to 160 in 6 to 20: L2 has 0.5 MB):

===================  ======  =============  ============  =====  ======  =============  =====
..                   whole   .              .             .      cut     .              .
scans                MB      ours, ns/cell  plain, /pair  ratio  MB      ours, ns/cell  ratio
===================  ======  =============  ============  =====  ======  =============  =====
1                    0.9     13             18            .54    0.5     19             .79
3                    6.5     18             20            .68    4.2     33             .79
10                   11      27             29            .68    6.2     46             1.00
30                   19      22             19            .69    10      36             1.04
100                  36      38             12            .65    20      48             .98
===================  ======  =============  ============  =====  ======  =============  =====

So up to 60 % of a sweep is waiting (cut, .09 of the cells flip with one scan, .08 with all; but a
cell has twice the pairs): at the speed of one scan, which fits into L2, the scene would take .22
and .39 of what the plain loop takes. That loop reads its pairs one after the other and hardly
waits, while a ray that is told has its lines all over the map: 29 ns a cell more are what some
60 000 lines from beyond L2 take, for 19 000 flips (cut). Where all fits into L2 for both, the
ratio is .54 and .79 still: there it is work, not memory.

Of 12 ms (cut) 3 to 3.5 are for one look at each cell, 2.5 for summing up 13 000 cells, 3 for what
lies behind their 17 500 first hits, 3 for flips and what rays tell. Tried without gain: asking for
rays of the next 32 cells ahead (`llvm.prefetch`): 3 ms to ask, 3 less afterwards; 8 bytes a cell
in place of 16, without where its list begins (same time in pairs of runs; taken, as it is less).
Kept are 8 bytes a cell and chain, and 4 bytes a place of a ray, for models that are level nowhere
only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, Float32Array, UInt8Array
from ogm_mcmc.sampling.kept_odds_kernels import find_zones, sweep_lists
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import WIDTH
from ogm_mcmc.sampling.ray_line_kernels import LOW_16, SHAPE

__all__ = [
    'NOT_KEPT',
    'VALUE_BYTES',
    'ZONE_BYTES',
    'Zones',
    'draw_lists',
    'forget_odds',
    'odds_to_keep',
    'zones_of',
]

ZONE_BYTES, VALUE_BYTES = 16, 4
"""Memory of `Zones`: for each ray, and for each place of one."""

NOT_KEPT: Float32Array = np.empty((0, 2), np.float32)
"""The odds of a state of which none are kept."""


def odds_to_keep(index: RayIndex) -> Float32Array:
    """Return room (K, 2) for what a state keeps, empty where rays are level anywhere."""
    if index.runs.size or not index.n_rays:
        return NOT_KEPT
    odds = np.empty((index.n_cells, 2), np.float32)
    forget_odds(odds)
    return odds


class Zones(NamedTuple):
    """Of rays that are level nowhere: `zones` (N, 4) int32 and `values` (V,) float32.

    See `ogm_mcmc.sampling.kept_odds_kernels`.
    """

    zones: AnyArray
    values: Float32Array

    @property
    def n_bytes(self) -> int:
        """Memory of both: `ZONE_BYTES` a ray and `VALUE_BYTES` a place of one."""
        return int(self.zones.nbytes + self.values.nbytes)


def zones_of(index: RayIndex) -> Zones:
    """Return the zones of the rays; of none where rays are level anywhere."""
    shapes = index.rays[: 0 if index.runs.size else index.n_rays, SHAPE]
    places = (shapes & LOW_16) + ((shapes >> 16) & LOW_16) + 1
    zones = np.zeros((shapes.size, 4), np.int32)
    values = np.zeros(int(places.sum()), np.float32)
    if zones.size:
        near_bits, ray_bits = index.near.view(np.float32), index.rays.view(np.float32)
        find_zones(
            index.marks, index.lists, index.near, near_bits, index.rays, ray_bits,
            index.grid[WIDTH], zones, zones.view(np.float32), values,
        )  # fmt: skip
    return Zones(zones, values)


def forget_odds(odds: Float32Array) -> None:
    """Let the next sweep begin anew: cells were changed by something else."""
    odds[:1] = np.nan


def draw_lists(
    rng: Generator,
    order: AnyArray,
    state: tuple[UInt8Array, AnyArray, Float32Array],
    index: RayIndex,
    rays: Zones,
    log_odds: float,
) -> int:
    """Draw the cells of `order` (C,) int32 as `draw_cells` does; return the number of flips.

    state  cells (K,), records (N, 4) int32, see `gibbs_kernels`, and odds (K, 2), of the same
           prior `log_odds`
    """
    cells, records, odds = state
    numbers = rng.random(order.size)
    near_bits, ray_bits = index.near.view(np.float32), index.rays.view(np.float32)
    return int(
        sweep_lists(
            numbers, order, cells, records, records.view(np.float32), log_odds, odds,
            rays.zones, rays.zones.view(np.float32), rays.values,
            index.marks, index.lists, index.near, near_bits, index.rays, ray_bits, index.grid,
        )
    )  # fmt: skip
