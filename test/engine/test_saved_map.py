"""Maps saved as a set: what belongs to another method's map of the same name does not stay."""

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import MapperConfig, OutputConfig
from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.engine.saved_map import MapToSave, replacing_map, save_refined
from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.errors import OutputError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.pipeline import MappingPipeline


def saved(method):
    pipeline = MappingPipeline(MapperConfig(method=method, resolution=0.1))
    pipeline.update(PlacedScan.at(fan(1.0), Pose2D(0.05, 0.05)))
    return MapToSave(pipeline)


def test_a_tree_goes_when_a_map_without_one_takes_its_name(tmp_path):
    with replacing_map(saved('adaptive'), tmp_path, 'floor', OutputConfig()):
        pass
    assert load_tree(tmp_path / 'floor_tree.npz').config.method == 'adaptive'
    with replacing_map(saved('counting'), tmp_path, 'floor', OutputConfig()) as scratch:
        (scratch / 'floor.txt').write_text('more')
        assert not (tmp_path / 'floor.txt').exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *('floor.pgm', 'floor.png', 'floor.txt', 'floor.yaml')
    ]


def test_nothing_changes_when_adding_to_a_set_fails(tmp_path):
    with pytest.raises(KeyError), replacing_map(saved('counting'), tmp_path, 'a', OutputConfig()):
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def refined(value):
    return GridMap(GridSpec(0.1, 2, 1), np.array([[value, np.nan]], np.float32))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


BELIEFS = [
    PoseBelief(Pose2D(0.0, 0.0, 0.0), np.eye(3)),
    PoseBelief(Pose2D(1.0, 0.0, 0.0), np.eye(3)),
]
MAP = ['a.pgm', 'a.png', 'a.yaml']


def test_poses_refined_with_a_map_are_part_of_its_set(tmp_path):
    path = save_refined(
        refined(0.9),
        RefinedTrajectory([0, 10**9], BELIEFS, Pose2D()),
        tmp_path,
        'a',
        OutputConfig(),
    )
    assert path == tmp_path / 'a.yaml'
    assert names(tmp_path) == [*MAP, 'a_trajectory.txt', 'a_trajectory_deviations.csv']
    # A map with given poses has none; those of another map do not stay, nor do its points.
    (tmp_path / 'a_points.csv').write_bytes(b'of another map')
    save_refined(refined(0.9), None, tmp_path, 'a', OutputConfig())
    assert names(tmp_path) == MAP


def test_a_map_without_anything_known_replaces_none(tmp_path):
    save_refined(refined(0.9), None, tmp_path, 'a', OutputConfig())
    before = (tmp_path / 'a.pgm').read_bytes()
    with pytest.raises(OutputError, match='nothing of the map is known yet: nothing to save'):
        save_refined(refined(np.nan), None, tmp_path, 'a', OutputConfig())
    assert (tmp_path / 'a.pgm').read_bytes() == before


@pytest.mark.parametrize(
    'name', ['', '..', '.a', 'a/b', 'a\\b', 'a\nb', 'a\0b', 'x' * 201, '\udc80']
)
def test_the_name_of_a_set_is_a_plain_file_name(tmp_path, name):
    with pytest.raises(OutputError, match=r'name .*, not hidden .*at most 200 bytes') as refused:
        save_refined(refined(0.9), None, tmp_path, name, OutputConfig())
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize('name', ['grö\u00dfe 1', '-rf', '%s', 'x' * 200])
def test_any_printable_name_of_a_file_will_do(tmp_path, name):
    save_refined(
        refined(0.9),
        RefinedTrajectory([0, 10**9], BELIEFS, Pose2D()),
        tmp_path,
        name,
        OutputConfig(),
    )
    assert (tmp_path / f'{name}_trajectory_deviations.csv').is_file()
