"""[pose] Fig. 4 (b): the adaptive map against a fine regular grid, and what it costs and saves.

"The aim of an adaptive grid is to replicate its regular (fine resolution) counterpart, using fewer
cells. We therefore measure false positives and true positives against a regular grid map."
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray
from ogm_mcmc.config import AdaptiveConfig, MapperConfig, PoseUncertainConfig, flatten
from ogm_mcmc.evaluation.classification import ThresholdCounts, confusion_counts
from ogm_mcmc.geometry import CellBox, GridMap, PlacedScan, PoseBelief
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.mapping import AdaptiveMapper, MappingMethod, make_method
from ogm_mcmc.plotting import (
    Grid,
    Scale,
    Series,
    curves_png,
    grids_png,
)
from ogm_mcmc.simulation import WORLDS, Building, Lidar, rasterised, record

__all__ = ['agreement', 'hall', 'roc_curve', 'run']

VARIANTS = {
    'with unknowns': AdaptiveConfig(),
    'w/o unknowns': AdaptiveConfig(unknowns=False),
    'with unknowns, as printed': AdaptiveConfig(way_to_hit=False),
    'w/o unknowns, as printed': AdaptiveConfig(unknowns=False, way_to_hit=False),
}
RESOLUTION = 0.05
MEMORY_RESOLUTIONS = (0.1, 0.05, 0.025)
SAMPLES = PoseUncertainConfig(samples=30)
POSE_SIGMA_M, YAW_SIGMA_RAD = 0.05, math.radians(1.0)


class World(NamedTuple):
    """A building and a lidar that suits it."""

    building: Building
    lidar: Lidar


class Agreement(NamedTuple):
    """How an adaptive map replicates a regular one over the cells that the latter measured.

    `counts` over thresholds; `true_positive`, `false_positive`: rates at probability 0.5;
    `painted`: cells the adaptive map calls measured and nobody measured, as a share of those that
    were; `painted_wrong`: the share of them on the wrong side of 0.5 by the true map.
    """

    counts: ThresholdCounts
    true_positive: float
    false_positive: float
    painted: float
    painted_wrong: float


def hall() -> Building:
    """Return an open hall of 40 m x 30 m with four pillars."""
    corners = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]
    walls = [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    for x in (12.0, 28.0):
        for y in (10.0, 20.0):
            ring = [(x - 0.4, y - 0.4), (x + 0.4, y - 0.4), (x + 0.4, y + 0.4), (x - 0.4, y + 0.4)]
            walls += [(*a, *b) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    way = [(2, 2), (38, 2), (38, 15), (2, 15), (2, 28), (38, 28)]
    off = np.array([0.02, 0.03])
    return Building(np.array(walls, np.float64) + np.tile(off, 2), np.array(way) + off)


def recorded(world: World, every: int, seed: int, *, uncertain: bool = False) -> list[PlacedScan]:
    """Scans of a walk; with uncertain poses the mean is off as the covariance says."""
    rng = np.random.default_rng(seed)
    covariance = np.diag([POSE_SIGMA_M**2, POSE_SIGMA_M**2, YAW_SIGMA_RAD**2])
    placed = []
    for index, taken in enumerate(record(world.building, world.lidar, rng)):
        if index % every:
            continue
        if uncertain:
            x, y, yaw = rng.normal(0.0, (POSE_SIGMA_M, POSE_SIGMA_M, YAW_SIGMA_RAD))
            pose = taken.pose
            mean = replace(pose, x_m=pose.x_m + x, y_m=pose.y_m + y, yaw_rad=pose.yaw_rad + yaw)
            taken = PlacedScan(taken.scan, PoseBelief(mean, covariance))
        placed.append(taken)
    return placed


def mapped(config: MapperConfig, placed: Sequence[PlacedScan]) -> tuple[MappingMethod, float]:
    """Map all scans; return the map and the time it took per scan, ms."""
    method = make_method(config)
    method.update(placed[0])  # compiles, or loads the compiled
    method.reset()
    started = time.perf_counter()
    for one in placed:
        method.update(one)
    return method, 1e3 * (time.perf_counter() - started) / len(placed)


def agreement(adaptive: AnyArray, regular: AnyArray, truth: AnyArray) -> Agreement:
    """Compare probabilities on the same cells; nan: not measured, in `truth`: not known.

    The regular map calls a cell occupied above 0.5. A cell it measured and the adaptive map did
    not counts with probability 0.5 there.
    """
    measured = np.isfinite(regular)
    occupied: BoolArray = regular[measured] > 0.5
    scores = np.nan_to_num(adaptive[measured], nan=0.5)
    counts = confusion_counts(scores, occupied)
    called = scores > 0.5
    extra = np.isfinite(adaptive) & ~measured
    judged = extra & np.isfinite(truth)
    wrong = (adaptive[judged] > 0.5) != (truth[judged] > 0.5)
    return Agreement(
        counts,
        float(called[occupied].mean()),
        float(called[~occupied].mean()),
        float(extra.sum() / measured.sum()),
        float(wrong.mean()) if judged.any() else 0.0,
    )


def roc_curve(name: str, counts: ThresholdCounts, points: int = 1000) -> Series:
    """Return the curve with points at even distances along it, and not along the thresholds.

    Most cells are free for sure, so most thresholds share one place of the picture.
    """
    x = np.concatenate(([0.0], counts.false_positive_rate(), [1.0]))
    y = np.concatenate(([0.0], counts.recall(), [1.0]))
    way = np.concatenate(([0.0], np.cumsum(np.diff(x) + np.diff(y))))
    at = np.linspace(0.0, way[-1], points)
    return Series(name, np.interp(at, way, x), np.interp(at, way, y))


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Map an office and a hall, with known and with uncertain poses."""
    worlds = {
        'office': World(WORLDS['office'](), Lidar()),
        'hall': World(hall(), Lidar(range_max_m=60.0)),
    }
    every = 20 if quick else 4
    rows: list[dict[str, Any]] = []
    pictures: dict[str, str] = {}
    cases = {
        'office': ('office', False, every),
        'office, uncertain poses': ('office', True, 2 * every),
        'hall': ('hall', False, every),
    }
    for case, (name, uncertain, step) in cases.items():
        placed = recorded(worlds[name], step, seed, uncertain=uncertain)
        found, drawn = _replicate(case, worlds[name], placed, folder)
        rows += found
        pictures |= drawn
    for name, world in worlds.items():
        rows += _memory(name, recorded(world, every, seed))
    return {
        'rows': rows,
        'pictures': pictures,
        'settings': {
            **flatten(
                MapperConfig(method='adaptive', resolution=RESOLUTION, pose_uncertain=SAMPLES)
            ),
            'scan_every': every,
            'pose_sigma_m': POSE_SIGMA_M,
            'yaw_sigma_rad': YAW_SIGMA_RAD,
        },
        'notes': [
            '[pose] Fig. 4 (b) shows curves and no numbers; its text says that counting unknowns '
            'outperforms the map without, measured against a fine regular grid.',
            'As printed: a beam that ends in a leaf is a hit and nothing else. Ours also counts '
            'it as a miss by the share of the side that it crossed first.',
            'Painted: cells of large leaves that no beam crossed; a regular grid leaves them '
            'unknown.',
            'Bytes of the tree count its rows in use; those of the grid, four per cell over the '
            'smallest window around the measured cells.',
        ],
    }


