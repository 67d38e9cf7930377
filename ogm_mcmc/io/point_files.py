"""Points of the map frame to be asked about, and what a field says of them, as CSV."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import PointsError
from ogm_mcmc.files.input_files import file_to_read, reason_of

__all__ = ['read_points', 'write_prediction']

FURTHEST_M = 1e6


def read_points(path: Path) -> Float64Array:
    """Read points (N, 2), m: a line `x,y` each, more columns are left alone, `#` begins a remark.

    A first line without numbers names the columns. Raises PointsError with the line at fault.
    """
    points: list[tuple[float, float]] = []
    try:
        with file_to_read(path) as stream:
            for number, raw in enumerate(stream, start=1):
                words = raw.decode().partition('#')[0].replace(',', ' ').split()
                if words and not (number == 1 and words[0][0].isalpha()):
                    points.append(_point(words, f'{path}: line {number}'))
    except PointsError:
        raise
    except (OSError, ValueError) as error:
        raise PointsError(f'{path}: expected lines x,y in m ({reason_of(error)})') from error
    if not points:
        raise PointsError(f'{path}: no point: expected lines x,y in m')
    return np.array(points)


def _point(words: list[str], where: str) -> tuple[float, float]:
    try:
        x, y = float(words[0]), float(words[1])
    except (IndexError, ValueError):
        raise PointsError(f'{where}: {" ".join(words)[:40]}: expected x,y in m') from None
    if not (abs(x) <= FURTHEST_M and abs(y) <= FURTHEST_M):
        raise PointsError(f'{where}: {x:g}, {y:g}: expected finite numbers up to {FURTHEST_M:g} m')
    return x, y


def write_prediction(
    path: Path, points: Float64Array, mean: Float64Array, variance: Float64Array
) -> None:
    """Write x, y (m), mean and variance of the log-odds, and the probability of each point."""
    with path.open('w', encoding='utf-8', newline='') as stream:
        table = csv.writer(stream)
        table.writerow(['x', 'y', 'log_odds', 'variance', 'probability'])
        for (x, y), value, doubt in zip(points, mean, variance, strict=True):
            table.writerow([repr(float(x)), repr(float(y)), f'{value:.9g}', f'{doubt:.9g}',
                            f'{_probability(float(value)):.9g}'])  # fmt: skip


def _probability(log_odds: float) -> float:
    return 0.5 * (1.0 + math.tanh(0.5 * log_odds))
