"""Points of the map frame to be asked about, and what a field says of them, as CSV."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import PointsError
from ogm_mcmc.files.input_files import file_to_read, reason_of

__all__ = ['read_points', 'write_prediction']

FURTHEST_M = 1e6

# x or y by itself, what it belongs to in front of it and the unit behind it.
AXIS = re.compile(r'(?:.*[./ ])?([xyXY])(?:_m)?(?: *[(\[].*)?$')


def read_points(path: Path) -> Float64Array:
    """Read points (N, 2), m: a line `x,y` each, more columns are left alone, `#` begins a remark.

    The first line may name the columns: x and y are taken where it says they are, else the first
    two. Columns are parted by commas, by blanks, or by semicolons, with points or commas in the
    numbers then. Raises PointsError with the line at fault.
    """
    points: list[tuple[float, float]] = []
    columns, seen = (0, 1), False
    try:
        with file_to_read(path) as stream:
            lines = stream.read().decode('utf-8-sig').splitlines()
        for number, line in enumerate(lines, start=1):
            words = _words(line)
            if not any(words):
                continue
            if not seen and all(map(_is_name, words)):
                columns = _columns_of(words)
            else:
                points.append(_point(words, columns, f'{path}: line {number}'))
            seen = True
    except PointsError:
        raise
    except (OSError, ValueError) as error:
        raise PointsError(f'{path}: expected lines x,y in m ({reason_of(error)})') from error
    if not points:
        raise PointsError(f'{path}: no point: expected lines x,y in m')
    return np.array(points)


def _words(line: str) -> list[str]:
    """Return what a line says in each column, without quotes."""
    said = line.partition('#')[0].strip()
    if ';' in said:
        words = [word.replace(',', '.') for word in said.split(';')]
    else:
        words = said.split(',') if ',' in said else said.split()
    return [word.strip(' \t"\'') for word in words]


def _is_name(word: str) -> bool:
    """Whether a word may name a column; nan and inf do not."""
    try:
        float(word)
    except ValueError:
        return not word or word[0].isalpha() or word[0] == '_'
    return False


def _columns_of(names: list[str]) -> tuple[int, int]:
    """Return which columns are x and y, by names such as `X [m]`, `x_m` or `pose.x`."""
    found = [match[1].lower() if (match := AXIS.match(name)) else '' for name in names]
    if found.count('x') == 1 and found.count('y') == 1:
        return found.index('x'), found.index('y')
    return 0, 1


def _point(words: list[str], columns: tuple[int, int], where: str) -> tuple[float, float]:
    try:
        x, y = (_number(words[column]) for column in columns)
    except (IndexError, ValueError):
        shown = ' '.join(word if word.isprintable() else '?' for word in words)[:40]
        raise PointsError(f'{where}: {shown}: expected x,y in m') from None
    if not (abs(x) <= FURTHEST_M and abs(y) <= FURTHEST_M):
        raise PointsError(f'{where}: {x:g}, {y:g}: expected finite numbers up to {FURTHEST_M:g} m')
    return x, y


def _number(word: str) -> float:
    if '_' in word:  # Python's, nobody else's
        raise ValueError(word)
    return float(word)


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
