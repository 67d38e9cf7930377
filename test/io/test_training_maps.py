"""Images of maps: what is read, and one line for what is no map."""

import numpy as np
import pytest
from PIL import Image
from support.pictures import draw, read
from support.refusals import refusal_of

from ogm_mcmc.errors import PriorError
from ogm_mcmc.io.training_maps import MapSource, read_sources, read_training_map

PICTURE = '#####\n#...#\n#..??\n#...#\n##.##'
YAML = 'image: {}\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: {}\n' + (
    'occupied_thresh: 0.65\nfree_thresh: 0.196\n'
)


def greys(occupied=0, unknown=127, free=255):
    states = read(PICTURE)[::-1]
    return np.choose(states + 1, [unknown, free, occupied]).astype(np.uint8)


@pytest.fixture
def image(tmp_path):
    """Save pixels as an image and return its path."""

    def save(pixels, name='map.png', mode=None):
        path = tmp_path / name
        picture = Image.fromarray(pixels)
        (picture.convert(mode) if mode else picture).save(path)
        return path

    return save


def message_of(path, sources=None, resolution_m=0.05):
    message = refusal_of(PriorError, read_training_map, path, sources or {}, resolution_m)
    assert path.name in message
    return message


@pytest.mark.parametrize(
    ('name', 'mode'),
    [('map.png', None), ('map.png', 'RGB'), ('map.png', 'P'), ('map.pgm', None), ('map.bmp', 'P')],
)
@pytest.mark.parametrize('unknown', [127, 205])
def test_three_greys_in_any_format(image, name, mode, unknown):
    training = read_training_map(image(greys(unknown=unknown), name, mode), {}, 0.05)
    assert draw(training.states) == PICTURE
    assert training.resolution_m == 0.05
    assert training.source == MapSource(name, 0.05)


def test_resolution_from_yaml_then_sources_then_caller(image, tmp_path):
    path = image(greys())
    sources = {'map.png': MapSource('map.png', 0.02, 'somebody/maps', 'abc', 'MIT')}
    assert read_training_map(path, {}, 0.05).resolution_m == 0.05
    training = read_training_map(path, sources, 0.05)
    assert training.resolution_m == 0.02
    assert training.source == sources['map.png']
    (tmp_path / 'map.yaml').write_text(YAML.format('map.png', 0))
    assert read_training_map(path, sources, 0.05).resolution_m == 0.1
    assert 'resolution is not known' in message_of(image(greys(), 'other.png'), {}, 0.0)


def test_a_yaml_says_what_the_greys_mean(image, tmp_path):
    image(greys(occupied=255, unknown=205, free=0))
    (tmp_path / 'map.yaml').write_text(YAML.format('map.png', 1))
    training = read_training_map(tmp_path / 'map.yaml', {})
    assert draw(training.states).count('.') == 9
    assert training.resolution_m == 0.1
    (tmp_path / 'map.yaml').write_text('image: [')
    assert 'expected a readable map YAML' in message_of(tmp_path / 'map.yaml')


def photo(shape=(40, 50)):
    return np.random.default_rng(1).integers(0, 256, shape).astype(np.uint8)


@pytest.mark.parametrize(
    ('pixels', 'reason'),
    [
        (photo((40, 50, 3)), 'has colours'),
        (photo(), 'most frequent greys make up'),
        (np.full((40, 50), 255, np.uint8), 'no occupied cell'),
        (np.full((40, 50), 0, np.uint8), 'no free cell'),
        (np.full((40, 50), 127, np.uint8), 'no occupied cell'),
        (np.array([[0, 127, 255]], np.uint8), '3 x 1 pixels: expected a map of at least 5 x 5'),
        (np.dstack([greys()] * 3 + [greys()]), 'transparent'),
        (greys().astype(np.uint16) * 257, '8 bits'),
    ],
    ids=['colour photo', 'grey photo', 'free', 'occupied', 'unknown', 'small', 'alpha', 'deep'],
)
def test_what_is_no_map(image, pixels, reason):
    assert reason in message_of(image(pixels))


def test_what_cannot_be_read(tmp_path, image):
    path = tmp_path / 'cut.png'
    path.write_bytes(image(photo((200, 200))).read_bytes()[:5000])
    assert 'expected a readable image' in message_of(path)
    path.write_text('no image\n')
    assert 'expected a readable image' in message_of(path)
    assert 'No such file' in message_of(tmp_path / 'nowhere.png')


def test_sources(tmp_path):
    path = tmp_path / 'SOURCES.csv'
    path.write_text('file,width,resolution_m,source,licence\na.png,3,0.05,x/y,MIT\nb.pgm,3,1,,\n')
    assert read_sources(path) == {
        'a.png': MapSource('a.png', 0.05, 'x/y', '', 'MIT'),
        'b.pgm': MapSource('b.pgm', 1.0),
    }


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'name,size\nx,y\n', 'line 2: expected columns file and resolution_m'),
        (b'file,resolution_m\na.png,fine\n', "line 2: resolution_m is 'fine'"),
        (b'file,resolution_m\na.png,1\nb.png,-1\n', "line 3: resolution_m is '-1'"),
        (b'file,resolution_m\na.png,nan\n', "line 2: resolution_m is 'nan'"),
        (b'\xff\xfe\x00', 'expected a readable CSV'),
        (None, 'No such file'),
    ],
)
def test_sources_that_say_too_little(tmp_path, content, reason):
    path = tmp_path / 'SOURCES.csv'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PriorError) as caught:
        read_sources(path)
    assert reason in str(caught.value)
    assert str(path) in str(caught.value)