def _replicate(
    case: str, world: World, placed: Sequence[PlacedScan], folder: Path
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """All variants of the adaptive map against the regular one, in one case."""
    base = MapperConfig(resolution=RESOLUTION, pose_uncertain=SAMPLES)
    regular, regular_ms = mapped(replace(base, method='pose_uncertain'), placed)
    truth_map = rasterised(world.building, RESOLUTION)
    box = regular.spec.box.union(truth_map.spec.box)
    truth = truth_map.windowed(box).probability
    expected = _window(regular, box)
    rows = [row(f'{case}: regular grid, ms per scan', round(regular_ms, 3))]
    curves = []
    stem = case.replace(', ', '-').replace(' ', '-')
    pictures = {f'{stem}-roc.png': f'{case}: ROC against the regular grid ([pose] Fig. 4 b)'}
    for name, settings in VARIANTS.items():
        config = replace(base, method='adaptive', adaptive=settings)
        method, ms = mapped(config, placed)
        assert isinstance(method, AdaptiveMapper)
        result = agreement(_window(method, box), expected, truth)
        curves.append(roc_curve(name, result.counts))
        remark = (
            f'at 0.5: {result.true_positive:.3f} true, {result.false_positive:.4f} false '
            f'positives; painted {result.painted:.3f}, of these wrong {result.painted_wrong:.3f}; '
            f'{method.statistics().leaves} leaves; {ms:.2f} ms per scan'
        )
        rows.append(
            row(f'{case}: ROC area, {name}', round(result.counts.roc_area(), 4), None, remark)
        )
        if name == 'with unknowns':
            pictures |= _draw(case, stem, method, expected, box, folder)
    save_picture(
        folder / f'{stem}-roc.png',
        curves_png(
            curves,
            'false positive rate',
            'true positive rate',
            x_limits=(0.0, 0.2),
            y_limits=(0.6, 1.005),
        ),
    )
    return rows, pictures


def _draw(
    case: str,
    stem: str,
    method: AdaptiveMapper,
    regular: AnyArray,
    box: CellBox,
    folder: Path,
) -> dict[str, str]:
    """Both maps, and how large the leaves are."""
    levels = np.full(regular.shape, np.nan)
    leaves = method.tree.leaves()
    measured = np.isfinite(leaves.log_odds)
    for level, column, line in zip(
        leaves.level[measured].tolist(),
        (leaves.column[measured] - box.column0).tolist(),
        (leaves.row[measured] - box.row0).tolist(),
        strict=True,
    ):
        side = 1 << level
        part = (
            slice(max(0, line), max(0, line + side)),
            slice(max(0, column), max(0, column + side)),
        )
        levels[part] = level
    sizes = Scale(
        f'side of a leaf, 2^n cells of {RESOLUTION:g} m', 0.0, float(method.tree.coarsest),
        'viridis',
    )  # fmt: skip
    extent = method.spec.windowed(box).extent_m
    pictures = {
        f'{stem}-regular.png': (Grid(regular, extent), f'{case}: regular grid'),
        f'{stem}-adaptive.png': (
            Grid(_window(method, box), extent),
            f'{case}: adaptive map, with unknowns',
        ),
        f'{stem}-leaves.png': (Grid(levels, extent, sizes), f'{case}: its leaves'),
    }
    for name, (grid, _) in pictures.items():
        save_picture(folder / name, grids_png([grid], 'x, m', 'y, m', side=400))
    return {name: caption for name, (_, caption) in pictures.items()}


def _window(method: MappingMethod, box: CellBox) -> AnyArray:
    """Return the probabilities of a box of cells, nan outside of the map."""
    spec = method.spec
    return GridMap(spec, method.probabilities(spec.box)).windowed(box).probability


def _memory(name: str, placed: Sequence[PlacedScan]) -> list[dict[str, Any]]:
    """Bytes of the tree beside those of the grid, the finer the cells the better for the tree."""
    rows = []
    for resolution in MEMORY_RESOLUTIONS:
        base = MapperConfig(resolution=resolution)
        regular, _ = mapped(base, placed)
        measured = np.argwhere(np.isfinite(regular.probabilities(regular.spec.box)))
        height, width = (np.ptp(measured, axis=0) + 1).tolist()
        method, ms = mapped(
            replace(base, method='adaptive', adaptive=AdaptiveConfig(coarsest_level=6)), placed
        )
        assert isinstance(method, AdaptiveMapper)
        found = method.statistics()
        rows.append(
            row(
                f'{name}, {100 * resolution:g} cm: bytes of the tree / of the grid',
                round(found.n_bytes / (4 * height * width), 3),
                None,
                f'{found.leaves} leaves for {len(measured)} measured cells; '
                f'{found.n_bytes} / {4 * height * width} bytes; {ms:.2f} ms per scan',
            )
        )
    return rows
