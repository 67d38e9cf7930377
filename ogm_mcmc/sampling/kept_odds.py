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
Occupied cells are summed up, in full: what lies behind them changes all the time. For that the
rays that end in a cell hang together in a list, so that nobody searches for them among those that
were stopped before. To spare the way through free space a ray tells cells in front of its zone,
where ending is `FAR` below its best, nothing while it fits: there it counts as ending at `SLIP`
below its best or lower, which is an upper bound. Draws are those of `draw_cells`, and the tests
say so; rays that end in a cell are added up in another order, which changes a sum by 1e-15.

The cells of a ray lie side by side with their likelihoods (`paths`), so that one that goes on, or
tells, reads on from where it is. Before each 256 cells those that will be looked at are found, and
the memory of their rays is asked for (`fetching`). u is compared with what is kept through its
bits, without a logarithm, and cells where no ray arrives are drawn without a branch.

Consequence. The scene, after 20 sweeps, beside a plain loop that sums up all pairs of each cell
from one flat list, the same draws, ratio of processor times; whole rays (1 737 000 pairs, 347 000
cells) and rays cut 4 sigma behind the reading (804 000, 236 000). `bench sample` gives the last
row as `plain_loop`; rows up to the gap were measured in an earlier round, with the plain loop at
12 to 17 ns a pair, the others in turn with each other at 9 to 11, load 15 to 40:

===============================================================  ============  =============
..                                                               whole         cut
===============================================================  ============  =============
bounds by rays that fit, marked in each sweep                    1.13          1.41
log-odds kept, rays tell all of their cells                      .82           1.14 to 1.22
... and zones, random numbers drawn at once                      .72 to .76    .98 to 1.01
... and likelihoods side by side along rays                      .63 to .72    .89 to 1.02
..
the same                                                         .59 to .63    .93 to .96
cells beside their likelihoods: no lines to follow               .55           .72
zones from 5 nats below the best on in place of 8, SLIP 4 not 3  .52           .66
rays that end in a cell hang together                            .49           .71
comparing bits; asking for memory ahead                          .40           .60
a loop of its own for cells that nobody looks at                 .38           .55
**one line of numbers a ray; asking for what lies in front**     .35 to .37    .52 to .56
===============================================================  ============  =============

With little else running the row `the same` was .61 and .78, so the last one should gain on cut
rays, too; it was not measured.

The goal of .4 is met for whole rays, and missed by .12 to .16 for cut ones. Of a sweep of these
4.7 ms remain, of which (samples of the program counter) random numbers .4, comparing bits and
finding whom to look at .7, asking .4, cells that nobody looks at .6, sums of 9 200 occupied cells
.7, of 3 700 free ones .4, flips and what 11 300 rays tell 1.5. The plain loop takes 8.7 ms there
for 3.4 pairs a cell: .4 would be 15 ns a cell, random number included. With five scans, which fit
into L2, the ratio is .5 to .6: the rest is work, and cells behind walls, the cheapest, are what
cut rays leave out. That loop, for its part, counts references in `next_hit` (7 % of its time).

Tried without gain: asking cell by cell from lists of all rays (3 ms to ask, 3 less afterwards);
asking 64 or 512 cells ahead; for rays of free cells, too; for records; zones of 3 to 6 nats with
SLIP 3 to 5 (all within 3 %). Not tried: finding cells to look at with vector instructions and
going through them alone (a flip changes who is to be looked at, each 32 cells one does), which
could save up to .5 ms; telling cells in front only when a ray leaves a band of likelihoods.
Kept are 8 bytes a cell and 32 a ray and chain, 8 a place of a ray and 24 a ray, for models that
are level nowhere only; of that `max_memory_mb` counts what is of rays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, Float32Array, UInt8Array
from ogm_mcmc.sampling.kept_odds_kernels import ARRIVING, FORGOTTEN, sweep_lists
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import WIDTH
from ogm_mcmc.sampling.ray_line_kernels import LOW_16, SHAPE
from ogm_mcmc.sampling.ray_path_kernels import find_paths

