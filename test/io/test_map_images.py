"""Map files of others: read as nav2_map_server reads them, or refused in one line."""

import os

import numpy as np
import pytest
from PIL import Image
from support.refusals import refusal_of

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.geometry.grid_map import occupancy_values
from ogm_mcmc.io.map_images import load_map

FIELDS = {
    'image': 'map.pgm',
    'resolution': '0.1',
    'origin': '[-1.5, 2.5, 0.0]',
    'negate': '0',
    'occupied_thresh': '0.65',
    'free_thresh': '0.196',
}
# Top row first: white, nearly free; grey, black.
PIXELS = bytes([255, 206, 205, 0])
IMAGE = b'P5\n2 2\n255\n' + PIXELS


@pytest.fixture
def write_map(tmp_path):
    """Write map.yaml with fields replaced (None: left out) and map.pgm."""

    def write(content=IMAGE, **changes):
        fields = FIELDS | changes
        lines = [f'{name}: {value}\n' for name, value in fields.items() if value is not None]
        path = tmp_path / 'map.yaml'
        path.write_text(''.join(lines))
        (tmp_path / 'map.pgm').write_bytes(content)
        return path

    return write


def message_of(path, named=None):
    message = refusal_of(MapFileError, load_map, path)
    assert str(named or path.parent) in message
    return message


def same(probability, expected):
    return np.array_equal(probability, np.array(expected, np.float32), equal_nan=True)


def test_where_the_cells_lie(write_map):
    spec, probability = load_map(write_map())
    assert (spec.resolution_m, spec.width, spec.height) == (0.1, 2, 2)
    assert (spec.origin_x_m, spec.origin_y_m) == (-1.5, 2.5)
    assert probability.dtype == np.float32
    assert same(probability, [[np.nan, 1.0], [0.0, 0.0]])


def test_negate(write_map):
    path = write_map(b'P5\n2 2\n255\n' + bytes([0, 49, 50, 255]), negate='1')
    assert same(load_map(path).probability, [[np.nan, 1.0], [0.0, 0.0]])


