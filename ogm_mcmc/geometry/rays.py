"""Scan + pose of the sensor -> rays on the lattice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array, UInt8Array
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry.grid_spec import CellBox, GridSpec
from ogm_mcmc.geometry.pose import Pose2D
from ogm_mcmc.geometry.scan import Scan
from ogm_mcmc.geometry.traversal_kernels import beam_ends, sampled_beam_ends

__all__ = ['Rays', 'SampledRays', 'cast_rays', 'cast_sampled_rays', 'on_lattice', 'usable_range']

# The fixed-point traversal keeps 23 bits for whole columns; a ray takes 18 at most, so that an
# array of 2**22 columns always has room. A sensor must be near enough to the anchor that the
# fraction inside its cell is known.
MAX_RAY_CELLS = 2**18
MAX_LATTICE_CELLS = 2**40


class Rays(NamedTuple):
    """N segments from one sensor, in cells relative to the corner of the sensor's cell.

    `column`, `row`: that cell in lattice coordinates; `x`, `y` in [0, 1): the sensor in it;
    `ends` (2, >= N) float64: end points; `hit` (>= N,) uint8: 1 where the ray ended at something;
    `n_rays` N; `box`: all cells any ray touches, in lattice coordinates.
    """

    column: int
    row: int
    x: float
    y: float
    ends: Float64Array
    hit: UInt8Array
    n_rays: int
    box: CellBox


def cast_rays(
    scan: Scan,
    sensor: Pose2D,
    spec: GridSpec,
    *,
    max_range_m: float = 0.0,
    no_return_clears: bool = True,
) -> Rays:
    """Place a scan; readings that say nothing (REP 117) make no ray.

    `max_range_m` above 0 limits how far beams are used: longer readings clear up to it.
    `no_return_clears` says whether +inf does.
    Raises GridError when a ray is longer than 2**18 cells or the sensor absurdly far away.
    """
    reach = usable_range(scan, spec, max_range_m)
    column, row, x, y = on_lattice(sensor, spec)
    ends = np.empty((2, scan.ranges_m.size))
    hit = np.empty(scan.ranges_m.size, np.uint8)
    count, left, bottom, right, top = beam_ends(
        scan.ranges_m,
        scan.directions(),
        math.cos(sensor.yaw_rad),
        math.sin(sensor.yaw_rad),
        x,
        y,
        1.0 / spec.resolution_m,
        scan.range_min_m,
        scan.range_max_m,
        reach,
        no_return_clears,
        ends,
        hit,
    )
    box = CellBox(column + left, row + bottom, column + right + 1, row + top + 1)
    return Rays(column, row, x, y, ends, hit, count, box)


def usable_range(scan: Scan, spec: GridSpec, max_range_m: float) -> float:
    """Return how far beams are used, m; raises GridError when that is 2**18 cells or more.

    A sensor that names no range_max (inf) needs `max_range_m`.
    """
    reach = scan.range_max_m
    if max_range_m > 0.0:
        reach = float(min(reach, max_range_m))
    if reach == math.inf:
        raise GridError('range_max is inf: expected a finite one; set max_range')
    if reach / spec.resolution_m >= MAX_RAY_CELLS:
        raise GridError(
            f'range {reach:g} m is {reach / spec.resolution_m:.3g} cells of '
            f'{spec.resolution_m:g} m: expected fewer than {MAX_RAY_CELLS}; set max_range'
        )
    return reach


def on_lattice(sensor: Pose2D, spec: GridSpec) -> tuple[int, int, float, float]:
    """Return the cell (column, row) a sensor is in, and where in it (x, y in [0, 1)).

    Raises GridError when the sensor is absurdly far away.
    """
    cells_per_m = 1.0 / spec.resolution_m
    sensor_x = (sensor.x_m - spec.anchor_x_m) * cells_per_m
    sensor_y = (sensor.y_m - spec.anchor_y_m) * cells_per_m
    if abs(sensor_x) >= MAX_LATTICE_CELLS or abs(sensor_y) >= MAX_LATTICE_CELLS:
        raise GridError(f'pose ({sensor.x_m:g}, {sensor.y_m:g}): too far from the map to place')
    column, row = math.floor(sensor_x), math.floor(sensor_y)
    x, y = sensor_x - column, sensor_y - row
    # The tiniest negative numbers are a whole cell above their floor, in floating point.
    if x == 1.0:
        column, x = column + 1, 0.0
    if y == 1.0:
        row, y = row + 1, 0.0
    return column, row, x, y


class SampledRays(NamedTuple):
    """The rays of one scan from M samples of its pose, each as `Rays` has them.

    `cells` (M, 2) int64: the sensors' cells in lattice coordinates; `places` (M, 2): the sensors
    in them; `ends` (M, 2, B), `hit` (B,), `n_rays`: of every sample the same readings; `boxes`
    (M, 4) int64: the cells the rays of a sample touch, upper ends excluded; `box`: of all.
    """

    cells: Int64Array
    places: Float64Array
    ends: Float64Array
    hit: UInt8Array
    n_rays: int
    boxes: Int64Array
    box: CellBox


def cast_sampled_rays(
    scan: Scan,
    poses: Float64Array,
    spec: GridSpec,
    *,
    max_range_m: float = 0.0,
    no_return_clears: bool = True,
) -> SampledRays:
    """Place a scan at each pose (M, 3); sample by sample the same as `cast_rays`."""
    reach = usable_range(scan, spec, max_range_m)
    count, beams = poses.shape[0], scan.ranges_m.size
    cells = np.empty((count, 2), np.int64)
    placed = np.empty((count, 4))
    # The functions of `cast_rays`, because another library's cosine may round otherwise.
    for k, (x_m, y_m, yaw_rad) in enumerate(poses.tolist()):
        column, row, x, y = on_lattice(Pose2D(x_m, y_m, yaw_rad), spec)
        cells[k] = column, row
        placed[k] = x, y, math.cos(yaw_rad), math.sin(yaw_rad)
    ends = np.empty((count, 2, beams))
    hit = np.empty(beams, np.uint8)
    boxes = np.empty((count, 4), np.int64)
    n_rays = sampled_beam_ends(
        scan.ranges_m,
        scan.directions(),
        cells,
        placed,
        1.0 / spec.resolution_m,
        scan.range_min_m,
        scan.range_max_m,
        reach,
        no_return_clears,
        ends,
        hit,
        boxes,
    )
    low, high = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    places = np.ascontiguousarray(placed[:, :2])
    return SampledRays(cells, places, ends, hit, n_rays, boxes, CellBox(*low, *high))
