"""Slow, obvious twin of the patch sampler: rays as lists of cells, transitions as whole tables.

Maps are tuples of cells, row by row. A draw of a patch is a mixture: with some probability this
list of patterns with these weights. `PatchDraw.branches` writes it out as the design note of
`ogm_mcmc.sampling.patch_gibbs` has it; from it follow the exact transition probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.sampling.patch_prior import PatchTable
from ogm_mcmc.sampling.ray_index import RayIndex
from support.patterns import cells_of, pattern_of

__all__ = [
    'NaiveRay',
    'PatchDraw',
    'border_of',
    'first_hit',
    'log_likelihood',
    'maps_of',
    'pattern_at',
    'rays_of',
    'stationary',
    'total_variation',
    'with_pattern',
]


class NaiveRay(NamedTuple):
    """Cells in order, log p(z | first hit) for each of them, and for none."""

    cells: list[int]
    values: list[float]
    nothing: float


def rays_of(index: RayIndex) -> list[NaiveRay]:
    """Read every ray of an index cell by cell."""
    rays = []
    for n in range(index.n_rays):
        cells, values, nothing = index.ray(n)
        rays.append(NaiveRay(cells.tolist(), values.tolist(), nothing))
    return rays


def first_hit(ray: NaiveRay, cells: Sequence[int]) -> int | None:
    """Place on the ray of the first occupied cell."""
    return next((i for i, cell in enumerate(ray.cells) if cells[cell]), None)


def log_likelihood(rays: Sequence[NaiveRay], cells: Sequence[int]) -> float:
    """Log p(z | m), nats."""
    total = 0.0
    for ray in rays:
        hit = first_hit(ray, cells)
        total += ray.nothing if hit is None else ray.values[hit]
    return total


def pattern_at(cells: Sequence[int], width: int, row: int, column: int, side: int) -> int:
    """Pattern of the patch whose lower left cell is at a row and column."""
    square = np.asarray(cells).reshape(-1, width)
    return pattern_of(square[row : row + side, column : column + side])


def border_of(cells: Sequence[int], width: int, row: int, column: int, side: int) -> int:
    """Number of the ring around a patch: its cells row by row, the first the lowest bit."""
    square = np.asarray(cells).reshape(-1, width)
    ring = [
        int(square[r, c])
        for r in range(row - 1, row + side + 1)
        for c in range(column - 1, column + side + 1)
        if not (row <= r < row + side and column <= c < column + side)
    ]
    return sum(bit << i for i, bit in enumerate(ring))


def with_pattern(
    cells: Sequence[int], width: int, row: int, column: int, side: int, pattern: int
) -> tuple[int, ...]:
    """Map with another pattern in a patch."""
    square = np.array(cells).reshape(-1, width)
    square[row : row + side, column : column + side] = cells_of(pattern, side)
    return tuple(int(cell) for cell in square.ravel())


Branch = tuple[float, list[int], list[float]]
"""Probability of the branch; patterns to draw from; their log-weights, nats."""


class PatchDraw:
    """One draw of the patch at (row, column) given all other cells of a map and all rays."""

    def __init__(
        self,
        rays: Sequence[NaiveRay],
        cells: Sequence[int],
        width: int,
        place: tuple[int, int],
        table: PatchTable,
    ) -> None:
        side = table.side
        self.n_patterns = 2 ** (side * side)
        border = border_of(cells, width, *place, side)
        entry = int(table.entry_of_border[border % table.entry_of_border.size])
        first, last = int(table.start[entry]), int(table.start[entry + 1])
        self.listed = table.candidates[first:last].tolist()
        held = dict(zip(self.listed, table.log_probability[first:last].tolist(), strict=True))
        floor = float(table.floor[entry])
        self.log_prior = [held.get(pattern, floor) for pattern in range(self.n_patterns)]
        self.log_likelihood = [
            log_likelihood(rays, with_pattern(cells, width, *place, side, pattern))
            for pattern in range(self.n_patterns)
        ]

    def conditional(self) -> Float64Array:
        """p(patch | border, all other cells, z) (2^L,): table times likelihood."""
        return _normalised(
            [a + b for a, b in zip(self.log_prior, self.log_likelihood, strict=True)]
        )

    def branches(self, present: int, escape: float, random_share: float = 0.0) -> list[Branch]:
        """How a patch that shows `present` is drawn.

        Published (`random_share` above 0): any pattern with that probability; else one of the
        listed. Ours: mostly one of the listed if the present one is; with `escape` one of the
        listed and one of the M that are not, which weighs M times its own weight.
        """
        unlisted = [p for p in range(self.n_patterns) if p not in self.listed]
        among_listed = self._weights(self.listed)
        everywhere = list(range(self.n_patterns))
        if random_share > 0.0:
            evenly = [0.0] * self.n_patterns
            return [
                (random_share, everywhere, evenly),
                (1.0 - random_share, self.listed, among_listed),
            ]
        if not unlisted:
            return [(1.0, self.listed, among_listed)]
        inside = present in self.listed
        stay = (self.listed, among_listed) if inside else ([present], [0.0])
        others = unlisted if inside else [present]
        branches = [(1.0 - escape, *stay)]
        for other in others:
            extra = self._weights([other])[0] + math.log(len(unlisted))
            options = [*self.listed, other]
            branches.append((escape / len(others), options, [*among_listed, extra]))
        return branches

    def transition(self, escape: float, random_share: float = 0.0) -> Float64Array:
        """P(from, to) (2^L, 2^L)."""
        matrix = np.zeros((self.n_patterns, self.n_patterns))
        for present in range(self.n_patterns):
            for share, options, weights in self.branches(present, escape, random_share):
                matrix[present, options] += share * _normalised(weights)
        return matrix

    def _weights(self, patterns: Sequence[int]) -> list[float]:
        return [self.log_prior[p] + self.log_likelihood[p] for p in patterns]


def _normalised(log_weights: Sequence[float]) -> Float64Array:
    weights = np.exp(np.asarray(log_weights) - max(log_weights))
    return np.asarray(weights / weights.sum())


def stationary(transition: Callable[[Float64Array], Float64Array], size: int) -> Float64Array:
    """Distribution (size,) that a transition leaves as it is, by repeating it."""
    share = np.full(size, 1.0 / size)
    for _ in range(100_000):
        after = transition(share)
        if total_variation(after, share) < 1e-13:
            return after
        share = after
    raise AssertionError('no stationary distribution was found')


def total_variation(a: Float64Array, b: Float64Array) -> float:
    """Half the sum of absolute differences of two distributions."""
    return float(0.5 * np.abs(a - b).sum())


def maps_of(cells: Sequence[int], free: Sequence[int]) -> list[tuple[int, ...]]:
    """All maps that agree with one but for the cells `free`; bit i of the index is free[i]."""
    maps = []
    for number in range(2 ** len(free)):
        one = list(cells)
        for i, cell in enumerate(free):
            one[cell] = number >> i & 1
        maps.append(tuple(one))
    return maps