@pytest.mark.parametrize('mode', [None, 'trinary'])
@pytest.mark.parametrize('kind', ['L', 'RGB', '1'])
def test_other_images(write_map, tmp_path, mode, kind):
    pixels = np.array([[255, 255], [0, 255]], np.uint8)
    Image.fromarray(pixels).convert(kind).save(tmp_path / 'map.png')
    path = write_map(image='map.png', mode=mode)
    assert same(load_map(path).probability, [[1.0, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize(
    ('threshold', 'negate', 'free', 'occupied'),
    [
        ('0.8', '0', 51, 51),
        ('0.6', '0', 102, 102),
        ('0.4', '0', 153, 152),
        ('0.2', '0', 204, 203),
        ('0.8', '1', 204, 204),
        ('0.4', '1', 102, 102),
    ],
)
def test_grey_exactly_at_a_threshold(write_map, threshold, negate, free, occupied):
    """Of all greys: the last free one and the last occupied one, as nav2_map_server has them.

    Each threshold is that of a grey. Both count, but 1 - 153 / 255 and 1 - 204 / 255 are just
    below 0.4 and 0.2 in single precision, in which it compares.
    """
    image = b'P5\n256 1\n255\n' + bytes(range(256))
    darkest_first = slice(None) if negate == '0' else slice(None, None, -1)
    path = write_map(image, free_thresh=threshold, occupied_thresh='0.99', negate=negate)
    greys = np.arange(256)[darkest_first]
    probability = load_map(path).probability[0][darkest_first]
    assert greys[probability == 0.0][0] == free
    path = write_map(image, occupied_thresh=threshold, free_thresh='0.01', negate=negate)
    probability = load_map(path).probability[0][darkest_first]
    assert greys[probability == 1.0][-1] == occupied


def test_scale_gives_whole_percents(write_map):
    """100 (p - free) / (occupied - free) of p = 1 - x / 255, rounded; beyond: 0 and 100."""
    greys = bytes([255, 206, 205, 204, 178, 128, 90, 89, 0])
    path = write_map(b'P5\n9 1\n255\n' + greys, mode='scale')
    expected = []
    for x in greys:
        p = (255 - x) / 255
        share = 100.0 * (p - 0.196) / (0.65 - 0.196)
        expected.append(100 if p >= 0.65 else 0 if p <= 0.196 else round(share))
    assert occupancy_values(load_map(path).probability).tolist() == [expected]
    assert expected == [0, 0, 0, 1, 23, 67, 99, 100, 100]


def test_raw_is_the_percentage(write_map):
    path = write_map(b'P5\n5 1\n255\n' + bytes([0, 1, 100, 101, 255]), mode='RAW', negate='1')
    assert occupancy_values(load_map(path).probability).tolist() == [[0, 1, 100, -1, -1]]


@pytest.mark.parametrize('beneath', [0, 255])
def test_what_is_transparent_is_unknown(write_map, tmp_path, beneath):
    pixels = np.array([[[0, 0, 0, 255], [beneath] * 3 + [0], [beneath] * 3 + [254]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / 'map.png')
    for mode in ('trinary', 'scale'):
        found = load_map(write_map(image='map.png', mode=mode)).probability
        assert same(found, [[1.0, np.nan, np.nan]])
    raw = load_map(write_map(image='map.png', mode='raw')).probability
    assert same(raw, [[0.0, *[np.nan if beneath else 0.0] * 2]])


@pytest.mark.parametrize('text', ['1', 'true', 'True', 'yes', 'on', 'ON', 'y', '"1"', '2', '-1'])
def test_negate_however_it_is_spelt(write_map, text):
    path = write_map(b'P5\n2 1\n255\n' + bytes([0, 255]), negate=text)
    assert same(load_map(path).probability, [[0.0, 1.0]])


@pytest.mark.parametrize('text', ['0', 'false', 'No', 'off', 'n', "'0'", '00'])
def test_no_negate_however_it_is_spelt(write_map, text):
    path = write_map(b'P5\n2 1\n255\n' + bytes([0, 255]), negate=text)
    assert same(load_map(path).probability, [[1.0, 0.0]])


def test_absolute_path_of_the_image(write_map, tmp_path):
    (tmp_path / 'deep').mkdir()
    path = write_map(image=str(tmp_path / 'map.pgm'))
    moved = path.rename(tmp_path / 'deep' / 'map.yaml')
    assert load_map(moved).probability.shape == (2, 2)


def test_a_turned_origin_is_refused_by_name(write_map):
    message = message_of(write_map(origin='[-1.0, -2.0, 0.7853981]'))
    assert 'origin has yaw 0.785398: expected 0' in message


@pytest.mark.parametrize('yaw', ['.nan', '0', '-0.0', '1e-17'])
def test_yaw_that_counts_as_none(write_map, yaw):
    assert load_map(write_map(origin=f'[-1.5, 2.5, {yaw}]')).spec.origin_x_m == -1.5


def test_numbers_as_yaml_cpp_reads_them(write_map):
    path = write_map(resolution='5e-2', occupied_thresh='"0.65"', free_thresh='.196')
    assert load_map(path).spec.resolution_m == 0.05


def test_an_image_that_is_a_pipe_does_not_hang(write_map, tmp_path):
    os.mkfifo(tmp_path / 'pipe.pgm')
    assert 'expected a regular file' in message_of(write_map(image='pipe.pgm'))
    assert 'regular file' in message_of(write_map(image='/dev/zero'), '/dev/zero')


def test_more_cells_than_allowed_are_refused(write_map):
    with pytest.raises(MapFileError, match='2 x 2 pixels: expected at most 3'):
        load_map(write_map(), most_cells=3)


@pytest.mark.parametrize('name', FIELDS)
def test_missing_field(write_map, name):
    assert f'no {name} in it' in message_of(write_map(**{name: None}))


@pytest.mark.parametrize(
    'content',
    [b'', b'just text', b'[1, 2, 3]', b'image: [', b'a: b: c', b'\x89PNG\r\n', b'\0', b'3'],
)
def test_file_that_is_no_map_yaml(tmp_path, content):
    path = tmp_path / 'map.yaml'
    path.write_bytes(content)
    assert 'map YAML' in message_of(path)


def test_missing_yaml(tmp_path):
    message_of(tmp_path / 'none.yaml')
    (tmp_path / 'folder').mkdir()
    message_of(tmp_path / 'folder')


@pytest.mark.parametrize('image', ['none.pgm', '.', 'deep/none.pgm', 'map.yaml', '3'])
def test_missing_image(write_map, image):
    assert 'readable image' in message_of(write_map(image=image))


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('resolution', '.nan'),
        ('resolution', '.inf'),
        ('resolution', '0'),
        ('resolution', '-0.1'),
        ('resolution', 'fine'),
        ('resolution', '[0.1]'),
        ('resolution', ''),
        ('origin', '0'),
        ('origin', '[]'),
        ('origin', '[1.0]'),
        ('origin', '[.nan, 0, 0]'),
        ('origin', '[0, .inf, 0]'),
        ('origin', '[here, there, 0]'),
        ('origin', 'xyz'),
        ('origin', ''),
        ('occupied_thresh', 'high'),
        ('occupied_thresh', '.nan'),
        ('free_thresh', '[0.1]'),
        ('free_thresh', '.nan'),
        ('mode', 'grey'),
        ('mode', ''),
        ('negate', 'maybe'),
        ('negate', '1.0'),
        ('negate', ''),
        ('negate', '9' * 50),
        ('origin', '[0, 0]'),
        ('origin', '[0, 0, 0, 0]'),
        ('origin', '[0, 0, .inf]'),
        ('origin', '[[0], 0, 0]'),
        ('image', ''),
        ('image', '[a]'),
        ('image', '"a\\0b.pgm"'),
        ('image', 'x' * 300),
        ('resolution', '9' * 5000),
        ('resolution', '&a 0.1'),
        ('resolution', 'true'),
        ('free_thresh', '0.7'),
        ('free_thresh', '-0.1'),
        ('occupied_thresh', '65'),
    ],
)
def test_value_that_cannot_be(write_map, name, value):
    message_of(write_map(**{name: value}))


@pytest.mark.parametrize(
    'image',
    [
        b'',
        b'not an image',
        b'P5\n2 2\n255\n' + PIXELS[:3],
        b'P5\n0 2\n255\n',
        b'\x89PNG\r\n\x1a\n' + bytes(40),
    ],
)
def test_image_that_is_damaged(write_map, image):
    assert 'readable image' in message_of(write_map(image))


@pytest.mark.parametrize(
    'image',
    [
        b'P5\n2',
        b'P5\nx y\n255\n' + PIXELS,
        b'P5\n2 2\n0\n' + PIXELS,
        b'P5\n99999999999999 2\n255\n' + PIXELS,
        b'P5\n99999 99999\n255\n' + PIXELS,
        b'P2\n2 2\n255\n1 2 3 x',
    ],
    ids=['cut off', 'no size', 'no white', 'endless', 'huge', 'plain'],
)
def test_image_with_a_header_that_cannot_be(write_map, image):
    assert 'readable image' in message_of(write_map(image))
