"""Map files: their bytes, their YAML, and what nav2_map_server makes of them."""

import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.errors import MapFileError, OutputError
from ogm_mcmc.files.output_files import writable_folder
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_files import load_grid, load_judged, load_map, save_npz

SPEC = GridSpec(0.05, 3, 2, column0=-7, row0=11, anchor_x_m=0.1, anchor_y_m=-20.3)
# The second row is the one of higher y.
PROBABILITY = np.array([[0.0, 0.5, 1.0], [np.nan, 0.65, 0.196]], np.float32)
MAP = GridMap(SPEC, PROBABILITY)
DEFAULT = OutputConfig()


def nav2_trinary(path):
    """Read a map as nav2_map_server's trinary mode does, written independently of the package.

    p = (255 - x) / 255, or x / 255 with negate; occupied from occupied_thresh on, free up to
    free_thresh, else unknown. Rows come out lowest y first: 100, 0 or -1.
    """
    fields = yaml.safe_load(path.read_text())
    header, size, white, pixels = (path.parent / fields['image']).read_bytes().split(b'\n', 3)
    assert (header, white) == (b'P5', b'255')
    width, height = map(int, size.split())
    assert len(pixels) == width * height
    rows = []
    for top in range(0, width * height, width):
        row = []
        for x in pixels[top : top + width]:
            p = x / 255.0 if fields['negate'] else (255 - x) / 255.0
            occupied, free = p >= fields['occupied_thresh'], p <= fields['free_thresh']
            row.append(100 if occupied else 0 if free else -1)
        rows.insert(0, row)
    return rows


def by_threshold(probability, output):
    """What a cell counts as; nan and what lies between is unknown."""
    return [
        [100 if p >= output.occupied_thresh else 0 if p <= output.free_thresh else -1 for p in row]
        for row in probability.tolist()
    ]


def test_bytes_of_the_image(tmp_path):
    paths = save_map(MAP, tmp_path, DEFAULT)
    assert paths['pgm'].read_bytes() == b'P5\n3 2\n255\n' + bytes([205, 0, 254, 254, 205, 0])
    assert sorted(path.name for path in tmp_path.iterdir()) == ['map.pgm', 'map.png', 'map.yaml']
    assert set(paths.values()) == set(tmp_path.iterdir())


def test_picture_for_people(tmp_path):
    with Image.open(save_map(MAP, tmp_path, DEFAULT)['png']) as image:
        picture = np.asarray(image.convert('RGB'))
    assert picture[0, 0].tolist() == [190, 198, 208]
    assert picture[0, 1:].tolist() == [[89] * 3, [205] * 3]
    assert picture[1].tolist() == [[255] * 3, [128] * 3, [0] * 3]


def test_yaml_has_nav2s_keys_at_full_precision(tmp_path):
    text = save_map(MAP, tmp_path, DEFAULT, name='hall.1')['yaml'].read_text()
    assert yaml.safe_load(text) == {
        'image': 'hall.1.pgm',
        'mode': 'trinary',
        'resolution': 0.05,
        'origin': [0.1 + -7 * 0.05, -20.3 + 11 * 0.05, 0.0],
        'negate': 0,
        'occupied_thresh': 0.65,
        'free_thresh': 0.196,
    }
    assert 'origin: [' in text  # on one line, as everybody writes it


@given(
    resolution=st.floats(0.001, 10.0),
    column0=st.integers(-(10**6), 10**6),
    anchor=st.floats(-1e6, 1e6),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_numbers_survive_the_yaml(tmp_path_factory, resolution, column0, anchor):
    spec = GridSpec(resolution, 3, 2, column0=column0, anchor_x_m=anchor, anchor_y_m=-anchor)
    folder = tmp_path_factory.mktemp('precise')
    loaded = load_map(save_map(GridMap(spec, PROBABILITY), folder, DEFAULT)['yaml']).spec
    assert loaded.resolution_m == resolution
    assert (loaded.origin_x_m, loaded.origin_y_m) == (spec.origin_x_m, spec.origin_y_m)


CELLS = st.one_of(st.just(math.nan), st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0, width=32))


