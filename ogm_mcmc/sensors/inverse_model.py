"""Inverse sensor models: the log-odds l(m | z) of a cell, given one reading.

Each model is what the mappers are configured with, and a plain function of NumPy arrays for
plots and tests; the mappers run the kernels beside it. All log-odds are relative to the prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import GaussianModelConfig, MapperConfig, SonarModelConfig

__all__ = [
    'BeamModel',
    'GaussianInverseModel',
    'SonarInverseModel',
    'beam_model',
]

# Behind the wall the Gaussian model returns to 1/2; from here on, in sigmas, it says less than
# 0.003 nats.
SIGMAS_BEHIND = 3.0


# Across 100 m a hundredth of a millimetre.
THINNEST_RAD = 1e-7


@dataclass(frozen=True)
class GaussianInverseModel:
    """The step smoothed by the noise of the range ([pose] Eq. 4).

    The ideal sensor says 0 in front, 1 within `width_m` around the reading and 1/2 behind.
    Convolved with N(0, sigma^2) that is g(r) = Phi(a) - Phi(b) / 2 with
    a = (r - z + width / 2) / sigma and b = (r - z - width / 2) / sigma.

    Deviation: Eq. 4 as printed is this function shifted by z (at z = 2 and sigma = width = 0.3
    its value at r = 4 is the 0.537 that belongs to r = 2). g tends to 0 in front, where the
    log-odds would be without bound: `l_min` is their floor, `l_max` the ceiling.
    sigma may grow with the range: sigma + sigma_growth * z^2, for stereo 1 / (b f) of [pose] IV.

    A sigma much larger than the width smears a wall so far that no cell becomes likelier
    than 1/2: choose the width with it.
    """

    config: GaussianModelConfig
    resolution_m: float

    @property
    def width_m(self) -> float:
        """Depth that a reading declares occupied, m."""
        return self.config.width or math.sqrt(2.0) * self.resolution_m

    def sigma_m(self, reading_m: float) -> float:
        """Return the standard deviation of a reading, m."""
        return self.config.sigma + self.config.sigma_growth * reading_m**2

    def probability(self, distance_m: Float64Array, reading_m: float) -> Float64Array:
        """g(r), without floor and ceiling."""
        sigma = self.sigma_m(reading_m)
        offset = np.asarray(distance_m, np.float64) - reading_m
        erf = np.vectorize(math.erf, otypes=[np.float64])
        front = 0.5 + 0.5 * erf((offset + 0.5 * self.width_m) / (math.sqrt(2.0) * sigma))
        back = 0.5 + 0.5 * erf((offset - 0.5 * self.width_m) / (math.sqrt(2.0) * sigma))
        values: Float64Array = front - 0.5 * back
        return values

    def log_odds(self, distance_m: Float64Array, reading_m: float) -> Float64Array:
        """Log-odds, nats, of cells at distances along the beam, any shape."""
        p = self.probability(distance_m, reading_m)
        with np.errstate(divide='ignore'):
            log_odds = np.log(p) - np.log1p(-p)
        values: Float64Array = np.clip(log_odds, self.config.l_min, self.config.l_max)
        return values


@dataclass(frozen=True)
class SonarInverseModel:
    """The cone of a sonar ([slides]): linear in the measured range, Gaussian across the angle.

    p = 1/2 + shape(r - z) * strength(z) * exp(-angle^2 / (2 sigma^2)). `strength` falls linearly
    from the sensor to its greatest range. `shape` is -1 in front of the echo, rises to +1 within
    half a `thickness`, stays there around the echo and falls to 0 one `thickness` behind it. (The
    slides show their shape in figures only; this one is ours.)
    """

    config: SonarModelConfig

    def strength(self, reading_m: float, range_max_m: float) -> float:
        """Return the most a probability moves away from 1/2, on the axis."""
        near, far = self.config.strength, self.config.strength_far
        return near + (far - near) * min(reading_m / range_max_m, 1.0)

    def sigma_rad(self, opening_angle_rad: float) -> float:
        """Return the standard deviation across the angle; a cone may be as thin as a line."""
        return max(0.5 * opening_angle_rad * self.config.sigma_share, THINNEST_RAD)

    def log_odds(
        self,
        distance_m: Float64Array,
        angle_rad: Float64Array,
        reading_m: float,
        range_max_m: float,
        opening_angle_rad: float,
    ) -> Float64Array:
        """Log-odds, nats, at distances and angles off the axis; 0 outside of the cone."""
        offset = (np.asarray(distance_m, np.float64) - reading_m) / self.config.thickness
        shape = np.interp(offset, (-1.0, -0.5, 0.5, 1.0), (-1.0, 1.0, 1.0, 0.0))
        off_axis = np.asarray(angle_rad, np.float64) / self.sigma_rad(opening_angle_rad)
        moved = shape * self.strength(reading_m, range_max_m) * np.exp(-0.5 * off_axis**2)
        inside = np.abs(angle_rad) <= 0.5 * opening_angle_rad
        values: Float64Array = np.where(inside, np.log((0.5 + moved) / (0.5 - moved)), 0.0)
        return values


class BeamModel(NamedTuple):
    """An inverse model of narrow beams as the kernels take it.

    `l_free`: in front, where the model is flat; `l_occ`: step: of the end cell, gaussian: ceiling.
    In cells: sigma = `sigma` + `growth` * range^2. From `sigmas_before` in front of the occupied
    width to `sigmas_behind` behind it the model is evaluated. `gaussian` False: only the end cell.
    """

    gaussian: bool
    l_free: np.float32
    l_occ: np.float32
    sigma: float
    growth: float
    half_width: float
    sigmas_before: float
    sigmas_behind: float


def beam_model(config: MapperConfig) -> BeamModel:
    """Return the inverse model a configuration names, in cells."""
    if config.inverse_model == 'step':
        step = config.step
        return BeamModel(
            False, np.float32(step.l_free), np.float32(step.l_occ), 1.0, 0.0, 0.0, 0.0, 0.0
        )
    chosen = GaussianInverseModel(config.gaussian, config.resolution)
    low = config.gaussian.l_min
    # So far in front of the width, Phi(a) alone is below the floor already.
    before = -NormalDist().inv_cdf(1.0 / (1.0 + math.exp(-low)))
    return BeamModel(
        True,
        np.float32(low),
        np.float32(config.gaussian.l_max),
        float(config.gaussian.sigma / config.resolution),
        float(config.gaussian.sigma_growth * config.resolution),
        float(0.5 * chosen.width_m / config.resolution),
        before,
        SIGMAS_BEHIND,
    )
