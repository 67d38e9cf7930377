"""The log-odds map as a Gaussian random field: predicts unmeasured cells ([field])."""

from __future__ import annotations

import contextlib

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.mapping.extras import Extras
from ogm_mcmc.mapping.gaussian_field import GaussianField, Prediction, stencil_radius
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = ['RandomFieldMapper']

# More boxes than this are joined into one; going through unchanged cells costs little.
MAX_STALE_BOXES = 16


class RandomFieldMapper:
    """Observations are the log-odds of the two-assumption map; the field is what is shown.

    Scans go into the two-assumption map at once, and into the field when the map is next read:
    what counts is the last value of each cell, however many scans it took. With `radius` the
    covariances of cells up to so many apart are kept, instead of those that `drop` leaves.
    """

    def __init__(self, config: MapperConfig, *, radius: int | None = None) -> None:
        self.config = config
        self.radius = radius
        self.settings = config.random_field
        self.observed = TwoAssumptionMapper(config)
        self._start()

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; the ones that are fixed at start are as before."""
        self.config = config
        self.observed.configure(config)

    def _start(self) -> None:
        spec = self.observed.spec
        self.field = self._new_field(spec)
        self._field_spec = spec
        self._stale: list[CellBox] = []

    def _new_field(self, spec: GridSpec) -> GaussianField:
        radius = stencil_radius(self.settings) if self.radius is None else self.radius
        return GaussianField(
            spec.height + 2 * radius, spec.width + 2 * radius, self.settings, self.radius
        )

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie."""
        return self.observed.spec

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan; see `MappingMethod.update`. The box is wider than what was measured."""
        seen = self.observed.update(placed)
        if seen.empty:
            return seen
        # What was measured may have room, though not all that is predicted.
        with contextlib.suppress(GridError):
            self.observed.grid.cover(_widened(seen, self.field.radius))
        self._mark(seen)
        return _widened(seen, self.field.radius).intersection(self.spec.box)

    def _mark(self, box: CellBox) -> None:
        if self._stale and self._stale[-1].union(box).n_cells <= 2 * box.n_cells:
            self._stale[-1] = self._stale[-1].union(box)
        elif len(self._stale) < MAX_STALE_BOXES:
            self._stale.append(box)
        else:
            for other in self._stale:
                box = box.union(other)
            self._stale = [box]

    def _refresh(self) -> GaussianField:
        """Bring the field up to date with the observations."""
        spec, before = self.observed.spec, self._field_spec
        if spec != before:
            if spec.box.covers(before.box):
                radius = self.field.radius
                self.field.grow(
                    spec.height + 2 * radius,
                    spec.width + 2 * radius,
                    before.row0 - spec.row0,
                    before.column0 - spec.column0,
                )
            else:
                # The first scan puts the map where it belongs; nothing is known so far.
                self.field = self._new_field(spec)
            self._field_spec = spec
        stale, self._stale = self._stale, []
        for box in stale:
            rows, columns = self._slices(box)
            self.field.observe(self.observed.log_odds(box), rows.start, columns.start)
        return self.field

    def _slices(self, box: CellBox) -> tuple[slice, slice]:
        """Return (rows, columns) of a box in the field, which is wider than the map.

        That way every cell an observation reaches is in it.
        """
        radius = self.field.radius
        return self._field_spec.windowed(_widened(self._field_spec.box, radius)).slices(box)

    def log_odds(self, box: CellBox) -> Float64Array:
        """Predicted log-odds in nats for each cell of a box, measured or not."""
        return self._refresh().mean[self._slices(box)].copy()

    def variance(self, box: CellBox) -> Float64Array:
        """Variance of the log-odds, where 1 is that of a cell far from anything measured."""
        return self._refresh().variance(*self._slices(box))

    def at(self, points_m: Float64Array) -> Prediction:
        """Log-odds and their variance (N,) at any points (N, 2) of the map frame, m.

        [field] III: points need not be chosen at regular distances. Far from all that was
        measured they are those of the field before any observation.
        """
        field, spec = self._refresh(), self.observed.spec
        corner = np.array([spec.column0 - field.radius, spec.row0 - field.radius])
        return field.at((points_m / spec.resolution_m - corner)[:, ::-1])

    def extras(self, box: CellBox) -> Extras:
        """Return the variance of every cell."""
        return Extras(layers={'variance': self.variance(box)})

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied; nan where neither measured nor predicted."""
        log_odds, variance = self.log_odds(box), self.variance(box)
        with np.errstate(over='ignore'):
            probability = (1.0 / (1.0 + np.exp(-log_odds))).astype(np.float32)
        measured = ~np.isnan(self.observed.log_odds(box))
        probability[~measured & ~(variance <= self.settings.max_variance)] = np.nan
        # With `max_variance` 1 every cell would pass for predicted.
        probability[variance >= 1.0] = np.nan
        return probability

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        self.observed.reset()
        self._start()

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        self.observed.forget_cells()
        self.field.forget()
        self._stale = []


def _widened(box: CellBox, by: int) -> CellBox:
    return CellBox(box.column0 - by, box.row0 - by, box.column1 + by, box.row1 + by)
