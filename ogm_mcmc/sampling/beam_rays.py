"""Scans as rays of a window: where each begins, its direction, how far it is followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.config import WindowConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.geometry.rays import on_lattice, usable_range
from ogm_mcmc.geometry.slants import slants_of
from ogm_mcmc.sampling.ray_filing_kernels import nearest_of
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['BeamRays', 'limited', 'most_cells', 'most_near_cells', 'rays_of_scan']

# A place on a ray has 16 bits.
MAX_POSITIONS = 65_000

# Rays end so far inside of the limits of a window, cells: more than rounding takes them outside.
RIM = 1e-6

# Grazing makes readings err by so many cells at most.
MOST_GRAZED = 4.0


class BeamRays(NamedTuple):
    """N rays (all arrays (N,)): sensor cell `column`, `row`, the sensor in it at `x`, `y`;
    direction `ux`, `uy`; `length` in cells; `reading` and `reach` in m, reading inf for none;
    `sigma`: standard deviation of the reading, m.

    Lines alone, which say nothing yet, have readings nan and in `reach` from where on the
    likelihoods that come will vary.
    """  # noqa: D205

    column: AnyArray
    row: AnyArray
    x: Float64Array
    y: Float64Array
    ux: Float64Array
    uy: Float64Array
    length: Float64Array
    reading: Float64Array
    reach: Float64Array
    sigma: Float64Array


def rays_of_scan(
    placed: PlacedScan, config: WindowConfig, sigma_m: float, grazing_m: float = 0.0
) -> BeamRays:
    """Return the rays of a scan, followed as far as the configuration says.

    `sigma_m`: of readings of what is met square; `grazing_m`: surfaces are off, across themselves.
    Raises GridError for a ray that is too long.
    """
    scan, sensor = placed.thinned(config.beam_stride).scan, placed.pose
    spec = GridSpec(config.resolution, 1, 1)
    reach = usable_range(scan, spec, config.max_range)
    column, row, x, y = on_lattice(sensor, spec)
    used = scan.informative(no_return_clears=config.no_return == 'clear')
    n = int(np.count_nonzero(used))
    reading = scan.ranges_m[used].astype(np.float64)
    ahead, left = scan.directions()[:, used]
    cosine, sine = np.cos(sensor.yaw_rad), np.sin(sensor.yaw_rad)
    hit = reading <= reach
    sigma = np.full(n, sigma_m)
    if grazing_m > 0.0:
        # Of all beams, those that are left out here too: they tell what there is beside these.
        slants = slants_of(placed.scan, config.resolution)[:: config.beam_stride][used]
        sigma = np.hypot(sigma, np.minimum(grazing_m * slants, MOST_GRAZED * config.resolution))
    length = np.full(n, reach / config.resolution)
    if config.cut_sigma > 0.0:
        behind = (reading + config.cut_sigma * sigma) / config.resolution
        length[hit] = np.minimum(length, behind)[hit]
    if n and length.max() * 2.0 > MAX_POSITIONS:
        raise GridError(
            f'a ray of {length.max():.0f} cells: expected at most {MAX_POSITIONS // 2}; '
            'set max_range'
        )
    return BeamRays(
        np.full(n, column),
        np.full(n, row),
        np.full(n, x),
        np.full(n, y),
        ahead * cosine - left * sine,
        ahead * sine + left * cosine,
        length,
        np.where(hit, reading, np.inf),
        np.full(n, reach),
        sigma,
    )


def limited(rays: BeamRays, box: CellBox, resolution: float) -> BeamRays:
    """Return the rays of one scan as a sensor sees them that reaches to the rim of a box."""
    if not rays.length.size:
        return rays
    column, row = int(rays.column[0]), int(rays.row[0])
    if not (box.column0 <= column < box.column1 and box.row0 <= row < box.row1):
        return BeamRays(*(array[:0] for array in rays))
    with np.errstate(divide='ignore', invalid='ignore'):
        side = np.where(rays.ux > 0.0, box.column1 - column, box.column0 - column)
        up_to = np.where(rays.uy > 0.0, box.row1 - row, box.row0 - row)
        to_side = np.where(rays.ux == 0.0, np.inf, (side - rays.x) / rays.ux)
        to_end = np.where(rays.uy == 0.0, np.inf, (up_to - rays.y) / rays.uy)
    rim = np.maximum(np.minimum(to_side, to_end) - RIM, 0.0)
    reach = np.minimum(rays.reach, np.maximum(rim, RIM) * resolution)
    return rays._replace(
        length=np.minimum(rays.length, rim),
        reading=np.where(rays.reading <= reach, rays.reading, np.inf),
        reach=reach,
    )


def most_cells(rays: BeamRays) -> AnyArray:
    """Return how many cells each ray crosses at most."""
    across = np.abs(np.floor(rays.x + rays.length * rays.ux) - np.floor(rays.x))
    up = np.abs(np.floor(rays.y + rays.length * rays.uy) - np.floor(rays.y))
    cells: AnyArray = (across + up).astype(np.int64) + 1
    return cells


def most_near_cells(rays: BeamRays, model: ForwardModel, resolution: float) -> AnyArray:
    """Return how many cells there are at most from where each ray's likelihood is not level."""
    if not rays.length.size:
        return np.zeros(0, np.int64)
    if np.isnan(rays.reading).any():
        length = rays.length - np.maximum(rays.reach, 0.0) / resolution
    else:
        nearest = np.empty(rays.length.size)
        nearest_of(model, rays.reading, rays.reach, rays.sigma, nearest)
        near_to = np.minimum(rays.reading, rays.reach)
        length = np.maximum(rays.length * resolution, near_to) - nearest
        length /= resolution
    with np.errstate(invalid='ignore'):
        cells = (length + 1.5) * (np.abs(rays.ux) + np.abs(rays.uy)) + 3.0
    most: AnyArray = np.minimum(cells, 2.0**40).astype(np.int64)
    return most
