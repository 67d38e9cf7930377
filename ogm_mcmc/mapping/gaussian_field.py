"""A Gaussian random field over cells, recursively and as one linear system ([field] III)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ogm_mcmc.arrays import AnyArray, Float32Array, Float64Array, Int64Array
from ogm_mcmc.config import RandomFieldConfig
from ogm_mcmc.errors import GridError, require
from ogm_mcmc.mapping.gaussian_field_kernels import predict, take_in

__all__ = [
    'FieldArrays',
    'GaussianField',
    'Prediction',
    'covariance',
    'dropped_mass',
    'solve_field',
    'stencil_radius',
]

Int32Array = npt.NDArray[np.int32]

MAX_ROWS = 2**31 - 1

# A covariance of a point with a cell that is as good as none.
NOTHING = 1e-14


class FieldArrays(NamedTuple):
    """What the kernels work on; D is described there.

    `mean` (height, width): l; `taken` (height, width): observations taken in, nan elsewhere;
    `row_of` (height, width): the row of D a cell has, -1 for none yet; `rows`
    (n, R + 1, 2 R + 1); `start` (R + 1, 2 R + 1): rows of K, as D begins; `used` (1,): rows used.
    """

    mean: Float64Array
    taken: Float32Array
    row_of: Int32Array
    rows: Float64Array
    start: Float64Array
    used: Int64Array


class Prediction(NamedTuple):
    """Posterior mean and variance of a field, nats: cells (height, width), or points (N,)."""

    mean: Float64Array
    variance: Float64Array


def covariance(squared_distance: AnyArray, length_scale: float) -> Float64Array:
    """C = exp(-d^2 / (2 l)), d in cells ([field] Eq. 11: l is not squared)."""
    values: Float64Array = np.exp(-np.asarray(squared_distance, np.float64) / (2.0 * length_scale))
    return values


def stencil_radius(config: RandomFieldConfig) -> int:
    """How many cells away along a row the covariance is still at least `drop`."""
    return math.floor(math.sqrt(-2.0 * config.length_scale * math.log(config.drop)))


def dropped_mass(config: RandomFieldConfig) -> float:
    """Sum of the covariances that one cell has with all cells outside of its stencil.

    Without them K may have eigenvalues that are lower by up to this.
    """
    farthest = math.ceil(20.0 * math.sqrt(config.length_scale)) + 1
    line = covariance(np.arange(-farthest, farthest + 1) ** 2, config.length_scale)
    radius = stencil_radius(config)
    kept = float(line[farthest - radius : farthest + radius + 1].sum())
    return float(line.sum()) ** 2 - kept**2


def solve_field(observed: AnyArray, config: RandomFieldConfig) -> Prediction:
    """Solve the whole field at once, nothing dropped; for small fields ([field] Eq. 21).

    observed  (height, width) nats, nan where there is no observation
    With the n observations alone: l = mu + K_n (K_nn + sigma^2 I)^-1 (O - mu). This is Eq. 21
    written so that K, which is close to singular, need not be inverted.
    """
    height, width = observed.shape
    rows, columns = np.mgrid[:height, :width].reshape(2, -1)
    squared = (rows[:, None] - rows) ** 2 + (columns[:, None] - columns) ** 2
    prior = covariance(squared, config.length_scale)
    values = np.asarray(observed, np.float64).ravel()
    known = np.flatnonzero(~np.isnan(values))
    system = prior[np.ix_(known, known)] + config.variance * np.eye(known.size)
    gain = np.linalg.solve(system, prior[known]).T
    mean = config.mean + gain @ (values[known] - config.mean)
    variance = 1.0 - (gain * prior[:, known]).sum(axis=1)
    return Prediction(mean.reshape(height, width), variance.reshape(height, width))


class GaussianField:
    """The field, one observation at a time, with covariances kept within `radius` cells.

    With a radius of at least the longer side less 1 nothing is dropped, and mean and variance are
    those of `solve_field`, in whatever order observations come. Without a radius that of the
    config is taken; raises ConfigError when so much is dropped that K may be no covariance.
    """

    def __init__(
        self, height: int, width: int, config: RandomFieldConfig, radius: int | None = None
    ) -> None:
        self.config = config
        if radius is None:
            radius = stencil_radius(config)
            require(
                dropped_mass(config) < config.variance,
                'random_field.drop',
                config.drop,
                f'leaves out covariances of {dropped_mass(config):.2g} in all, which must be less '
                f'than random_field.variance ({config.variance:g}): expected a smaller one',
            )
        self.radius = radius
        up = np.arange(self.radius + 1)[:, None]
        right = np.arange(-self.radius, self.radius + 1)
        self._start = covariance(up**2 + right**2, config.length_scale)
        self.arrays = self._empty(height, width)

    def _empty(self, height: int, width: int) -> FieldArrays:
        return FieldArrays(
            np.full((height, width), self.config.mean, np.float64),
            np.full((height, width), np.nan, np.float32),
            np.full((height, width), -1, np.int32),
            np.empty((0, *self._start.shape)),
            self._start,
            np.zeros(1, np.int64),
        )

    def forget(self) -> None:
        """Forget all observations, but keep the extent and the memory."""
        self.arrays.mean.fill(self.config.mean)
        self.arrays.taken.fill(np.nan)
        self.arrays.row_of.fill(-1)
        self.arrays.used[0] = 0

    def grow(self, height: int, width: int, row0: int, column0: int) -> None:
        """Become part of a larger field, with cell (0, 0) at (row0, column0).

        No observation may lie within `radius` of a side that moves: it would have reached the
        cells beyond.
        """
        old = self.arrays
        new = self._empty(height, width)
        rows, columns = old.mean.shape
        inside = slice(row0, row0 + rows), slice(column0, column0 + columns)
        for name in ('mean', 'taken', 'row_of'):
            getattr(new, name)[inside] = getattr(old, name)
        self.arrays = new._replace(rows=old.rows, used=old.used)

    def observe(self, observed: AnyArray, row0: int = 0, column0: int = 0) -> None:
        """Take in every observation that is new or has changed, in a part of the field.

        observed  (h, w) nats, nan where there is none, its first cell at (row0, column0). A cell
        that was observed once stays observed. Raises GridError when the part is none of the
        field, and when D would have 2**31 rows.
        """
        values = np.ascontiguousarray(observed, np.float32)
        height, width = self.arrays.mean.shape
        rows, columns = values.shape
        if min(row0, column0) < 0 or row0 + rows > height or column0 + columns > width:
            raise GridError(
                f'observations {values.shape} from ({row0}, {column0}): '
                f'expected a part of {(height, width)}'
            )
        done = 0
        while done < rows:
            done = take_in(
                self.arrays,
                self.radius,
                float(self.config.variance),
                values,
                row0,
                column0,
                done,
            )
            if done < rows:
                self._make_room()

    def _make_room(self) -> None:
        """Make room for a row of D for as many cells again, at least for one observation."""
        held = self.arrays.rows.shape[0]
        most = self.arrays.mean.size + (2 * self.radius + 1) ** 2
        size = min(most, max(2 * held, 4 * (2 * self.radius + 1) ** 2))
        if size > MAX_ROWS:
            raise GridError(f'the random field would have {size} rows: expected up to {MAX_ROWS}')
        rows = np.empty((size, *self._start.shape))
        rows[:held] = self.arrays.rows
        self.arrays = self.arrays._replace(rows=rows)

    @property
    def mean(self) -> Float64Array:
        """Posterior mean (height, width), nats; do not modify."""
        return self.arrays.mean

    def variance(self, rows: slice = slice(None), columns: slice = slice(None)) -> Float64Array:
        """Posterior variance of a part; 1 where no observation reaches."""
        row_of = self.arrays.row_of[rows, columns]
        variance = np.ones(row_of.shape)
        reached = row_of >= 0
        variance[reached] = self.arrays.rows[row_of[reached], 0, self.radius]
        return np.maximum(variance, 0.0)

    def at(self, points: Float64Array) -> Prediction:
        """Predict at any points (N, 2): row and column, cells; 0.5 is the centre of cell 0.

        Returns mean and variance (N,). Equal to Eq. 21 of [field] with the points in it where no
        element is dropped; else off by what is dropped, the mean by up to 2 pi l / sigma^2 times
        as much as at cells.
        """
        mean, variance = np.empty(len(points)), np.empty(len(points))
        reach = math.sqrt(-2.0 * self.config.length_scale * math.log(NOTHING))
        predict(
            self.arrays,
            self.radius,
            float(self.config.variance),
            float(self.config.mean),
            float(self.config.length_scale),
            reach,
            np.ascontiguousarray(points, np.float64),
            mean,
            variance,
        )
        return Prediction(mean, np.clip(variance, 0.0, 1.0))

    @property
    def n_bytes(self) -> int:
        """Memory in use."""
        used = int(self.arrays.used[0])
        cells = sum(array.nbytes for array in self.arrays[:3])
        return cells + used * self._start.nbytes