__all__ = [
    'NOT_KEPT',
    'PATH_BYTES',
    'WAY_BYTES',
    'ZONE_BYTES',
    'KeptOdds',
    'Zones',
    'draw_lists',
    'forget_odds',
    'odds_to_keep',
    'zones_of',
]

ZONE_BYTES, PATH_BYTES = 24, 8
"""Memory of `Zones`: for each ray, and for each place of one."""

WAY_BYTES = 32
"""Memory of `KeptOdds.ways`: for each ray, of each chain."""


class KeptOdds(NamedTuple):
    """What a chain keeps beside its map: `odds` (K, 2) float32 and `ways` (N, 8) int32.

    See `ogm_mcmc.sampling.kept_odds_kernels`.
    """

    odds: Float32Array
    ways: AnyArray


NOT_KEPT = KeptOdds(np.empty((0, 2), np.float32), np.empty((0, 8), np.int32))
"""The odds of a state of which none are kept."""


def odds_to_keep(index: RayIndex, rays: Zones) -> KeptOdds:
    """Return room for what a state keeps, none where rays are level anywhere."""
    if not rays.zones.size:
        return NOT_KEPT
    ways = np.empty((index.n_rays, 8), np.int32)
    ways[:, :4] = rays.zones
    kept = KeptOdds(np.empty((index.n_cells, 2), np.float32), ways)
    forget_odds(kept.odds)
    return kept


class Zones(NamedTuple):
    """Of rays that are level nowhere: `zones` (N, 4) int32 and `paths` (V, 2) int32.

    See `ogm_mcmc.sampling.ray_path_kernels`.
    """

    zones: AnyArray
    paths: AnyArray

    @property
    def n_bytes(self) -> int:
        """Memory of both: `ZONE_BYTES` a ray and `PATH_BYTES` a place of one."""
        return int(self.zones.nbytes + self.paths.nbytes)


def zones_of(index: RayIndex) -> Zones:
    """Return the zones of the rays; of none where rays are level anywhere."""
    shapes = index.rays[: 0 if index.runs.size else index.n_rays, SHAPE]
    places = (shapes & LOW_16) + ((shapes >> 16) & LOW_16) + 1
    zones = np.zeros((shapes.size, 4), np.int32)
    paths = np.empty((int(places.sum()) + places.size, 2), np.int32)
    if zones.size:
        find_paths(
            index.marks, index.lists, index.near, index.near.view(np.float32), index.rays,
            index.rays.view(np.float32), index.grid[WIDTH], zones, zones.view(np.float32), paths,
            paths.view(np.float32),
        )  # fmt: skip
    return Zones(zones, paths)


def forget_odds(odds: Float32Array) -> None:
    """Let the next sweep begin anew: cells were changed by something else."""
    odds.view(np.int32)[:1, ARRIVING] = FORGOTTEN


def draw_lists(
    rng: Generator,
    order: AnyArray,
    state: tuple[UInt8Array, AnyArray, Float32Array, AnyArray],
    index: RayIndex,
    rays: Zones,
    log_odds: float,
) -> int:
    """Draw the cells of `order` (C,) int32 as `draw_cells` does; return the number of flips.

    state  cells (K,), records (N, 4) int32, see `gibbs_kernels`, and what is kept, of the same
           prior `log_odds`
    """
    cells, records, odds, ways = state
    numbers = rng.random(order.size)
    return int(
        sweep_lists(
            numbers, order, cells, records, records.view(np.float32), log_odds, odds,
            odds.view(np.int32), ways, ways.view(np.float32), rays.paths,
            rays.paths.view(np.float32), index.marks, index.lists, index.near,
            index.near.view(np.float32), index.grid[WIDTH],
        )
    )  # fmt: skip