@given(
    rows=st.lists(st.lists(CELLS, min_size=4, max_size=4), min_size=1, max_size=5),
    free=st.floats(2**-7, 0.1875, width=32),
    occupied=st.floats(0.203125, 0.984375, width=32),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_nav2_reads_back_what_was_saved(tmp_path_factory, rows, free, occupied):
    probability = np.array(rows, np.float32)
    output = OutputConfig(occupied_thresh=occupied, free_thresh=free)
    grid_map = GridMap(GridSpec(0.1, 4, len(rows)), probability)
    path = save_map(grid_map, tmp_path_factory.mktemp('nav2'), output)['yaml']
    expected = by_threshold(probability, output)
    assert nav2_trinary(path) == expected
    loaded = load_map(path).probability
    values = {100: 1.0, 0: 0.0, -1: math.nan}
    as_probability = [[values[cell] for cell in row] for row in expected]
    assert np.array_equal(loaded, np.array(as_probability, np.float32), equal_nan=True)


def test_unknown_stays_unknown(tmp_path):
    unknown = GridMap(SPEC, np.full((2, 3), np.nan, np.float32))
    path = save_map(unknown, tmp_path, DEFAULT)['yaml']
    assert nav2_trinary(path) == [[-1] * 3] * 2
    assert np.isnan(load_map(path).probability).all()


@pytest.mark.parametrize(
    'thresholds',
    [
        {'free_thresh': 0.25},
        {'free_thresh': 50 / 255},
        {'free_thresh': 0.1, 'occupied_thresh': 0.15},
        {'free_thresh': 0.1, 'occupied_thresh': 50 / 255},
        {'free_thresh': 0.0},
        {'free_thresh': 0.003},
        {'free_thresh': 1 / 255},
        {'occupied_thresh': 1.0},
        {'free_thresh': 0.004, 'occupied_thresh': 0.999},
    ],
)
def test_any_thresholds_read_back_as_saved(tmp_path, thresholds):
    """They choose the pixel; what the YAML holds only tells the three greys apart."""
    output = OutputConfig(**thresholds)
    probability = np.array([[0.0, 1.0, np.nan], [0.2, 0.17, 0.9]], np.float32)
    path = save_map(GridMap(SPEC, probability), tmp_path, output)['yaml']
    assert nav2_trinary(path) == by_threshold(probability, output)


def test_folders_are_made_and_files_replaced(tmp_path):
    folder = tmp_path / 'deep' / 'maps'
    save_map(GridMap(SPEC, np.ones((2, 3), np.float32)), folder, DEFAULT)
    path = save_map(MAP, folder, DEFAULT)['yaml']
    assert nav2_trinary(path) == [[0, -1, 100], [-1, 100, 0]]
    assert len(list(folder.iterdir())) == 3


@pytest.mark.parametrize('folder', ['file', 'file/maps', 'file/deep/maps'])
def test_place_that_cannot_be_written_to(tmp_path, folder):
    (tmp_path / 'file').write_text('mine')
    for write in (
        lambda place: save_map(MAP, place, DEFAULT),
        writable_folder,
        lambda place: save_npz(MAP, place / 'map.npz', {}),
    ):
        with pytest.raises(OutputError) as caught:
            write(tmp_path / folder)
        assert str(tmp_path / folder) in str(caught.value)
        assert '\n' not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ['file']
    assert (tmp_path / 'file').read_text() == 'mine'


def test_name_that_is_taken_by_a_folder(tmp_path):
    (tmp_path / 'map.yaml').mkdir()
    with pytest.raises(OutputError, match=r'map\.yaml: is a folder'):
        save_map(MAP, tmp_path, DEFAULT)
    assert [path.name for path in tmp_path.iterdir()] == ['map.yaml']


def test_a_judge_reads_what_a_sampled_map_says_of_unknown_cells(tmp_path):
    spec = GridSpec(0.5, 3, 1)
    known, mean = np.float32([[0.1, np.nan, np.nan]]), np.float32([[0.2, 0.7, np.nan]])
    path = save_npz(GridMap(spec, known), tmp_path / 'map.npz', {}, {'posterior_mean': mean})
    judged = load_judged(path)
    assert np.array_equal(judged.known.probability, known, equal_nan=True)
    filled = np.float32([[0.1, 0.7, np.nan]])
    assert np.array_equal(judged.filled.probability, filled, equal_nan=True)
    # What is of all that is known of a cell comes before the mean of draws alone.
    both = {'posterior_mean': mean, 'probability_everywhere': mean - 0.1}
    better = save_npz(GridMap(spec, known), tmp_path / 'both.npz', {}, both)
    assert load_judged(better).filled.probability[0, 1] == np.float32(0.7) - np.float32(0.1)
    as_given = load_judged(path, filled=False)
    assert as_given.filled is as_given.known
    for layer, reason in (
        (mean + 1, 'posterior_mean: expected values from 0 to 1'),
        (mean[:, :2], r'posterior_mean is float32 \(1, 2\): expected float \(1, 3\)'),
    ):
        save_npz(GridMap(spec, known), path, {}, {'posterior_mean': layer})
        with pytest.raises(MapFileError, match=reason):
            load_judged(path)
        assert load_grid(path).spec.width == 3  # nobody else needs the layer


@pytest.mark.parametrize('name', ['map.npz', 'map.v1.npz', 'map.grid', 'map'])
def test_npz_round_trip(tmp_path, name):
    settings = {'method': 'two_assumption', 'step.l_occ': 1.3863, 'max_cells': 100}
    path = save_npz(MAP, tmp_path / name, settings)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with np.load(path, allow_pickle=False) as stored:
        assert set(stored) == {'probability', 'resolution', 'origin', 'settings'}
        assert stored['probability'].dtype == np.float32
        assert np.array_equal(stored['probability'], PROBABILITY, equal_nan=True)
        assert stored['resolution'] == SPEC.resolution_m
        assert stored['origin'].tolist() == [SPEC.origin_x_m, SPEC.origin_y_m, 0.0]
        assert yaml.safe_load(str(stored['settings'])) == settings
