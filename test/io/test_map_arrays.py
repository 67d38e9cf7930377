"""Maps as NPY and MAT with a YAML beside them: what they say, and one line for what is wrong."""

import sys

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.io.map_files import load_grid

NAN = np.nan
CELLS = np.array([[0.0, 0.25, NAN], [1.0, 0.5, 0.75]])


def written(folder, array, text='', suffix='.npy'):
    path = folder / f'theirs{suffix}'
    if suffix == '.npy':
        np.save(path, array)
    else:
        savemat(path, array)
    (folder / 'theirs.yaml').write_text(f'resolution: 0.5\norigin: [-1.5, 2.0]\n{text}')
    return path


def test_probabilities(tmp_path):
    grid_map = load_grid(written(tmp_path, CELLS))
    spec = grid_map.spec
    assert (spec.resolution_m, spec.width, spec.height) == (0.5, 3, 2)
    assert (spec.origin_x_m, spec.origin_y_m) == (-1.5, 2.0)
    assert grid_map.probability.dtype == np.float32
    assert np.array_equal(grid_map.probability, CELLS, equal_nan=True)


def test_other_values(tmp_path):
    percent = np.array([[0, 25, -1], [100, 50, 75]], np.int8)
    read = load_grid(written(tmp_path, percent, 'values: percent')).probability
    assert np.array_equal(read, CELLS, equal_nan=True)
    log_odds = np.array([[-np.inf, -np.log(3), NAN], [np.inf, 0, np.log(3)]])
    read = load_grid(written(tmp_path, log_odds, 'values: log_odds')).probability
    assert np.allclose(read, CELLS, equal_nan=True)
    read = load_grid(written(tmp_path, CELLS[::-1], 'first_row: top')).probability
    assert np.array_equal(read, CELLS, equal_nan=True)


def test_a_rounding_error_outside_of_0_and_1_is_none(tmp_path):
    nearly = np.array([[1.0 + 2e-7, -2e-7, 0.5]])
    assert load_grid(written(tmp_path, nearly)).probability.tolist() == [[1.0, 0.0, 0.5]]
    percent = 100.0 * nearly
    read = load_grid(written(tmp_path, percent.clip(0.0), 'values: percent')).probability
    assert read.tolist() == [[1.0, 0.0, 0.5]]
    path = tmp_path / 'theirs.npz'
    np.savez(path, probability=nearly, resolution=0.5, origin=np.zeros(3))
    assert load_grid(path).probability.tolist() == [[1.0, 0.0, 0.5]]


@pytest.mark.parametrize('suffix', ['.NPY', '.Npz', '.YAML'])
def test_suffixes_in_capitals(tmp_path, suffix):
    """As cameras and Windows write them."""
    path = tmp_path / f'theirs{suffix}'
    if suffix == '.NPY':
        written(tmp_path, CELLS).rename(path)
    elif suffix == '.Npz':
        np.savez(tmp_path / 'it.npz', probability=CELLS, resolution=0.5, origin=np.zeros(3))
        (tmp_path / 'it.npz').rename(path)
    else:
        fields = {'image': 'G.PGM', 'negate': 0, 'occupied_thresh': 0.65, 'free_thresh': 0.25}
        path.write_text(yaml.safe_dump({**fields, 'resolution': 0.5, 'origin': [0, 0, 0]}))
        (tmp_path / 'G.PGM').write_bytes(b'P5\n3 2\n255\n' + bytes([0, 0, 0, 0, 0, 0]))
    assert load_grid(path).probability.shape == (2, 3)


def test_other_keys_do_not_matter(tmp_path):
    others = 'original: plan.png\norigin_x: 3.0\nmode: trinary\nnegate: 0'
    assert load_grid(written(tmp_path, CELLS, others)).probability.shape == (2, 3)


def test_mat(tmp_path):
    read = load_grid(written(tmp_path, {'map': CELLS, 'cell': 0.5}, suffix='.mat')).probability
    assert np.array_equal(read, CELLS, equal_nan=True)
    both = {'map': CELLS, 'variance': CELLS}
    read = load_grid(written(tmp_path, both, 'variable: map', '.mat')).probability
    assert np.array_equal(read, CELLS, equal_nan=True)
    with pytest.raises(MapFileError, match=r'"variable" in the YAML; arrays are map, variance'):
        load_grid(written(tmp_path, both, suffix='.mat'))
    with pytest.raises(MapFileError, match="variable 'x', one of map, variance"):
        load_grid(written(tmp_path, both, 'variable: x', '.mat'))


def test_mat_without_scipy(tmp_path, monkeypatch):
    path = written(tmp_path, {'map': CELLS}, suffix='.mat')
    monkeypatch.setitem(sys.modules, 'scipy.io', None)
    with pytest.raises(MapFileError, match=r'MAT files need scipy .*: pip install scipy'):
        load_grid(path)


@pytest.mark.parametrize(
    ('array', 'text', 'said'),
    [
        (CELLS + 0.5, '', 'probability: expected values from 0 to 1, or nan'),
        (CELLS * 200, 'values: percent', 'percent: expected percents from 0 to 100'),
        (CELLS, 'values: odds', "values is 'odds': expected one of probability, percent, log_o"),
        (CELLS, 'first_row: left', "first_row is 'left': expected one of bottom, top"),
        (CELLS, 'first-row: top', "'first-row' is no key: expected first_row"),
        (CELLS, 'valeus: percent', "'valeus' is no key: expected values"),
        (CELLS[0], '', r'array of shape \(3,\): expected numbers, rows x columns'),
        (CELLS[:0], '', r'array of shape \(0, 3\): expected numbers, rows x columns'),
        (CELLS > 0, 'origin: [0, 0, 1]', 'origin has yaw 1: expected 0'),
        (CELLS, 'origin: [0]', 'expected x, y and yaw'),
        (CELLS, 'resolution: 0', 'must be positive'),
        (np.array([['a']]), '', 'expected numbers, rows x columns'),
        (np.array([[{}]], object), '', 'expected an array'),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, array, text, said):
    path = written(tmp_path, array)
    kept = [f'{key}: {value}' for key, value in (('resolution', 0.5), ('origin', [0, 0]))
            if key not in text]  # fmt: skip
    (tmp_path / 'theirs.yaml').write_text('\n'.join([*kept, text]))
    with pytest.raises(MapFileError, match=said) as caught:
        load_grid(path)
    assert '\n' not in str(caught.value)


def test_a_mat_file_of_version_7_3_says_how_to_save_it(tmp_path):
    path = written(tmp_path, {'grid': CELLS}, suffix='.mat')
    path.write_bytes(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\x00\x02IM' + bytes(512))
    with pytest.raises(MapFileError, match=r'theirs.mat: .*version 7.3.*save.*-v7'):
        load_grid(path)


def test_files_that_are_no_such_map(tmp_path):
    path = written(tmp_path, CELLS)
    with pytest.raises(MapFileError, match='3 x 2 cells: expected at most 5'):
        load_grid(path, 5)
    for suffix in ('.npy', '.mat'):
        path.with_suffix(suffix).write_bytes(b'not an array')
        with pytest.raises(MapFileError, match=r'theirs\.\w+: expected a'):
            load_grid(path.with_suffix(suffix))
    (tmp_path / 'theirs.yaml').write_text('resolution: 1\n')
    with pytest.raises(MapFileError, match=r'expected resolution and origin of theirs\.npy'):
        load_grid(path)
    (tmp_path / 'theirs.yaml').unlink()
    with pytest.raises(MapFileError, match=r'expected theirs\.yaml beside it, with resolution'):
        load_grid(path)
