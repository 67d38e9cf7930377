"""The Intel Research Lab as [patch] section IV uses it: benchmark, experiments, what is left.

Every beam of 910 poses makes the benchmark. Experiment 1 takes every second beam of all poses,
2 of every second pose, 3 of every tenth pose (Table III). What an experiment does not take is
held out. Log recorded by Dirk Haehnel (Radish, CC-BY).
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import near
from ogm_mcmc.experiments.windows import method_in
from ogm_mcmc.geometry import CellBox, GridMap, GridSpec, Pose2D, PoseBelief, Scan
from ogm_mcmc.io.carmen import LogScan, read_carmen
from ogm_mcmc.mapping import make_method

__all__ = [
    'CELL_PRIOR',
    'POSE_STRIDES',
    'RANGE_MAX_M',
    'THRESHOLD',
    'Benchmark',
    'Placed',
    'Split',
    'benchmark_of',
    'data_folder',
    'read_intel',
    'split',
    'traditional_map',
    'window_box',
    'without_beams_that_leave',
]

LOG = Path('intel') / 'intel.gfs.log'

# Readings of a SICK in centimetre mode from here on are codes for "nothing".
NO_RETURN_M, RANGE_MAX_M = 81.8, 80.0

# The middle between the outer walls, and how far the window reaches ([patch] Table III).
CENTRE_M, SIDE_M = (4.05, -8.8), 30.0

# p(occupied) of the patches of [patch], and where it thresholds its benchmark and its start.
CELL_PRIOR, THRESHOLD = 0.234, 0.20

# Cells that count lie so near to one that the benchmark measured.
NEAR_CELLS = 10

# By number of the experiment: every so many-th pose; of its beams every second one.
POSE_STRIDES = {1: 1, 2: 2, 3: 10}
BEAM_STRIDE = 2

Placed = list[tuple[Scan, Pose2D]]


class Split(NamedTuple):
    """Placed scans that an experiment uses, and the beams that it does not."""

    used: Placed
    held_out: Placed


class Benchmark(NamedTuple):
    """`occupied` and `counted` (H, W) of the window; `mapped` and `near` shares of its cells."""

    occupied: BoolArray
    counted: BoolArray
    mapped_share: float
    near_share: float


def data_folder() -> Path:
    """Return the folder of the recorded logs; raises ConfigError where the log is not in it."""
    folder = Path(os.environ.get('OGM_MCMC_DATA', '../shared/data'))
    if not (folder / LOG).is_file():
        raise ConfigError(
            f'{folder / LOG}: no such file; expected OGM_MCMC_DATA to name a folder with {LOG}'
        )
    return folder


def read_intel(folder: Path) -> list[LogScan]:
    """Read the 910 scans with corrected poses of the laser."""
    return read_carmen(folder / LOG).scans


def as_scan(logged: LogScan, first: int = 0, stride: int = 1) -> Scan:
    """Return every `stride`-th beam of a line of the log, from `first` on, as REP 117 has it."""
    ranges_m = logged.ranges_m[first::stride]
    return Scan.checked(
        np.where(ranges_m >= NO_RETURN_M, np.inf, ranges_m),
        angle_min_rad=logged.start_angle_rad + first * logged.increment_rad,
        angle_increment_rad=logged.increment_rad * stride,
        range_min_m=0.0,
        range_max_m=RANGE_MAX_M,
    )


def split(logs: Sequence[LogScan], number: int) -> Split:
    """Return what experiment 1, 2 or 3 uses and what it leaves."""
    used, held_out = [], []
    for k, logged in enumerate(logs):
        if k % POSE_STRIDES[number] == 0:
            used.append((as_scan(logged, 0, BEAM_STRIDE), logged.laser_pose))
            held_out.append((as_scan(logged, 1, BEAM_STRIDE), logged.laser_pose))
        else:
            held_out.append((as_scan(logged), logged.laser_pose))
    return Split(used, held_out)


def window_box(resolution_m: float) -> CellBox:
    """Return the window of 30 m x 30 m in lattice cells."""
    cells = round(SIDE_M / resolution_m)
    column, row = (round((middle - 0.5 * SIDE_M) / resolution_m) for middle in CENTRE_M)
    return CellBox(column, row, column + cells, row + cells)


def traditional_map(scans: Placed, resolution_m: float) -> GridMap:
    """Map scans as [patch] section II does: beam by beam, independent cells; in the window.

    Beams without a return say nothing: with them 77 % of the cells would be mapped, not the 60 %
    of Table III.
    """
    method = make_method(
        MapperConfig(
            fusion='per_beam', resolution=resolution_m, prior=CELL_PRIOR, no_return='ignore'
        )
    )
    for scan, pose in scans:
        method.update(scan, PoseBelief(pose))
    box = window_box(resolution_m)
    return GridMap(GridSpec(resolution_m, 1, 1).windowed(box), method_in(method, box))


def benchmark_of(logs: Sequence[LogScan], resolution_m: float) -> Benchmark:
    """Threshold the map of every beam at 0.20; unmapped cells, at 0.234, are occupied in it."""
    everything = [(as_scan(logged), logged.laser_pose) for logged in logs]
    probability = traditional_map(everything, resolution_m).probability
    mapped = np.isfinite(probability)
    counted = near(mapped, NEAR_CELLS)
    return Benchmark(
        np.nan_to_num(probability, nan=CELL_PRIOR) >= THRESHOLD,
        counted,
        float(mapped.mean()),
        float(counted.mean()),
    )


def without_beams_that_leave(scans: Placed, box: CellBox, resolution_m: float) -> Placed:
    """Return the scans with those readings made invalid that do not end inside of a box."""
    kept = []
    for scan, pose in scans:
        heading = pose.yaw_rad + scan.angle_min_rad
        angles = heading + scan.angle_increment_rad * np.arange(scan.ranges_m.size)
        reading = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, math.inf)
        with np.errstate(invalid='ignore'):
            x = (pose.x_m + reading * np.cos(angles)) / resolution_m
            y = (pose.y_m + reading * np.sin(angles)) / resolution_m
        inside = (box.column0 <= x) & (x < box.column1) & (box.row0 <= y) & (y < box.row1)
        ranges = np.where(inside, scan.ranges_m, np.float32(np.nan)).astype(scan.ranges_m.dtype)
        kept.append((replace(scan, ranges_m=ranges), pose))
    return kept
