"""The benchmark of a recorded building under the rays of its experiments ([patch] Fig. 9)."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, UInt8Array
from ogm_mcmc.geometry import CellBox, PlacedScan
from ogm_mcmc.lab.experiments.hardware_sets import (
    HardwareSet,
    benchmark_of,
    split,
    window_box,
)
from ogm_mcmc.plotting import kinds_png

__all__ = ['benchmark_with_rays', 'first_cells']

# Every ray is drawn over its first cells only; else nothing of the map would be left.
DRAWN_CELLS = 10

# Free, occupied; from the experiment with the most measurements to that with the fewest.
COLOURS = ((255, 255, 255), (0, 0, 0), (0, 160, 0), (220, 0, 0), (0, 0, 230))


def benchmark_with_rays(of: HardwareSet, scans: list[PlacedScan], resolution_m: float) -> bytes:
    """Draw occupied cells black, the first cells of used rays in the colour of the sparsest.

    Rays that the last experiment uses are blue, more of the second red, more of the first green.
    """
    box = window_box(of, scans, resolution_m)
    kinds: UInt8Array = benchmark_of(scans, box, resolution_m).occupied.astype(np.uint8)
    for place, number in enumerate(sorted(of.pose_strides)):
        rows, columns = first_cells(split(of, scans, number).used, box, resolution_m)
        kinds[rows, columns] = 2 + place
    return kinds_png(kinds, COLOURS)


def first_cells(
    scans: list[PlacedScan], box: CellBox, resolution_m: float
) -> tuple[AnyArray, AnyArray]:
    """Return rows and columns in a box of the cells at the beginning of every returned beam."""
    rows, columns = [], []
    along = np.arange(0.0, DRAWN_CELLS, 0.5) * resolution_m
    for scan, belief in scans:
        pose = belief.mean
        bearings = np.arange(scan.ranges_m.size) * scan.angle_increment_rad
        angles = pose.yaw_rad + scan.angle_min_rad + bearings
        with np.errstate(invalid='ignore'):
            beams, steps = np.nonzero(
                np.isfinite(scan.ranges_m)[:, np.newaxis] & (along <= scan.ranges_m[:, np.newaxis])
            )
        x = pose.x_m + along[steps] * np.cos(angles[beams])
        y = pose.y_m + along[steps] * np.sin(angles[beams])
        column = np.floor(x / resolution_m).astype(np.int64) - box.column0
        row = np.floor(y / resolution_m).astype(np.int64) - box.row0
        inside = (column >= 0) & (column < box.column1 - box.column0)
        inside &= (row >= 0) & (row < box.row1 - box.row0)
        rows.append(row[inside])
        columns.append(column[inside])
    return np.concatenate(rows), np.concatenate(columns)
