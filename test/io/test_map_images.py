"""Map files of others: read as nav2_map_server reads them, or refused in one line."""

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.io.map_files import load_map

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


def message_of(path):
    with pytest.raises(MapFileError) as caught:
        load_map(path)
    message = str(caught.value)
    assert str(path.parent) in message
    assert '\n' not in message
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


def test_pixel_exactly_at_a_threshold_is_unknown(write_map):
    """nav2_map_server: occupied above, free below; 102 reads as 0.6 and 204 as 0.2."""
    image = b'P5\n4 1\n255\n' + bytes([101, 102, 204, 205])
    path = write_map(image, occupied_thresh='0.6', free_thresh='0.2')
    assert same(load_map(path).probability, [[1.0, np.nan, np.nan, 0.0]])


@pytest.mark.parametrize('name', FIELDS)
def test_missing_field(write_map, name):
    assert name in message_of(write_map(**{name: None}))


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
        ('mode', 'scale'),
        ('mode', 'raw'),
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
