"""The benchmark measures what it says: the right scans, the right cells, a real map."""

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import MapperConfig, PoseUncertainConfig
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.lab.benchmarks.online import count_ray_cells, time_online
from ogm_mcmc.lab.benchmarks.scene import generated_scene, load_scene


def test_cells_of_a_corridor_on_paper():
    """A beam of 3 cells ends in the fourth; one that hits nothing clears to 7.5 m."""
    at = PoseBelief(Pose2D(0.5, 0.5))
    config = MapperConfig(resolution=1.0)
    assert count_ray_cells([PlacedScan(fan(3.0), at)], config) == 4
    assert count_ray_cells([PlacedScan(fan(3.0), at)] * 3, config) == 12
    ignoring = MapperConfig(resolution=1.0, no_return='ignore')
    assert count_ray_cells([PlacedScan(fan(np.inf), at)], ignoring) == 0


def test_result_holds_what_was_promised():
    at = PoseBelief(Pose2D(0.5, 0.5))
    placed = [PlacedScan(fan(3.0), at), PlacedScan(fan(5.0), at)]
    result = time_online(placed, MapperConfig(resolution=1.0), repeats=4)
    assert result['scans'] == 2
    assert result['cells'] == 4 + 6
    assert 0.0 < result['ms'] <= result['median_ms']
    assert result['scans_per_s'] == pytest.approx(2e3 / result['ms'], rel=1e-2)
    assert result['ns_per_cell'] == pytest.approx(1e6 * result['ms'] / 10, rel=1e-2)


def test_every_pose_sample_crosses_the_cells():
    belief = PoseBelief(Pose2D(0.5, 0.5), np.diag([0.01, 0.01, 0.0]))
    config = MapperConfig(
        method='pose_uncertain', resolution=1.0, pose_uncertain=PoseUncertainConfig(samples=7)
    )
    result = time_online([PlacedScan(fan(3.0), belief)], config, repeats=1)
    assert (result['samples'], result['cells']) == (7, 7 * 4)
    assert result['method'] == 'pose_uncertain'
    known = time_online([PlacedScan(fan(3.0), PoseBelief(belief.mean))], config, repeats=1)
    assert (known['samples'], known['cells']) == (1, 4)


def test_generated_scene_is_like_the_recorded_one():
    scene = generated_scene()
    assert len(scene.placed) == 100
    assert {scan.ranges_m.size for scan, _ in scene.placed} == {180}
    assert scene.resolution_m == 0.1
    config = MapperConfig(resolution=0.1)
    assert count_ray_cells(scene.placed, config) == pytest.approx(629_004, rel=0.05)
    again = generated_scene()
    for (scan, _), (same, _) in zip(scene.placed, again.placed, strict=True):
        assert np.array_equal(scan.ranges_m, same.ranges_m)


@pytest.mark.data
def test_recorded_scene(data_folder):
    scene = load_scene(data_folder / 'bench' / 'scene.npz')
    assert len(scene.placed) == 100
    assert count_ray_cells(scene.placed, MapperConfig(resolution=0.1)) == 629_004


def test_scene_file_that_is_none(tmp_path):
    (tmp_path / 'notes.txt').write_text('nothing of use')
    with pytest.raises(BagError, match='expected an NPZ'):
        load_scene(tmp_path / 'notes.txt')
    np.savez(tmp_path / 'other.npz', poses=np.zeros((1, 3)))
    with pytest.raises(BagError, match='expected an NPZ'):
        load_scene(tmp_path / 'other.npz')
