"""Maps saved as a set: what belongs to another method's map of the same name does not stay."""

import pytest
from support.strategies import fan

from ogm_mcmc.config import MapperConfig, OutputConfig
from ogm_mcmc.engine.saved_map import MapToSave, replacing_map
from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.geometry import PlacedScan, Pose2D
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
