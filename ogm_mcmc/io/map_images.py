"""Map YAML and image, read exactly as `map_io.cpp` of nav2_map_server (Jazzy, Rolling) does.

`trinary`  occupied where p >= occupied_thresh, free where p <= free_thresh, else unknown
`scale`    likewise, with whole percents between: 100 (p - free) / (occupied - free), rounded
`raw`      a grey of 0 to 100 is the percentage itself, every other one is unknown

p is 1 - x / 255 of grey x, or x / 255 with `negate`, and compared with the thresholds in single
precision, as it is there. What is transparent in the least is unknown (in `raw` it does not
matter). Scalars are text, as in nav2: `negate` may be any whole number or boolean of YAML.

One thing differs on purpose: a map whose origin is turned is refused. Our grids lie along the
axes; nav2 hands the yaw on, and most of its readers drop it.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.image_files import MOST_PIXELS, Greys, read_greys
from ogm_mcmc.files.user_paths import possible_path
from ogm_mcmc.files.yaml_files import read_yaml
from ogm_mcmc.geometry import GridMap, GridSpec

__all__ = [
    'LEAST_YAW',
    'MOST_CELLS',
    'YAML_THRESHOLDS',
    'greys_as_map',
    'load_map',
    'probability_of_greys',
    'turned',
    'yaml_number',
    'yaml_origin',
]

# What the reader needs to tell the three greys of `trinary` apart, nav2's own values.
YAML_THRESHOLDS = {'occupied_thresh': 0.65, 'free_thresh': 0.196}

MOST_CELLS = MOST_PIXELS
LEAST_YAW = 1e-6
"""What a quaternion leaves of a yaw of 0, rad: a millimetre in a kilometre."""

NEEDED = ('image', 'resolution', 'origin', 'negate', 'occupied_thresh', 'free_thresh')
MODES = ('trinary', 'scale', 'raw')
TRUE, FALSE = ('y', 'yes', 'true', 'on'), ('n', 'no', 'false', 'off')
NUMBER = re.compile(r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?')
SPECIAL = {'.inf': math.inf, '+.inf': math.inf, '-.inf': -math.inf, '.nan': math.nan}


class _Meaning(NamedTuple):
    """What greys stand for."""

    mode: str = 'trinary'
    negate: bool = False
    occupied: float = YAML_THRESHOLDS['occupied_thresh']
    free: float = YAML_THRESHOLDS['free_thresh']


TRINARY = _Meaning()


def load_map(path: Path, most_cells: int = MOST_CELLS) -> GridMap:
    """Read a map YAML and its image: probabilities, nan where unknown (`trinary`: 1, 0, nan).

    An image of more than `most_cells` pixels is refused before it takes memory. Raises
    MapFileError with the field at fault.
    """
    fields = read_yaml(path, 'map YAML', MapFileError, typed=False)
    if not isinstance(fields, dict):
        raise MapFileError(f'{path}: expected a map YAML with {", ".join(NEEDED)}')
    if missing := [key for key in NEEDED if key not in fields]:
        raise MapFileError(
            f'{path}: no {", ".join(missing)} in it: expected a map YAML with {", ".join(NEEDED)}'
        )
    try:
        resolution = yaml_number(fields, 'resolution')
        x, y = yaml_origin(path, fields['origin'])
        meaning = _meaning(fields)
        GridSpec(resolution, 1, 1, anchor_x_m=x, anchor_y_m=y)  # before the image is read
    except MapFileError:
        raise
    except ValueError as error:
        raise MapFileError(f'{path}: {error}') from error
    image = path.parent / _image(path, fields['image'])
    probability = probability_of_greys(read_greys(image, MapFileError, most_cells), meaning)
    height, width = probability.shape
    return GridMap(GridSpec(resolution, width, height, anchor_x_m=x, anchor_y_m=y), probability)


def probability_of_greys(greys: Greys, meaning: _Meaning = TRINARY) -> Float32Array:
    """Return probabilities (height, width), row 0 lowest y; by default as `trinary` has them."""
    probability: Float32Array = _by_grey(meaning)[greys.grey[::-1]]
    if greys.opaque is not None and meaning.mode != 'raw':
        probability[~greys.opaque[::-1]] = np.nan
    return probability


def greys_as_map(greys: Greys, resolution_m: float) -> GridMap:
    """Return an image as a map by the thresholds of `YAML_THRESHOLDS`."""
    height, width = greys.grey.shape
    return GridMap(GridSpec(resolution_m, width, height), probability_of_greys(greys))


def turned(path: Path, yaw: float) -> str:
    """Return what to say of a map whose origin is turned."""
    return f'{path}: origin has yaw {yaw:g}: expected 0, a map along the axes'


def _by_grey(meaning: _Meaning) -> Float32Array:
    """Probability (256,) of every grey, with nav2's arithmetic: single precision throughout."""
    one, whole = np.float32(1.0), np.float32(100.0)
    grey = np.arange(256)
    if meaning.mode == 'raw':
        return np.where(grey <= 100, grey.astype(np.float32) / whole, np.float32(np.nan))
    p = grey.astype(np.float32) / np.float32(255.0)
    if not meaning.negate:
        p = one - p
    free, occupied = np.float32(meaning.free), np.float32(meaning.occupied)
    values = np.full(256, np.nan, np.float32)
    if meaning.mode == 'scale':
        between = (p > free) & (p < occupied)
        # The difference is taken in double precision there, then rounded to single.
        share = (p[between] - free) / np.float32(meaning.occupied - meaning.free)
        values[between] = np.floor(share * whole + np.float32(0.5)) / whole
    values[p >= occupied] = 1.0
    values[p <= free] = 0.0
    return values


