"""Map samples survive the way to the disk and back; other files are named."""

import numpy as np
import pytest

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.io.sample_files import MapSamples, load_samples, save_samples


def test_round_trip(tmp_path):
    rng = np.random.default_rng(4)
    spec = GridSpec(0.5, 7, 3, column0=-4, row0=2)
    maps = rng.integers(0, 2, (5, 3, 7), np.uint8)
    touched = rng.integers(0, 2, (3, 7)).astype(bool)
    known = touched & (maps[0] > 0)
    samples = MapSamples(spec, maps, touched, known, 0.3)
    path = save_samples(samples, tmp_path / 's.npz', 3, {'seed': 1})
    again = load_samples(path)
    assert np.array_equal(again.known, known)
    assert again.prior == 0.3
    assert np.array_equal(again.maps, maps)
    assert np.array_equal(again.touched, touched)
    assert (again.spec.origin_x_m, again.spec.origin_y_m) == (-2.0, 1.0)
    for grid_map, cells in zip(again.grid_maps(), maps, strict=True):
        assert grid_map.spec == again.spec
        assert np.array_equal(np.isnan(grid_map.probability), ~touched)
        assert np.array_equal(grid_map.probability[touched], cells[touched])
    with np.load(path) as data:
        assert data['maps'].shape == (5, 3)  # 21 cells: three bytes a map
        assert int(data['thin']) == 3


def test_files_that_do_not_say_what_is_known(tmp_path):
    touched = np.eye(3, 7, dtype=bool)
    samples = MapSamples(GridSpec(0.5, 7, 3), np.zeros((2, 3, 7), np.uint8), touched, ~touched)
    path = save_samples(samples, tmp_path / 's.npz', 1, {})
    with np.load(path) as data:
        before = {name: data[name] for name in data.files if name != 'known'}
    np.savez(path, **before)
    again = load_samples(path)
    assert np.array_equal(again.known, touched)
    assert again.prior is None
    np.savez(path, **before, prior=1.5)
    with pytest.raises(MapFileError, match=r'prior is 1\.5: expected 0 to 1'):
        load_samples(path)


def test_other_files_are_named(tmp_path):
    (tmp_path / 'notes.txt').write_text('nothing of use')
    with pytest.raises(MapFileError, match=r'notes\.txt: expected an NPZ with map samples'):
        load_samples(tmp_path / 'notes.txt')
    np.savez(tmp_path / 'other.npz', maps=np.zeros((1, 1), np.uint8))
    with pytest.raises(MapFileError, match=r'other\.npz'):
        load_samples(tmp_path / 'other.npz')
