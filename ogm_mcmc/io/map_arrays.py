"""Maps of others as arrays: an NPY or MAT file, and a YAML of the same name beside it.

The YAML says where the cells lie and what the values are:

resolution  m
origin      [x, y] or [x, y, yaw] of the lower left corner, m; yaw 0
values      `probability` (0 to 1, the default), `percent` (0 to 100) or `log_odds`; what is
            unknown is nan, and in `percent` also below 0, as in nav_msgs/OccupancyGrid
first_row   `bottom` (row 0 has the lowest y, the default) or `top`, as in images
variable    the name of the array, for a MAT file that holds several

Other keys do not matter, so the YAML of a map image serves; one that is nearly one of the last
three is refused, as a slip would turn a map over. MAT files are read by scipy, where it is
installed.
"""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, Float64Array
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.input_files import file_to_read, reason_of
from ogm_mcmc.files.yaml_files import read_yaml
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_images import MOST_CELLS, yaml_number, yaml_origin

__all__ = ['ARRAY_SUFFIXES', 'load_array_map', 'within_rounding']

ARRAY_SUFFIXES = ('.npy', '.mat')
ROUNDING = 1e-6
VALUES = ('probability', 'percent', 'log_odds')
FIRST_ROWS = ('bottom', 'top')
MAY_BE_LEFT_OUT = ('values', 'first_row', 'variable')


def load_array_map(path: Path, most_cells: int = MOST_CELLS) -> GridMap:
    """Read a map from an NPY or MAT file and its YAML. Raises MapFileError, naming the field."""
    beside = _yaml_of(path)
    fields = read_yaml(beside, 'YAML of an array', MapFileError, typed=False)
    if not isinstance(fields, dict) or any(key not in fields for key in ('resolution', 'origin')):
        raise MapFileError(f'{beside}: expected resolution and origin of {path.name}')
    try:
        _refuse_slips(fields)
        resolution = yaml_number(fields, 'resolution')
        x, y = yaml_origin(beside, _with_yaw(fields['origin']))
        GridSpec(resolution, 1, 1, anchor_x_m=x, anchor_y_m=y)  # before the array is read
        values = _one_of(fields, 'values', VALUES)
        first_row = _one_of(fields, 'first_row', FIRST_ROWS)
    except MapFileError:
        raise
    except ValueError as error:
        raise MapFileError(f'{beside}: {error}') from error
    read = _read_npy if path.suffix.lower() == '.npy' else _read_mat
    array = read(path, fields.get('variable'), most_cells)
    probability = _probability(path, array, values)
    if first_row == 'top':
        probability = np.ascontiguousarray(probability[::-1])
    height, width = probability.shape
    return GridMap(GridSpec(resolution, width, height, anchor_x_m=x, anchor_y_m=y), probability)


def _yaml_of(path: Path) -> Path:
    for suffix in ('.yaml', '.yml'):
        beside = path.with_suffix(suffix)
        if beside.is_file():
            return beside
    raise MapFileError(
        f'{path}: expected {path.with_suffix(".yaml").name} beside it, with resolution and origin'
    )


def _refuse_slips(fields: dict[str, Any]) -> None:
    for key in fields:
        near = get_close_matches(str(key).lower(), MAY_BE_LEFT_OUT, 1, 0.8)
        if near and key not in MAY_BE_LEFT_OUT:
            raise ValueError(f'{key!r:.80} is no key: expected {near[0]}')


def _with_yaw(origin: Any) -> Any:
    return [*origin, '0'] if isinstance(origin, list) and len(origin) == 2 else origin


def _one_of(fields: dict[str, Any], name: str, choices: tuple[str, ...]) -> str:
    given = fields.get(name, choices[0])
    if given not in choices:
        raise ValueError(f'{name} is {given!r:.80}: expected one of {", ".join(choices)}')
    return str(given)