def _meaning(fields: dict[str, Any]) -> _Meaning:
    mode = str(fields.get('mode', 'trinary')).lower()
    if mode not in MODES:
        raise ValueError(f'mode is {fields["mode"]!r}: expected one of {", ".join(MODES)}')
    free, occupied = yaml_number(fields, 'free_thresh'), yaml_number(fields, 'occupied_thresh')
    if not free < occupied:
        raise ValueError(f'free_thresh {free}, occupied_thresh {occupied}: expected one below')
    if not (free >= 0.0 and occupied <= 1.0):
        # nav2 takes percents as they are, and then every cell is free.
        raise ValueError(f'free_thresh {free}, occupied_thresh {occupied}: expected 0 to 1')
    return _Meaning(mode, _flag(fields['negate']), occupied, free)


def yaml_number(fields: dict[str, Any], name: str) -> float:
    """Return a field that is text as a number. Raises ValueError, naming it."""
    return _as_number(fields[name], name)


def _as_number(value: Any, name: str) -> float:
    text = value if isinstance(value, str) else ''
    if text.lower() in SPECIAL:
        return SPECIAL[text.lower()]
    if not NUMBER.fullmatch(text):
        raise ValueError(f'{name} is {value!r:.80}: expected a number')
    return float(text)


def _flag(value: Any) -> bool:
    text = value.lower() if isinstance(value, str) else ''
    if text in TRUE + FALSE:
        return text in TRUE
    if not re.fullmatch('[-+]?[0-9]{1,10}', text):
        raise ValueError(f'negate is {value!r:.80}: expected 0, 1, true or false')
    return int(text) != 0


def yaml_origin(path: Path, value: Any) -> tuple[float, float]:
    """Return x and y of an origin of text. Raises ValueError, MapFileError where it is turned."""
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f'origin is {value!r:.80}: expected x, y and yaw')
    x, y, yaw = (_as_number(item, 'origin') for item in value)
    # A yaw that is no number comes from maps whose saver knew none: nav2's community reads 0.
    if not (math.isnan(yaw) or abs(yaw) <= LEAST_YAW):
        raise MapFileError(turned(path, yaw))
    return x, y


def _image(path: Path, value: Any) -> Path:
    if not isinstance(value, str):
        raise MapFileError(f'{path}: image is {value!r:.80}: expected the name of a file')
    if not value:
        raise MapFileError(f'{path}: image is empty: expected the name of a file')
    return possible_path(Path(value), f'{path}: image', MapFileError)  # ~ is no home here
