"""Adaptive maps on disk: the same tree comes back, and what is none is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import AdaptiveConfig, MapperConfig, flatten
from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.io.map_files import write_tables
from ogm_mcmc.mapping import AdaptiveMapper


def mapper(**tree):
    config = MapperConfig(method='adaptive', resolution=0.1, adaptive=AdaptiveConfig(**tree))
    return AdaptiveMapper(config)


def save_tree(method, folder):
    write_tables(method.extras(method.spec.box).tables, flatten(method.config), folder, 'a')
    return folder / 'a_tree.npz'


def sorted_leaves(method):
    leaves = method.tree.leaves()
    order = np.lexsort((leaves.row, leaves.column, leaves.level))
    return [array[order] for array in leaves]


def alike(one, other):
    pairs = zip(sorted_leaves(one), sorted_leaves(other), strict=True)
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == 'f') for a, b in pairs)


@given(scan=scans(), sensor=poses(5.0), more=scans())
@settings(REPEATABLE, max_examples=25)
def test_round_trip_and_on(tmp_path_factory, scan, sensor, more):
    method = mapper()
    method.update(PlacedScan.at(scan, sensor))
    path = save_tree(method, tmp_path_factory.mktemp('tree'))
    loaded = load_tree(path)
    assert loaded.config == method.config
    assert alike(loaded, method)
    for one in (method, loaded):
        one.update(PlacedScan.at(more, Pose2D(sensor.x_m + 1.0, sensor.y_m, sensor.yaw_rad)))
    assert alike(loaded, method)


def test_levels_of_all_kinds_come_back(tmp_path):
    method = mapper(coarsest_level=6)
    for _ in range(5):
        method.update(PlacedScan.at(fan(7.0, 3.0, 5.0, increment=0.4), Pose2D(0.31, 0.27)))
    assert np.count_nonzero(method.statistics().leaves_by_level) >= 5
    assert alike(load_tree(save_tree(method, tmp_path)), method)


def test_an_empty_map_comes_back(tmp_path):
    assert load_tree(save_tree(mapper(), tmp_path)).statistics().leaves == 0


@pytest.fixture
def saved(tmp_path):
    method = mapper(coarsest_level=2)
    method.update(PlacedScan.at(fan(1.0), Pose2D(0.05, 0.05)))
    path = save_tree(method, tmp_path)
    with np.load(path) as data:
        return path, dict(data)


def changed(arrays, name, change):
    return {**arrays, name: change(arrays[name].copy())}


def put(value):
    def change(array):
        array[0] = value
        return array

    return change


@pytest.mark.parametrize(
    ('name', 'change', 'message'),
    [
        ('level', lambda a: a[1:], 'column is int64 .*: expected int64, one per leaf'),
        ('hits', lambda a: a.astype(float), 'hits is float64 .*: expected float32'),
        ('level', put(9), 'leaf of level 9: expected up to 2'),
        ('column', put(1), 'beside the lattice'),
        ('column', put(2**40), 'map would grow to'),
        ('settings', lambda a: np.array('method: two_assumption'), 'expected adaptive'),
        ('settings', lambda a: np.array('gain: 1'), 'unknown setting'),
        ('settings', lambda a: np.array('- 1'), 'expected an adaptive map'),
    ],
)
def test_files_that_contradict_themselves(saved, name, change, message):
    path, arrays = saved
    np.savez(path, **changed(arrays, name, change))
    with pytest.raises(MapFileError, match=message):
        load_tree(path)


@pytest.mark.parametrize(
    ('keep', 'message'),
    [(slice(0, -1), 'leave gaps'), ([0, *range(6)], 'overlap')],
)
def test_leaves_that_make_no_tree(saved, keep, message):
    path, arrays = saved
    leaves = {key: value if key == 'settings' else value[keep] for key, value in arrays.items()}
    np.savez(path, **leaves)
    with pytest.raises(MapFileError, match=message):
        load_tree(path)


def test_files_that_are_no_tree(tmp_path):
    (tmp_path / 'a.npz').write_text('nothing of use')
    np.savez(tmp_path / 'b.npz', level=np.zeros(1, np.uint8))
    for name in ('a.npz', 'b.npz', 'c.npz'):
        with pytest.raises(MapFileError, match='expected an adaptive map'):
            load_tree(tmp_path / name)