def _read_npy(path: Path, _: object, most_cells: int) -> AnyArray:
    try:
        with file_to_read(path):
            pass
        # Mapped, it takes no memory before its size was looked at.
        mapped: AnyArray = np.load(path, mmap_mode='r', allow_pickle=False)
        if not isinstance(mapped, np.ndarray):
            raise ValueError('an archive of arrays')
    except Exception as error:  # NumPy lets through whatever its header parser raises
        raise MapFileError(f'{path}: expected an array ({reason_of(error)})') from error
    _check(path, mapped.shape, mapped.dtype.kind in 'fiub', most_cells)
    return np.array(mapped)


def _read_mat(path: Path, variable: object, most_cells: int) -> AnyArray:
    try:
        from scipy.io import loadmat, whosmat
    except ImportError as error:
        raise MapFileError(f'{path}: MAT files need scipy ({error}): pip install scipy') from error
    try:
        with file_to_read(path) as stream:
            listed = {name: tuple(shape) for name, shape, _ in whosmat(stream)}
            chosen = _chosen(listed, variable)
            _check(path, listed[chosen], True, most_cells)
            stream.seek(0)
            array = np.asarray(loadmat(stream, variable_names=[chosen])[chosen])
    except MapFileError:
        raise
    except NotImplementedError as error:
        raise MapFileError(
            f"{path}: a MAT file of version 7.3: expected one that save(..., '-v7') writes"
        ) from error
    except Exception as error:  # a damaged file fails in more ways than can be listed
        raise MapFileError(f'{path}: expected a MAT file ({reason_of(error)})') from error
    _check(path, array.shape, array.dtype.kind in 'fiub', most_cells)
    return array


def _chosen(listed: dict[str, tuple[int, ...]], variable: object) -> str:
    """Return the variable that holds the map: the one named, or the only array of many cells."""
    if variable is not None:
        if variable not in listed:
            raise ValueError(f'variable {variable!r:.80}, one of {", ".join(listed)}')
        return str(variable)
    arrays = [name for name, shape in listed.items() if len(shape) == 2 and max(shape) > 1]
    if len(arrays) != 1:
        raise ValueError(
            f'with one array, or "variable" in the YAML; arrays are {", ".join(arrays) or "none"}'
        )
    return arrays[0]


def _check(path: Path, shape: tuple[int, ...], is_number: bool, most_cells: int) -> None:
    if len(shape) != 2 or 0 in shape or not is_number:
        raise MapFileError(f'{path}: array of shape {shape}: expected numbers, rows x columns')
    if shape[0] * shape[1] > most_cells:
        raise MapFileError(
            f'{path}: {shape[1]} x {shape[0]} cells: expected at most {most_cells} (--max-cells)'
        )


def _probability(path: Path, array: AnyArray, values: str) -> Float32Array:
    numbers: Float64Array = array.astype(np.float64)
    text = 'values from 0 to 1, or nan'
    if values == 'log_odds':
        with np.errstate(over='ignore'):
            numbers = 1.0 / (1.0 + np.exp(-numbers))
    elif values == 'percent':
        numbers = np.where(numbers < 0.0, np.nan, numbers / 100.0)
        text = 'percents from 0 to 100, below 0 or nan where unknown'
    probability = within_rounding(numbers)
    if probability is None:
        raise MapFileError(f'{path}: {values}: expected {text} ("values" in its YAML)')
    return probability


def within_rounding(numbers: AnyArray) -> Float32Array | None:
    """Return numbers as probabilities, those by a rounding error outside of 0 to 1 moved there.

    None where one is further off.
    """
    low, high = np.nanmin(numbers, initial=0.0), np.nanmax(numbers, initial=1.0)
    if not (low >= -ROUNDING and high <= 1.0 + ROUNDING):
        return None
    found = numbers.astype(np.float32, order='C', copy=False)
    return found if low >= 0.0 and high <= 1.0 else found.clip(0.0, 1.0)
