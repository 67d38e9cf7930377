"""Worlds by name and from files."""

import csv

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.errors import MapFileError
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.io.map_files import save_npz
from ogm_mcmc.io.world_files import WORLD_NAMES, load_world, write_poses
from ogm_mcmc.simulation import Building, generate_floor

CELLS = np.array([[0, 1, np.nan], [0, 0, 1]], np.float32)


def test_names():
    assert 'office' in WORLD_NAMES
    assert isinstance(load_world('office'), Building)
    assert np.array_equal(load_world('building-9').occupied, generate_floor(9).occupied)
    other = load_world('building-9', world_seed=5)
    assert np.array_equal(other.occupied, generate_floor(9, 5).occupied)


def test_files_of_three_kinds(tmp_path):
    grid_map = GridMap(GridSpec(0.2, 3, 2, column0=4), CELLS)
    save_map(grid_map, tmp_path, OutputConfig(), 'map')
    save_npz(grid_map, tmp_path / 'map.npz', {})
    grey = np.array([[255, 250, 0], [255, 0, 128]], np.uint8)
    Image.fromarray(grey).convert('RGB').save(tmp_path / 'plan.png')
    for name in ('map.yaml', 'map.npz', 'plan.png'):
        path = str(tmp_path / name)
        assert load_world(path).occupied.tolist() == [[0, 1, 1], [0, 0, 1]], name
        free = load_world(path, unknown_occupied=False)
        assert free.occupied.tolist() == [[0, 1, 0], [0, 0, 1]], name
    assert load_world(str(tmp_path / 'map.yaml')).spec.origin_x_m == pytest.approx(0.8)
    assert load_world(str(tmp_path / 'plan.png'), resolution_m=0.3).spec.resolution_m == 0.3


def test_what_is_no_world(tmp_path):
    (tmp_path / 'notes.png').write_text('nothing of use')
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / 'black.png')
    Image.fromarray(np.full((4, 4), 255, np.uint8)).save(tmp_path / 'white.png')
    with pytest.raises(MapFileError, match='expected a readable image'):
        load_world(str(tmp_path / 'notes.png'))
    with pytest.raises(MapFileError, match='no free cell'):
        load_world(str(tmp_path / 'black.png'))
    with pytest.raises(MapFileError, match='resolution is -1'):
        load_world(str(tmp_path / 'white.png'), resolution_m=-1.0)
    for name in ('building-11', 'building-0', 'moon', ''):
        with pytest.raises(MapFileError):
            load_world(name)


def test_poses_are_written_exactly(tmp_path):
    poses = [(5, Pose2D(0.1, 1 / 3, -2.0)), (10**18 + 1, Pose2D(1e-9, 7.0, 0.25))]
    write_poses(tmp_path / 'poses.csv', poses)
    with (tmp_path / 'poses.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    read = [
        (int(r['stamp_ns']), Pose2D(float(r['x_m']), float(r['y_m']), float(r['yaw_rad'])))
        for r in rows
    ]
    assert read == poses
