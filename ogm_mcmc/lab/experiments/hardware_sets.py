"""Recorded data sets as [patch] section IV uses them: benchmark, experiments, what is left.

Every beam of every pose makes the benchmark. Each experiment takes fewer poses, and of their
scans every so many-th beam (Table III). What an experiment does not take is held out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.evaluation import near
from ogm_mcmc.geometry import CellBox, GridMap, PlacedScan
from ogm_mcmc.lab.experiments.recordings import data_folder

__all__ = [
    'CELL_PRIOR',
    'NEAR_CELLS',
    'THRESHOLD',
    'Benchmark',
    'HardwareSet',
    'Published',
    'Split',
    'benchmark_of',
    'split',
    'traditional_map',
    'window_box',
]

# p(occupied) of the patches of [patch], and where it thresholds its benchmark and its start.
CELL_PRIOR, THRESHOLD = 0.234, 0.20

# Cells that count lie so near to one that the benchmark measured.
NEAR_CELLS = 10


class Published(NamedTuple):
    """What [patch] prints for cells of `resolution_m`: Tables III and IV by experiment.

    Shares of the window that the benchmark and each experiment map, of cells that count, and
    seconds per map sample by method.
    """

    resolution_m: float
    benchmark_mapped: float
    mapped: Mapping[int, float]
    near: float
    seconds: Mapping[str, Mapping[int, float]]


@dataclass(frozen=True)
class HardwareSet:
    """A recording and what [patch] does with it.

    `read` gives the scans and poses of the laser from `path`, a file or folder in the folder of
    the data; `expected` says how to come by it. The window of `side_m` is around `centre_m`, or
    else around the middle of the poses. Experiments: number and every which pose it takes.
    `held_out_scans` judge a map, evenly spread.
    Cells of the first of `resolutions_m` are sampled with the Gaussian of [patch], too.
    """

    name: str
    path: Path
    expected: str
    read: Callable[[Path], list[PlacedScan]]
    side_m: float
    centre_m: tuple[float, float] | None
    pose_strides: Mapping[int, int]
    beam_stride: int
    resolutions_m: tuple[float, ...]
    quick_resolution_m: float
    held_out_scans: int
    figure: str
    published: Published
    notes: tuple[str, ...]

    @property
    def sparsest(self) -> int:
        """The experiment with the fewest scans."""
        return max(self.pose_strides)

    def folder(self) -> Path:
        """Return the folder of the recorded data; raises ConfigError where this is not in it."""
        return data_folder(self.path, self.expected)

    def scans(self, folder: Path) -> list[PlacedScan]:
        """Read all of it."""
        return self.read(folder / self.path)


class Split(NamedTuple):
    """Placed scans that an experiment uses, and the beams that it does not."""

    used: list[PlacedScan]
    held_out: list[PlacedScan]


class Benchmark(NamedTuple):
    """`occupied` and `counted` (H, W) of the window; `mapped` and `near` shares of its cells."""

    occupied: BoolArray
    counted: BoolArray
    mapped_share: float
    near_share: float


def split(of: HardwareSet, scans: list[PlacedScan], number: int) -> Split:
    """Return what an experiment uses and what it leaves."""
    used, held_out = [], []
    for k, (scan, belief) in enumerate(scans):
        if k % of.pose_strides[number] == 0:
            every = of.beam_stride
            taken = replace(
                scan,
                ranges_m=scan.ranges_m[::every].copy(),
                angle_increment_rad=every * scan.angle_increment_rad,
            )
            used.append(PlacedScan(taken, belief))
            left = scan.ranges_m.copy()
            left[::every] = np.nan
            held_out.append(PlacedScan(replace(scan, ranges_m=left), belief))
        else:
            held_out.append(PlacedScan(scan, belief))
    return Split(used, held_out)


def window_box(of: HardwareSet, scans: list[PlacedScan], resolution_m: float) -> CellBox:
    """Return the window in lattice cells."""
    centre = of.centre_m
    if centre is None:
        positions = np.array([(one.pose.x_m, one.pose.y_m) for one in scans])
        centre = tuple(0.5 * (positions.min(axis=0) + positions.max(axis=0)))
    cells = round(of.side_m / resolution_m)
    column, row = (round((middle - 0.5 * of.side_m) / resolution_m) for middle in centre)
    return CellBox(column, row, column + cells, row + cells)


def traditional_map(scans: list[PlacedScan], box: CellBox, resolution_m: float) -> GridMap:
    """Map scans as [patch] section II does: beam by beam, independent cells; in a window.

    Beams without a return say nothing: with them 77 % of the Intel cells would be mapped, not
    the 60 % of Table III.
    """
    config = MapperConfig(
        fusion='per_beam', resolution=resolution_m, prior=CELL_PRIOR, no_return='ignore'
    )
    return map_of(scans, config, box)


def benchmark_of(scans: list[PlacedScan], box: CellBox, resolution_m: float) -> Benchmark:
    """Threshold the map of every beam at 0.20; unmapped cells, at 0.234, are occupied in it."""
    probability = traditional_map(scans, box, resolution_m).probability
    mapped = np.isfinite(probability)
    counted = near(mapped, NEAR_CELLS)
    return Benchmark(
        np.nan_to_num(probability, nan=CELL_PRIOR) >= THRESHOLD,
        counted,
        float(mapped.mean()),
        float(counted.mean()),
    )
