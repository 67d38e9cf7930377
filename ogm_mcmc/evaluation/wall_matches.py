"""Places where the ends of beams lie on the walls of a map: turn by turn, all shifts at once.

The map on coarse cells says what an end there counts for: the probability of a wall, a share of it
beside one, less than nothing where the map is free. How much the ends count at every shift is a
correlation, which the FFT finds for all of them together (correlative matching without a lattice
of shifts to choose). What comes out are candidates for a closer look: `map_frames`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry import GridMap

__all__ = ['WallMatches', 'wall_matches']

# A coarse cell is at least so many cells wide, and so many of them cover map and ends.
LEAST_CELLS, MOST_BLOCKS = 2, 200

# Probabilities below are no walls. What an end counts for beside a wall, as a share, and where
# the map is free: ends that lie there are as telling as those on walls, but for noise.
WALL = 0.35
BESIDE = 0.6
IN_FREE = -0.5

# Single far ends would make the coarse cells of all others larger: this share of ends counts.
COUNTED = 0.99

# Places of one turn that are kept, no two of them within so many coarse cells.
OF_ONE_TURN, APART = 6, 2

# Factors of sizes that the FFT likes.
ODD_FACTORS = (1, 3, 5, 9, 15, 25, 27, 45, 75)


class WallMatches(NamedTuple):
    """Candidates (M, 3), the likeliest first: turn about the middle of the ends, then shift.

    x, y m, turn rad: what map and beams have in common lies there; `cell_m` and `turn_rad` are
    the steps they were looked for by.
    """

    moves: Float64Array
    cell_m: float
    turn_rad: float


def wall_matches(
    grid_map: GridMap, ends: Float64Array, reach_m: float, turn_rad: float, most: int
) -> WallMatches:
    """Return the places where most of the ends (N, 2), m, lie on walls of a map.

    reach_m   how far the middle of the ends is moved at most; 0: wherever the map is
    turn_rad  how far the map is turned at most to each side
    """
    spec = grid_map.spec
    middle = ends.mean(axis=0)
    away = np.hypot(*(ends - middle).T)
    furthest = float(np.quantile(away, COUNTED))
    across = max(spec.width, spec.height, 2.0 * furthest / spec.resolution_m)
    block = max(LEAST_CELLS, math.ceil(across / MOST_BLOCKS))
    cell = block * spec.resolution_m
    radius = max(float(np.sqrt(np.mean(away**2))), cell)
    step = min(cell / radius, math.pi)
    # Many ends in one cell say what one says.
    ends = (ends[away <= furthest] - middle) / cell
    ends = np.unique(np.round(ends), axis=0)
    corner = (np.array([spec.origin_x_m, spec.origin_y_m]) - middle) / cell
    field = _Field(_counting(grid_map, block), corner, math.ceil(furthest / cell) + 1)
    turns = min(math.ceil(turn_rad / step - 1e-9), math.floor(math.pi / step))
    found = [
        (score, cell * x, cell * y, k * step)
        for k in range(-turns, turns + 1)
        for score, x, y in field.matches(ends, k * step, reach_m / cell)
    ]
    ordered = np.array(sorted(found, reverse=True)).reshape(-1, 4)
    kept: list[Float64Array] = []
    for one in ordered[:, 1:]:
        if all(_apart(one - other, APART * cell, APART * step) for other in kept):
            kept.append(one)
        if len(kept) == most:
            break
    return WallMatches(np.array(kept).reshape(-1, 3), cell, step)


def _apart(off: Float64Array, far_m: float, far_rad: float) -> bool:
    turn = abs((off[2] + math.pi) % (2.0 * math.pi) - math.pi)
    return bool(math.hypot(off[0], off[1]) > far_m or turn > far_rad)


def _counting(grid_map: GridMap, block: int) -> Float64Array:
    """Return what an end in each coarse cell (H, W) counts for; unknown cells: nothing."""
    highest = grid_map.probability
    for axis, size in enumerate(highest.shape):
        highest = np.fmax.reduceat(highest, np.arange(0, size, block), axis=axis)
    known = np.isfinite(highest)
    height, width = known.shape
    wall = np.nan_to_num(highest).astype(np.float64)
    wall[wall < WALL] = 0.0
    around = np.pad(wall, 1)
    beside = np.max(
        [around[r : r + height, c : c + width] for r in range(3) for c in range(3)], axis=0
    )
    counting: Float64Array = np.maximum(wall, BESIDE * beside)
    counting[known & (counting == 0.0)] = IN_FREE
    return counting


class _Field:
    """A field (H, W) that ends are laid over; lengths in coarse cells from the middle of the ends.

    corner  (2,) where the corner of the field is; half: no end is further from the middle
    """

    def __init__(self, field: Float64Array, corner: Float64Array, half: int) -> None:
        self.corner, self.half = corner, half
        rows, columns = field.shape
        size = 2 * half + 1
        self.shape = (_fast_size(rows + size), _fast_size(columns + size))
        self.transformed = np.fft.rfft2(field, self.shape)
        # Of the middle in the field, all cells from which an end may reach it.
        self.rows, self.columns = np.arange(-half, rows + half), np.arange(-half, columns + half)

    def matches(
        self, ends: Float64Array, turn: float, reach: float
    ) -> list[tuple[float, float, float]]:
        """Return what some places count with the map turned, and its shift then: score, x, y."""
        cosine, sine = math.cos(turn), math.sin(turn)
        # Turning the map forward is turning the ends back.
        column = np.round(cosine * ends[:, 0] + sine * ends[:, 1]).astype(np.int64) + self.half
        row = np.round(cosine * ends[:, 1] - sine * ends[:, 0]).astype(np.int64) + self.half
        image = np.zeros((2 * self.half + 1, 2 * self.half + 1))
        image[row, column] = 1.0
        product = self.transformed * np.conj(np.fft.rfft2(image, self.shape))
        # Of a shift: the middle of the image comes to lie half an image further.
        shifts = np.ix_(
            (self.rows - self.half) % self.shape[0], (self.columns - self.half) % self.shape[1]
        )
        counted = np.fft.irfft2(product, self.shape)[shifts]
        # The place in the field that comes to lie on the middle, from the middle.
        x, y = self.corner[0] + self.columns + 0.5, self.corner[1] + self.rows + 0.5
        if reach > 0.0:
            near = np.hypot(x, y[:, np.newaxis]) <= reach + 1.0
            counted = np.where(near, counted, -np.inf)
        return [
            (
                float(counted[r, c]) / len(ends),
                -(cosine * x[c] - sine * y[r]),
                -(sine * x[c] + cosine * y[r]),
            )
            for r, c in _peaks(counted)
        ]


def _peaks(values: Float64Array) -> list[tuple[int, int]]:
    """Return the row and column of some of the highest values, not beside each other."""
    around = OF_ONE_TURN * (2 * APART + 1) ** 2
    flat = values.ravel()
    highest = (
        np.argpartition(flat, -around)[-around:] if flat.size > around else np.arange(flat.size)
    )
    kept: list[tuple[int, int]] = []
    for at in highest[np.argsort(-flat[highest], kind='stable')]:
        row, column = divmod(int(at), values.shape[1])
        if len(kept) == OF_ONE_TURN or flat[at] == -np.inf:
            break
        if all(max(abs(row - r), abs(column - c)) > APART for r, c in kept):
            kept.append((row, column))
    return kept


def _fast_size(least: int) -> int:
    """Return the size from `least` on that is a power of two times one of `ODD_FACTORS`."""
    return min(factor << max(0, math.ceil(math.log2(least / factor))) for factor in ODD_FACTORS)
