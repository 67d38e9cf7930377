"""A map against the truth: every figure in one go."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array
from ogm_mcmc.config.evaluation import EvaluationConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation.calibration import Reliability, brier_score, reliability
from ogm_mcmc.evaluation.classification import ThresholdCounts, confusion_counts
from ogm_mcmc.evaluation.distance import occupied_distance_error
from ogm_mcmc.evaluation.divergence import divergence, summed, total_entropy
from ogm_mcmc.evaluation.masks import cells_that_count
from ogm_mcmc.geometry import GridMap

__all__ = ['Comparison', 'aligned', 'compare']

SAME_RESOLUTION = 1e-6  # relative
SAME_LATTICE = 0.01  # cells


class Comparison(NamedTuple):
    """Figures, and the arrays they were made of, on the cells of the truth.

    `measured` (H, W) the map, nan where unknown; `probability` (H, W) what judges it, the same
    with unknown cells filled in; `occupied` (H, W) the truth; `counted` (H, W) the cells that
    count; `divergence` (H, W) nats.
    """

    figures: dict[str, Any]
    measured: Float32Array
    probability: Float32Array
    occupied: BoolArray
    counted: BoolArray
    divergence: AnyArray
    counts: ThresholdCounts
    reliability: Reliability


def aligned(grid_map: GridMap, truth: GridMap, *, nearest: bool = False) -> Float32Array:
    """Return the map's probabilities on the cells of the truth, nan where it has none.

    Raises GridError for another resolution, for cells that lie between those of the truth
    (unless `nearest`), and for maps without a common cell.
    """
    spec, true = grid_map.spec, truth.spec
    if not math.isclose(spec.resolution_m, true.resolution_m, rel_tol=SAME_RESOLUTION):
        raise GridError(
            f'resolution of the map is {spec.resolution_m:g} m, of the truth '
            f'{true.resolution_m:g} m: expected the same'
        )
    column = (spec.origin_x_m - true.origin_x_m) / true.resolution_m
    row = (spec.origin_y_m - true.origin_y_m) / true.resolution_m
    between = max(abs(column - round(column)), abs(row - round(row)))
    if between > SAME_LATTICE and not nearest:
        raise GridError(
            f'origins of map and truth are ({column:.3f}, {row:.3f}) cells apart: '
            'expected whole cells (or --nearest)'
        )
    left, bottom = round(column), round(row)
    first_column, last_column = max(0, left), min(true.width, left + spec.width)
    first_row, last_row = max(0, bottom), min(true.height, bottom + spec.height)
    if first_column >= last_column or first_row >= last_row:
        raise GridError('map and truth have no cell in common: expected them to overlap')
    probability = np.full((true.height, true.width), np.nan, np.float32)
    probability[first_row:last_row, first_column:last_column] = grid_map.probability[
        first_row - bottom : last_row - bottom, first_column - left : last_column - left
    ]
    return probability


def compare(
    grid_map: GridMap,
    truth: GridMap,
    config: EvaluationConfig | None = None,
    *,
    filled: GridMap | None = None,
) -> Comparison:
    """Compare a map with the truth, whose cells are occupied from a probability of 0.5 on.

    `filled`: the map with what is said of its unknown cells all the same; the mask is that of
    `grid_map`. Cells of the truth that neither has count with `config.unknown`.
    """
    config = config or EvaluationConfig()
    measured = aligned(grid_map, truth, nearest=config.nearest)
    counted = cells_that_count(measured, config.mask, config.near_cells)
    if config.truth_unknown == 'exclude':
        counted = counted & np.isfinite(truth.probability)
    if not counted.any():
        raise GridError('no cell counts: expected cells known in the truth and inside the mask')
    filling = 1.0 if config.truth_unknown == 'occupied' else 0.0
    occupied: BoolArray = np.nan_to_num(truth.probability, nan=filling) >= 0.5
    said = measured
    if filled is not None:
        more = aligned(filled, truth, nearest=config.nearest)
        said = np.where(np.isfinite(more), more, measured)
    probability: Float32Array = np.where(np.isfinite(said), said, np.float32(config.unknown))
    counts = confusion_counts(probability[counted], occupied[counted])
    bins = reliability(probability[counted], occupied[counted], config.bins)
    # One of the largest arrays there are.
    per_cell = divergence(occupied, probability, config.floor, np.float32)
    comparison = Comparison({}, measured, probability, occupied, counted, per_cell, counts, bins)
    figures = _figures(comparison, truth.spec.resolution_m, config)
    figures['measured_cells'] = int((counted & np.isfinite(measured)).sum())
    return comparison._replace(figures=figures)


def _figures(of: Comparison, resolution_m: float, config: EvaluationConfig) -> dict[str, Any]:
    counted, called = of.counted, (of.probability >= config.threshold) & of.counted
    probability, occupied = of.probability[counted], of.occupied[counted]
    at_threshold = confusion_counts(probability, occupied, np.array([config.threshold]))
    total = summed(of.divergence, of.probability, counted, config.floor)
    walls = of.occupied & counted
    distances = {
        'map_to_truth_m': _fields(occupied_distance_error(called, walls, resolution_m)),
        'truth_to_map_m': _fields(occupied_distance_error(walls, called, resolution_m)),
    }
    return {
        'cells': int(counted.sum()),
        'occupied_cells': int(walls.sum()),
        'divergence_nats': total.nats,
        'divergence_per_cell': total.nats / total.cells,
        'divergence_clipped_cells': total.clipped,
        'entropy_nats': total_entropy(probability),
        'at_threshold': at_threshold.scores(0)._asdict(),
        'best': of.counts.best()._asdict(),
        'roc_area': of.counts.roc_area(),
        'average_precision': of.counts.average_precision(),
        'expected_calibration_error': of.reliability.expected_error(),
        'brier_score': brier_score(probability, occupied),
        'occupied_distance': distances,
        'settings': asdict(config),
    }


def _fields(values: NamedTuple) -> dict[str, Any]:
    """Return the fields of a named tuple by name."""
    fields: dict[str, Any] = values._asdict()
    return fields
