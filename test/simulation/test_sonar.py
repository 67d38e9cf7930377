"""A ring of sonars in rooms: readings on paper, and maps from them."""

import json
import math

import numpy as np
import pytest

from ogm_mcmc.config import MapperConfig, MountConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.io.sonar_bag import write_sonar_recording
from ogm_mcmc.pipeline import MappingPipeline, sensor_mount
from ogm_mcmc.simulation import SonarRing, walk

approx = pytest.approx

# A room of 5 m x 4 m; off the borders of cells.
ROOM = np.array([(0, 0, 5, 0), (5, 0, 5, 4), (5, 4, 0, 4), (0, 4, 0, 0)], float) + 0.02
WAY = np.array([(1.0, 1.0), (4.0, 1.0), (4.0, 3.0), (1.0, 3.0), (1.2, 1.2)])


def ring_readings(ring, seed=3):
    rng = np.random.default_rng(seed)
    poses = walk(WAY, period_s=0.2, speed_m_s=0.5, turn_rad_s=1.0)
    for k, robot in enumerate(poses):
        for reading in ring.measure(ROOM, robot, rng, 10**9 + k * 200_000_000):
            yield reading.scan, robot


def test_a_sonar_hears_the_nearest_wall_of_its_cone():
    """0.8 m from the mount to a wall seen at right angles, at the edge of a cone 0.6 rad wide."""
    walls = np.array([(-9.0, 1.0, 9.0, 1.0)])
    ring = SonarRing(sonars=1, radius_m=0.2, field_of_view_rad=0.6, noise_m=0.0)
    straight, askew, away = (
        next(ring.measure(walls, Pose2D(0, 0, yaw), np.random.default_rng(1))).scan
        for yaw in (math.pi / 2, math.pi / 2 - 0.5, -math.pi / 2)
    )
    assert straight.ranges_m[0] == approx(0.8, rel=1e-4)
    # The cone's edge points 0.2 rad off the normal.
    height = 1.0 - 0.2 * math.cos(0.5)
    assert askew.ranges_m[0] == approx(height / math.cos(0.2), rel=1e-4)
    assert away.ranges_m[0] == math.inf
    assert straight.beam_width_rad == 0.6


def test_mounts_as_a_parameter_are_the_mounts():
    ring = SonarRing(sonars=5)
    config = MountConfig(x=9.0, frames=ring.mounts_setting())
    for frame, pose in ring.mounts().items():
        found = sensor_mount(config, frame).pose
        assert (found.x_m, found.y_m, found.yaw_rad) == approx(
            (pose.x_m, pose.y_m, pose.yaw_rad), abs=1e-6
        )
    assert sensor_mount(config, 'laser').pose == Pose2D(9.0, 0.0, 0.0)


@pytest.mark.parametrize('frames', ['a 1 2', 'a 1 2 x', 'a 1 2 nan', 'a 1 2 3 4', 'a 1 2 3; b'])
def test_mounts_that_cannot_be_read(frames):
    with pytest.raises(ConfigError, match=r'mount\.frames is .*: expected FRAME X Y YAW'):
        MountConfig(frames=frames)


def assert_shows_the_room(grid_map):
    """The floor is free, the walls are occupied, and nothing behind them is known as free."""
    spec, probability = grid_map.spec, grid_map.probability

    def at(x, y):
        column, row = spec.cell_of(x, y)
        return probability[row, column]

    floor = [at(x, y) for x in np.arange(0.7, 4.4, 0.1) for y in np.arange(0.7, 3.4, 0.1)]
    assert np.mean(np.array(floor) < 0.2) > 0.99
    # Along the middle of each wall a sonar has looked straight at it.
    sides = [at(x, y) for x in np.arange(1.2, 4.0, 0.1) for y in (0.07, 4.07)]
    sides += [at(x, y) for x in (0.07, 5.07) for y in np.arange(1.2, 3.0, 0.1)]
    assert np.mean(np.array(sides) > 0.6) > 0.9
    assert not (probability[[0, -1]] < 0.5).any()
    assert not (probability[:, [0, -1]] < 0.5).any()


def test_a_ring_of_sonars_maps_a_room():
    ring = SonarRing()
    pipeline = MappingPipeline(MapperConfig(method='sonar', resolution=0.1))
    mounts = MountConfig(frames=ring.mounts_setting())
    for scan, robot in ring_readings(ring):
        pipeline.update(scan, PoseBelief(robot), sensor_mount(mounts, scan.frame_id))
    assert_shows_the_room(pipeline.map())


def test_a_bag_of_ranges_maps_the_same_room(run_cli, tmp_path):
    ring = SonarRing()
    count = write_sonar_recording(tmp_path / 'bag', ring_readings(ring))
    done = run_cli(
        *('map', 'bag', '-o', 'out', '--method', 'sonar', '--resolution', '0.1', '--json'),
        *('--mount.frames', ring.mounts_setting()),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result['scans'], result['scans_used']) == (count, count)
    assert result['scan_topic'] == '/range'
    with np.load(tmp_path / 'out' / 'map.npz') as data:
        probability = data['probability']
    trinary = load_map(tmp_path / 'out' / 'map.yaml')
    assert_shows_the_room(trinary._replace(probability=probability))
    laser = run_cli('map', 'bag', '-o', 'other')
    assert laser.returncode == 2
    assert 'no scans in it' in laser.stderr
