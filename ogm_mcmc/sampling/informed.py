"""Which cells data can tell anything of, and which it does tell of given what is occupied.

Design note: what is judged and what is shown
---------------------------------------------
Context. Rays are followed to six sigma behind their readings, and a wall's thickness is not
identified by data: behind the first surface the prior alone speaks. Counting such cells chains
never agreed, and showing them put black fur on the far side of every wall.

Decision. A cell is informed if a ray that tells more than half a nat of it arrives there with a
chance of at least one half under the posterior mean. These cells are judged (R-hat, effective
samples) and shown, and with them what lies between them, see `known_cells`. Everything else is
unknown. Cells below 0.1 do not stop a ray: its reading vouches for hundreds of them together.

Consequence. Intel, 5 cm, 910 scans, two chains: 98.8 % of the informed cells had R-hat below 1.05
after 11 s of processor time a chain, measured before cells below 0.1 were let through. Judged by
all crossed cells it was 87 % after 39 s; much of the difference is the choice of cells. On the
cells each map shows, the expected calibration error was 0.002 to 0.017 (live: 0.002 to 0.18); the
refined map chooses its cells, which flatters it. On the cells of the live map it was 0.0028
(live 0.0024) in the office and 0.088 (0.183) in a sparse warehouse.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array
from ogm_mcmc.sampling.informed_kernels import mark_arrivals
from ogm_mcmc.sampling.list_growth import side_by_side
from ogm_mcmc.sampling.ray_index import RayIndex
from ogm_mcmc.sampling.ray_index_kernels import WIDTH

__all__ = ['arrival', 'known_cells', 'near']

FREE_BELOW = 0.5

# From so many rays on each half is followed in a thread of its own: chains wait for the answer.
MANY_RAYS = 10_000


def arrival(
    index: RayIndex, telling: AnyArray, probability: Float32Array, least: float = 0.0
) -> Float32Array:
    """Return (K,) the largest chance that a ray with something to tell arrives at a cell.

    telling      (N,) int32, see `RayIndex`
    probability  (K,) float32 of being occupied; cells count as independent along a ray. With 0
                 everywhere: 1 in all cells that rays could tell of, 0 in the others
    Chances below `least` count as 0.
    """
    parts = 2 if index.n_rays >= MANY_RAYS else 1
    found = np.zeros((parts, index.n_cells), np.float32)
    cuts = [index.n_rays * part // parts for part in range(parts + 1)]

    def mark(part: int) -> None:
        rays = slice(cuts[part], cuts[part + 1])
        mark_arrivals(
            telling[rays], probability, np.float32(least), index.rays[rays], index.grid[WIDTH],
            found[part],
        )  # fmt: skip

    side_by_side(mark, [(part,) for part in range(parts)])
    largest: Float32Array = found.max(axis=0) if parts > 1 else found[0]
    return largest


def near(cells: BoolArray, margin: int) -> BoolArray:
    """Return the cells (height, width) within `margin` of some, diagonals included."""
    wide = cells
    for axis in (0, 1):
        grown = wide.copy()
        for shift in range(1, margin + 1):
            ahead, behind = [slice(None)] * 2, [slice(None)] * 2
            ahead[axis], behind[axis] = slice(shift, None), slice(None, -shift)
            grown[tuple(ahead)] |= wide[tuple(behind)]
            grown[tuple(behind)] |= wide[tuple(ahead)]
        wide = grown
    return wide


def known_cells(probability: Float32Array, arrives: BoolArray, reach: int) -> BoolArray:
    """Return which cells (height, width) data moved, given the posterior mean.

    probability  (height, width) of being occupied, nan where not sampled
    arrives      where a ray arrives that tells anything; these cells are known
    So are free cells between them: they can be reached in up to `reach` steps over free cells,
    without passing a wall, and do not lead that far on to free cells that are out of reach. And
    occupied cells beside any of these: the surface of a wall, inferred between beams too, but
    not what it is filled with.
    """
    with np.errstate(invalid='ignore'):
        free, occupied = probability < FREE_BELOW, probability >= FREE_BELOW
    seen = arrives & free
    wide = seen
    for _ in range(reach):
        wide = wide | (_beside(wide) & free)
    lost = free & ~wide
    for _ in range(reach):
        lost = lost | (_beside(lost) & wide & ~seen)
    open_cells = wide & ~lost
    known: BoolArray = arrives | open_cells | (near(open_cells, 1) & occupied)
    return known


def _beside(cells: BoolArray) -> BoolArray:
    """Cells with one of some to the left, right, above or below."""
    beside = np.zeros_like(cells)
    beside[1:] |= cells[:-1]
    beside[:-1] |= cells[1:]
    beside[:, 1:] |= cells[:, :-1]
    beside[:, :-1] |= cells[:, 1:]
    return beside
