"""Points of the map frame to be asked about, and what a field says of them, as CSV."""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import PointsError
from ogm_mcmc.files.input_files import file_to_read, reason_of, text_of
from ogm_mcmc.geometry import FURTHEST_M

__all__ = ['read_points', 'write_prediction']

# x or y with the unit behind it: by itself, or after what it belongs to (`pose.x`, `position_y`).
_UNIT = r'(?:_m)?(?: *[(\[].*)?$'
AXES = (re.compile('([xyXY])' + _UNIT), re.compile(r'.*[./ _]([xyXY])' + _UNIT))

QUOTED = re.compile(r'"[^"]*"|(?:^|(?<=[,;\s]))\'[^\']*\'')
BLANK = ' '

# 1,500 may be one and a half or one thousand and a half; `;` between the columns says which.
THOUSANDS = re.compile(r'[+-]?\d{1,3}(?:,\d{3})+')


def read_points(path: Path) -> Float64Array:
    """Read points (N, 2), m: a line `x,y` each, more columns are left alone, `#` begins a remark.

    The first line may name the columns: x and y are taken where it says they are, and of two
    columns with other names these. Columns are parted by commas, tabs, blanks or semicolons;
    numbers may have a decimal comma where these or quotes tell it from the other commas. UTF-8,
    or UTF-16 with a byte order mark. Raises PointsError with the line at fault.
    """
    points: list[tuple[float, float]] = []
    columns, parted = (0, 1), ''
    try:
        for number, line in enumerate(_text(path).splitlines(), start=1):
            said = line.partition('#')[0].strip(' ')
            words = _words(said, _delimiter(said, parted))
            if not any(words):
                continue
            where = f'{path}: line {number}'
            named = None if parted else _named(said, where)
            if named is None:
                parted = parted or _delimiter(said, '')
                points.append(_point(words, columns, _delimiter(said, parted), where))
            else:
                columns, parted = named
    except PointsError:
        raise
    except (OSError, ValueError, csv.Error) as error:
        raise PointsError(f'{path}: expected lines x,y in m ({reason_of(error)})') from error
    if not points:
        raise PointsError(f'{path}: no point: expected lines x,y in m')
    return np.array(points)


def _text(path: Path) -> str:
    with file_to_read(path) as stream:
        mark = stream.read(2)
    wide = mark in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    return text_of(path, 'utf-16' if wide else 'utf-8-sig')


def _delimiter(said: str, usual: str) -> str:
    """Return what parts the columns of a line; `usual`: what does in the first line."""
    bare = QUOTED.sub('', said)
    if usual == ';' or (usual in (',', '\t') and usual in bare):
        return usual
    possible = BLANK if usual == '\t' else ';,'
    return next((mark for mark in possible if mark in bare), BLANK)


def _words(said: str, delimiter: str) -> list[str]:
    """Return what a line says in each column, without quotes."""
    if delimiter == BLANK:
        said = ' '.join(said.split())
    if not said:
        return []
    quote = '"' if '"' in said else "'"
    (words,) = csv.reader([said], delimiter=delimiter, quotechar=quote, skipinitialspace=True)
    return [word.strip(' \t"\'') for word in words]


def _named(said: str, where: str) -> tuple[tuple[int, int], str] | None:
    """Return which columns are x and y and what parts them, of a line of names; None of others."""
    bare = QUOTED.sub('', said)
    delimiter = next((mark for mark in ';,\t' if mark in bare), BLANK)
    # A blank before a unit parts no columns.
    names = _words(re.sub(r' +(?=[(\[])', '', said) if delimiter == BLANK else said, delimiter)
    columns = _columns_of(names)
    if not all(_is_name(name) for column in columns or (0, 1) for name in names[column:][:1]):
        return None
    if columns is None and any(names[2:]):
        raise PointsError(f'{where}: {_shown(names)}: expected one column x and one y')
    return columns or (0, 1), delimiter


def _is_name(word: str) -> bool:
    """Whether a word may name a column; nan and inf do not."""
    try:
        float(word)
    except ValueError:
        return not word or word[0].isalpha() or word[0] == '_'
    return False


def _columns_of(names: Sequence[str]) -> tuple[int, int] | None:
    """Return which columns are x and y, by names such as `X [m]`, `x_m`, `pose.x` or `pose_x`."""
    for axis in AXES:
        found = [match[1].lower() if (match := axis.match(name)) else '' for name in names]
        if found.count('x') == 1 and found.count('y') == 1:
            return found.index('x'), found.index('y')
        if any(found):
            return None
    return None


def _point(
    words: Sequence[str], columns: tuple[int, int], delimiter: str, where: str
) -> tuple[float, float]:
    try:
        x, y = (_number(words[column], delimiter) for column in columns)
    except (IndexError, ValueError):
        raise PointsError(f'{where}: {_shown(words)}: expected x,y in m') from None
    if not (abs(x) <= FURTHEST_M and abs(y) <= FURTHEST_M):
        raise PointsError(f'{where}: {x:g}, {y:g}: expected finite numbers up to {FURTHEST_M:g} m')
    return x, y


def _shown(words: Sequence[str]) -> str:
    return ' '.join(word if word.isprintable() else '?' for word in words)[:40]


def _number(word: str, delimiter: str) -> float:
    if '_' in word:  # Python's, nobody else's
        raise ValueError(word)
    if delimiter != ';' and THOUSANDS.fullmatch(word):
        raise ValueError(word)
    return float(word.replace(',', '.'))


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
    if log_odds >= 0.0:
        return 1.0 / (1.0 + math.exp(-log_odds))
    # Of small ones all digits: 0 would be certain.
    odds = math.exp(log_odds)
    return odds / (1.0 + odds)
